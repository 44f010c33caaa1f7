"""A plain error-state Kalman filter without a gate, with which the estimator is compared.

It was written from Solà, "Quaternion kinematics for the error-state Kalman filter" (2017), with the error of
the rotation in body axes and a covariance by linearisation. It takes every pose, at the time at
which it was taken, with the configured noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from tilthex.recording import Recording

Array = NDArray[np.float64]
GRAVITY = np.array([0.0, 0.0, 9.81])


@dataclass(frozen=True)
class Noise:
    """Densities, walks and deviations in SI units, under the names of `[estimator]`."""

    gyro: float = 5e-4
    accelerometer: float = 0.01
    gyro_bias: float = 1e-4
    accelerometer_bias: float = 1e-3
    position: float = 0.3e-3
    rotation: float = float(np.radians(0.12))
    initial: tuple[float, ...] = (0.01, 0.1, float(np.radians(1.0)), 0.02, 0.2)


@dataclass
class State:
    """Mean, covariance over (p, v, body-axis rotation, gyro bias, accelerometer bias), and time."""

    time: float
    position: Array
    velocity: Array
    rotation: Array
    gyro_bias: Array
    force_bias: Array
    covariance: Array


@dataclass(frozen=True)
class Track:
    """Position (n, 3) and rotation (n, 3, 3) at every inertial sample; NaN before the start."""

    position: Array
    rotation: Array


def hat(v: Array) -> Array:
    """Cross-product matrix."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def exp(v: Array) -> Array:
    """Rodrigues' formula."""
    angle = np.sqrt(v @ v)
    k = hat(v)
    if angle < 1e-8:
        return np.eye(3) + k
    return np.eye(3) + np.sin(angle) / angle * k + (1 - np.cos(angle)) / angle**2 * (k @ k)


def log(r: Array) -> Array:
    """Rotation vector of a rotation by less than 180 deg."""
    v = 0.5 * np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    sine = np.sqrt(v @ v)
    if sine < 1e-9 and np.trace(r) > 0:
        return v
    if sine < 1e-6:
        from scipy.spatial.transform import Rotation

        return Rotation.from_matrix(r).as_rotvec()
    return np.arctan2(sine, 0.5 * (np.trace(r) - 1)) / sine * v


class Eskf:
    """The filter: `predict` and `update` in the order of time."""

    def __init__(self, time: float, position: Array, rotation: Array, noise: Noise) -> None:
        covariance = np.diag(np.repeat(np.square(noise.initial), 3))
        zero = np.zeros(3)
        self.noise = noise
        self.state = State(time, position, zero, rotation, zero, zero, covariance)

    def predict(self, gyro: Array, force: Array, time: float) -> None:
        """Moves to `time` with constant readings."""
        s, n = self.state, self.noise
        dt = time - s.time
        if dt <= 0:
            return
        rate, f = gyro - s.gyro_bias, force - s.force_bias
        turned = s.rotation @ exp(rate * dt)
        middle = s.rotation @ exp(0.5 * rate * dt)
        acceleration = middle @ f - GRAVITY
        step = np.eye(15)
        step[0:3, 3:6] = dt * np.eye(3)
        step[3:6, 6:9] = -dt * middle @ hat(f)
        step[3:6, 12:15] = -dt * middle
        step[0:3, 6:9] = 0.5 * dt * step[3:6, 6:9]
        step[0:3, 12:15] = 0.5 * dt * step[3:6, 12:15]
        step[6:9, 6:9] = exp(-rate * dt)
        step[6:9, 9:12] = -dt * np.eye(3)
        a = n.accelerometer**2
        walks = dt * n.gyro**2, dt * n.gyro_bias**2, dt * n.accelerometer_bias**2
        variance = np.repeat([dt**3 / 3 * a, dt * a, *walks], 3)
        covariance = step @ s.covariance @ step.T
        covariance[np.arange(15), np.arange(15)] += variance
        self.state = State(
            time,
            s.position + dt * s.velocity + 0.5 * dt**2 * acceleration,
            s.velocity + dt * acceleration,
            turned,
            s.gyro_bias,
            s.force_bias,
            covariance,
        )

    def update(self, position: Array, rotation: Array) -> None:
        """Takes a pose of the IMU."""
        s, n = self.state, self.noise
        residual = np.concatenate([position - s.position, log(s.rotation.T @ rotation)])
        rows = np.r_[0:3, 6:9]
        r = np.diag(np.repeat(np.square([n.position, n.rotation]), 3))
        gain = np.linalg.solve(s.covariance[np.ix_(rows, rows)] + r, s.covariance[rows]).T
        keep = np.eye(15)
        keep[:, rows] -= gain
        covariance = keep @ s.covariance @ keep.T + gain @ r @ gain.T
        e = gain @ residual
        self.state = State(
            s.time,
            s.position + e[0:3],
            s.velocity + e[3:6],
            s.rotation @ exp(e[6:9]),
            s.gyro_bias + e[9:12],
            s.force_bias + e[12:15],
            0.5 * (covariance + covariance.T),
        )


def run(recording: Recording, noise: Noise, *, latency: float = 0.0) -> Track:
    """Runs over a recording of an IMU whose own poses are captured, as `Ukf.run` does.

    For a late pose it goes back to the samples before it, and predicts the samples after it again.
    """
    time, n = recording.imu_time, len(recording.imu_time)
    gyro, force = recording.gyro.copy(), recording.specific_force.copy()
    # Between two samples the filter uses the mean of the readings.
    gyro[1:], force[1:] = 0.5 * (gyro[1:] + gyro[:-1]), 0.5 * (force[1:] + force[:-1])
    taken = recording.pose_time - latency
    order = list(np.argsort(recording.pose_arrival_time, kind="stable"))
    position, rotation = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
    past: list[State | None] = [None] * n
    filter: Eskf | None = None

    def go_on(first: int, last: int) -> None:
        assert filter is not None
        for j in range(first, last + 1):
            filter.predict(gyro[j], force[j], time[j])
            past[j] = filter.state

    for k in range(n):
        if filter is not None:
            go_on(k, k)
        while order and max(recording.pose_arrival_time[order[0]], taken[order[0]]) <= time[k]:
            p = order.pop(0)
            if filter is None:
                filter = Eskf(taken[p], recording.position[p], recording.rotation[p], noise)
                go_on(int(np.searchsorted(time, taken[p], side="right")), k)
                continue
            after = int(np.searchsorted(time, taken[p], side="right"))
            before = past[after - 1]
            if before is None or after > k + 1:
                continue
            filter.state = before
            if after < n:
                filter.predict(gyro[after], force[after], taken[p])
            filter.update(recording.position[p], recording.rotation[p])
            past[after - 1] = filter.state if before.time == filter.state.time else past[after - 1]
            go_on(after, k)
        if filter is not None:
            position[k], rotation[k] = filter.state.position, filter.state.rotation
    return Track(position, rotation)
