"""The estimator's model written a second time, for comparison: a UKF on manifolds in NumPy, and filterpy's.

Nothing here knows of the structure that the compiled filter exploits: all 31 points are
sent through the model, and the update works with sigma points of the measurement, too.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

GRAVITY = np.array([0.0, 0.0, 9.81])
# Order in which the covariance is factored, as indices of (p, v, R, gyro bias, accelerometer bias).
ORDER = np.r_[9:12, 6:9, 12:15, 3:6, 0:3]
ALPHA_SQUARED = 0.2
SPREAD = np.sqrt(15 * ALPHA_SQUARED)


def exp(v: Array) -> Array:
    return Rotation.from_rotvec(v).as_matrix()


def log(r: Array) -> Array:
    return Rotation.from_matrix(r).as_rotvec()


@dataclass
class Noise:
    gyro: float = 5e-4
    accelerometer: float = 0.01
    gyro_bias: float = 1e-4
    accelerometer_bias: float = 1e-3
    position: float = 0.3e-3
    rotation: float = np.radians(0.12)

    def process(self, dt: float) -> Array:
        q = np.zeros((15, 15))
        eye = np.eye(3)
        a = self.accelerometer**2
        q[0:3, 0:3] = a * dt**3 / 3 * eye
        q[0:3, 3:6] = q[3:6, 0:3] = a * dt**2 / 2 * eye
        q[3:6, 3:6] = a * dt * eye
        q[6:9, 6:9] = self.gyro**2 * dt * eye
        q[9:12, 9:12] = self.gyro_bias**2 * dt * eye
        q[12:15, 12:15] = self.accelerometer_bias**2 * dt * eye
        return q

    def pose(self) -> Array:
        return np.diag(np.r_[[self.position**2] * 3, [self.rotation**2] * 3])


@dataclass
class State:
    """A state, or a batch of states along the first axis."""

    position: Array
    velocity: Array
    rotation: Array
    gyro_bias: Array
    accelerometer_bias: Array

    def plus(self, e: Array) -> State:
        return State(
            self.position + e[..., 0:3],
            self.velocity + e[..., 3:6],
            exp(e[..., 6:9]) @ self.rotation,
            self.gyro_bias + e[..., 9:12],
            self.accelerometer_bias + e[..., 12:15],
        )

    def minus(self, other: State) -> Array:
        return np.concatenate(
            [
                self.position - other.position,
                self.velocity - other.velocity,
                log(self.rotation @ other.rotation.T),
                self.gyro_bias - other.gyro_bias,
                self.accelerometer_bias - other.accelerometer_bias,
            ],
            axis=-1,
        )

    def moved(self, gyro: Array, force: Array, dt: float) -> State:
        turned = self.rotation @ exp((gyro - self.gyro_bias) * dt)
        body = (force - self.accelerometer_bias)[..., None]
        a = (0.5 * (self.rotation + turned) @ body)[..., 0] - GRAVITY
        return State(
            self.position + self.velocity * dt + 0.5 * dt**2 * a,
            self.velocity + dt * a,
            turned,
            self.gyro_bias,
            self.accelerometer_bias,
        )


def initial_covariance() -> Array:
    deviations = [0.01, 0.1, np.radians(1.0), 0.02, 0.2]
    return np.diag(np.repeat(np.square(deviations), 3))


@dataclass
class NumpyUkf:
    """UKF-M (Brossard, Barrau, Bonnabel 2020) with additive process noise."""

    state: State
    noise: Noise = field(default_factory=Noise)
    covariance: Array = field(default_factory=initial_covariance)

    @staticmethod
    def start(position: Array, rotation: Array, noise: Noise | None = None) -> NumpyUkf:
        zero = np.zeros(3)
        return NumpyUkf(State(position, zero, rotation, zero, zero), noise or Noise())

    def points(self) -> Array:
        root = np.linalg.cholesky(self.covariance[np.ix_(ORDER, ORDER)])
        points = np.zeros((30, 15))
        points[:15, ORDER] = SPREAD * root.T
        points[15:, ORDER] = -SPREAD * root.T
        return points

    def predict(self, gyro: Array, force: Array, dt: float) -> None:
        moved = self.state.moved(gyro, force, dt)
        errors = self.state.plus(self.points()).moved(gyro, force, dt).minus(moved)
        weight = 1 / (30 * ALPHA_SQUARED)
        centre_weight = 1 - 1 / ALPHA_SQUARED + 3 - ALPHA_SQUARED
        mean = weight * errors.sum(axis=0)
        off = errors - mean
        self.covariance = weight * off.T @ off + centre_weight * np.outer(mean, mean) + self.noise.process(dt)
        self.state = moved

    def update(self, position: Array, rotation: Array) -> float:
        points = self.points()
        moved = self.state.plus(points)
        expected = np.hstack(
            [moved.position - self.state.position, log(moved.rotation @ self.state.rotation.T)]
        )
        innovation = np.r_[position - self.state.position, log(rotation @ self.state.rotation.T)]
        weight = 1 / (30 * ALPHA_SQUARED)
        s = weight * expected.T @ expected + self.noise.pose()
        gain = np.linalg.solve(s, weight * expected.T @ points).T
        self.covariance = self.covariance - gain @ s @ gain.T
        self.covariance = 0.5 * (self.covariance + self.covariance.T)
        self.state = self.state.plus(gain @ innovation)
        return float(innovation @ np.linalg.solve(s, innovation))


class FilterpyUkf:
    """filterpy's filter on the same model: its state is the error about a reference that moves along."""

    def __init__(self, position: Array, rotation: Array, noise: Noise | None = None) -> None:
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

        self.noise = noise or Noise()
        points = MerweScaledSigmaPoints(15, alpha=np.sqrt(ALPHA_SQUARED), beta=2.0, kappa=0.0)
        self.reference = State(position, np.zeros(3), rotation, np.zeros(3), np.zeros(3))
        self.filter = UnscentedKalmanFilter(
            dim_x=15, dim_z=6, dt=1.0, hx=self._expected, fx=self._moved, points=points
        )
        self.filter.x = np.zeros(15)
        self.filter.P = initial_covariance()
        self.filter.R = self.noise.pose()

    def _moved(self, x: Array, _: float) -> Array:
        gyro, force, dt = self.readings
        return self.reference.plus(x).moved(gyro, force, dt).minus(self.next)

    def _expected(self, x: Array) -> Array:
        return np.r_[x[0:3], x[6:9]]

    def predict(self, gyro: Array, force: Array, dt: float) -> None:
        self.readings = (gyro, force, dt)
        self.next = self.reference.moved(gyro, force, dt)
        self.filter.Q = self.noise.process(dt)
        self.filter.predict()
        self._carry(self.next)

    def update(self, position: Array, rotation: Array) -> None:
        now = self.reference
        self.filter.sigmas_f = self.filter.points_fn.sigma_points(self.filter.x, self.filter.P)
        self.filter.update(np.r_[position - now.position, log(rotation @ now.rotation.T)])
        self._carry(now)

    def _carry(self, reference: State) -> None:
        self.reference = reference.plus(self.filter.x)
        self.filter.x = np.zeros(15)

    @property
    def state(self) -> State:
        return self.reference

    @property
    def covariance(self) -> Array:
        return self.filter.P


def run(ukf: NumpyUkf | FilterpyUkf, imu: tuple[Array, Array, Array], poses: dict[int, tuple[Array, Array]]):
    """Runs over a recording whose poses lie at inertial samples; yields after every sample.

    Between two samples the readings count as their mean, as in the compiled estimator.
    """
    time, gyro, force = imu
    for k in range(len(time)):
        if k > 0:
            g, f = 0.5 * (gyro[k - 1] + gyro[k]), 0.5 * (force[k - 1] + force[k])
            ukf.predict(g, f, time[k] - time[k - 1])
        if k in poses:
            ukf.update(*poses[k])
        yield k


def recording(seed: int, samples: int = 600):
    """Rough readings at 500 Hz and poses at 100 Hz of a motion that they make up."""
    random = np.random.default_rng(seed)
    t = 0.002 * np.arange(samples)
    waves = random.uniform(-1, 1, (6, 3)), random.uniform(1, 12, (6, 3)), random.uniform(0, 6, (6, 3))
    wave = np.sum(waves[0] * np.sin(waves[1] * t[:, None, None] + waves[2]), axis=2)
    gyro = wave[:, :3] + 0.01 * random.standard_normal((samples, 3))
    rotation = np.empty((samples, 3, 3))
    rotation[0] = Rotation.random(random_state=seed).as_matrix()
    position, velocity = np.zeros((samples, 3)), np.zeros((samples, 3))
    acceleration = 3 * wave[:, 3:]
    for k in range(1, samples):
        rotation[k] = rotation[k - 1] @ exp(0.5 * (gyro[k - 1] + gyro[k]) * 0.002)
        a = 0.5 * (acceleration[k - 1] + acceleration[k])
        velocity[k] = velocity[k - 1] + 0.002 * a
        position[k] = position[k - 1] + 0.002 * (velocity[k - 1] + 0.001 * a)
    force = np.einsum("kji,kj->ki", rotation, acceleration + GRAVITY)
    gyro += random.uniform(-0.01, 0.01, 3) + 0.005 * random.standard_normal((samples, 3))
    force += random.uniform(-0.1, 0.1, 3) + 0.15 * random.standard_normal((samples, 3))
    taken = np.arange(0, samples, 5)
    measured = position[taken] + 0.3e-3 * random.standard_normal((len(taken), 3))
    turned = exp(2e-3 * random.standard_normal((len(taken), 3))) @ rotation[taken]
    return t, gyro, force, taken, measured, turned, position
