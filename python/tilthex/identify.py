"""A vehicle's parameters from contact-free flight: the most probable ones, with standard deviations.

The specific force, and the change of the angular rate over short windows, are predicted from the measured
rotor speeds. Both are compared where they are measured, so that their noise causes no bias; the noise of
the rotor speeds is small in comparison. Each parameter has a standard deviation before the flight, which
is that of a vehicle from its drawings (docs/truth.md, *cad*). A parameter that the flight does not
determine stays at the model's value with that deviation. The deviations after the flight hold for noise
of any colour up to `BLOCK`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tilthex._core import Vehicle
from tilthex._identified import BLOCK, PRIOR, WINDOW, Array, Figure, Flight, Mask, centred, windows
from tilthex._rotor_lag import rotor_lag, without_noise

DERIVED = (0, 1, 2, 3)
"""Number of steps with a new derivative; after them the model is almost linear."""
CELL = 0.05
"""Residuals are means over this time, s. Motors follow the noise of the gyro, which is faster than that,
and this must not count as excitation."""
STEP = 0.004
"""Samples are averaged over about this time, s; rotors are slower."""
OUTLIER = 6.0
"""Blocks whose residual is above this many robust deviations are left out: contact, the ground, gusts."""


@dataclass(frozen=True)
class Identified:
    """The result of an identification.

    `figures` in the order of `names`; `correlation` between them (k, k); `vehicle`: the corrected model;
    `left_out` and `seconds`: time that was left out and time that was used, s; `residual`: rms of the
    unexplained part, m/s^2 and rad/s.
    """

    figures: list[Figure]
    correlation: Array
    vehicle: Vehicle
    seconds: float
    left_out: float
    residual: tuple[float, float]
    predicted: list[tuple[Array, Array]] = field(repr=False, default_factory=list)

    def __getitem__(self, name: str) -> Figure:
        return next(figure for figure in self.figures if figure.name == name)


@dataclass(frozen=True)
class _Model:
    """The numbers of the model, and the vehicle that follows from a vector of parameters."""

    mass: float
    inertia: Array
    position: Array
    axis: Array
    across: Array
    thrust: Array
    drag: Array
    names: list[str]

    @staticmethod
    def of(vehicle: Vehicle, flights: int) -> _Model:
        rotors = vehicle.rotors

        def column(key: str) -> Array:
            return np.array([rotor[key] for rotor in rotors], dtype=float)

        axis = column("axis")
        first = np.cross(axis, np.where(abs(axis[:, :1]) < 0.9, [1.0, 0, 0], [0, 1.0, 0]))
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        n = len(rotors)
        names = ["mass", "thrust", *["thrust_each"] * n, "drag_moment", *["rotor_axis"] * (2 * n)]
        names += ["centre_of_mass"] * 3 + ["inertia"] * 3 + ["inertia_product"] * 3
        names += ["rotor_drag", "speed_age", *["accelerometer_bias"] * (3 * flights)]
        return _Model(
            vehicle.mass,
            vehicle.inertia,
            column("position"),
            axis,
            np.stack([first, np.cross(axis, first)], axis=1),
            column("thrust_coefficient"),
            column("drag_coefficient") * column("spin"),
            names,
        )

    def at(self, x: Array) -> _Set:
        """The vehicle with these parameters, in their units (fractions, rad, m, ...)."""
        n = len(self.thrust)
        mass, common, each, drag, turn, rest = np.split(x, np.cumsum([1, 1, n, 1, 2 * n]))
        centre, moments, products, (rotor_drag, age), bias = np.split(rest, [3, 6, 9, 11])
        turned = self.axis + np.einsum("ij,ijk->ik", turn.reshape(n, 2), self.across)
        root = np.sqrt(np.diag(self.inertia) * np.exp(moments))
        scale = np.sqrt(np.diag(self.inertia))
        inertia = self.inertia / np.outer(scale, scale) * np.outer(root, root)
        for (i, j), part in zip(((0, 1), (0, 2), (1, 2)), products, strict=True):
            inertia[i, j] += part * root[i] * root[j]
            inertia[j, i] = inertia[i, j]
        return _Set(
            float(self.mass * np.exp(mass[0])),
            inertia,
            self.position - centre,
            turned / np.linalg.norm(turned, axis=1, keepdims=True),
            self.thrust * np.exp(common[0] + each),
            self.drag * np.exp(drag[0]),
            centre,
            float(rotor_drag),
            float(age),
            bias.reshape(-1, 3),
        )


@dataclass(frozen=True)
class _Set:
    """One vehicle; positions are relative to its own centre of mass."""

    mass: float
    inertia: Array
    position: Array
    axis: Array
    thrust: Array
    drag: Array
    centre: Array
    rotor_drag: float
    speed_age: float
    bias: Array

    def predict(self, flight: Flight, number: int) -> tuple[Array, Array]:
        """Specific force at the model's centre of mass (N, 3), and angular acceleration (N, 3)."""
        # Shifted with a smoothed slope: a mean between noisy samples would reduce their noise.
        speeds = flight.rotor_speeds + self.speed_age * flight.rotor_acceleration
        lift = speeds * abs(speeds)
        forces = self.thrust[:, None] * self.axis
        torques = np.cross(self.position, forces) + self.drag[:, None] * self.axis
        force, torque = lift @ forces, lift @ torques
        omega = flight.angular_velocity
        if flight.velocity is not None and self.rotor_drag != 0.0:
            hub = flight.velocity[:, None] + np.cross(omega[:, None], self.position)
            along = np.einsum("nik,ik->ni", hub, self.axis)
            push = -self.rotor_drag * abs(speeds)[:, :, None] * (hub - along[:, :, None] * self.axis)
            force = force + push.sum(axis=1)
            torque = torque + np.cross(self.position, push).sum(axis=1)
        turn = torque - np.cross(omega, omega @ self.inertia)
        alpha = turn @ np.linalg.inv(self.inertia)
        lever = -self.centre
        moved = np.cross(alpha, lever) + np.cross(omega, np.cross(omega, lever))
        return force / self.mass + moved + self.bias[number], alpha


def identify(flights: Sequence[Flight], vehicle: Vehicle, *, mass: float | None = None) -> Identified:
    """The most probable parameters of a vehicle.

    A flight determines forces and moments only relative to the mass. So the mass keeps its prior
    deviation, and the other parameters share it, unless the mass was weighed.

    Args:
        flights: Flights that are free of contact for most of the time.
        vehicle: The model.
        mass: The weighed mass, kg; it counts as correct to within 0.2 %.

    Raises:
        ValueError: The time in flight is too short.
    """
    model = _Model.of(vehicle, len(flights))
    prior = np.array([PRIOR[name] for name in model.names])
    mean = np.zeros(len(prior))
    if mass is not None:
        prior[0], mean[0] = 0.002, float(np.log(mass / vehicle.mass))
    lag = rotor_lag(flights, vehicle)
    fine = [without_noise(flight, lag) for flight in flights]
    flights = [flight.coarser(STEP) for flight in fine]
    cells = [flight.coarser(CELL) for flight in flights]
    used = [np.ones(len(c.time), bool) if c.used is None else c.used for c in cells]
    blocks = [windows(cell, BLOCK) for cell in cells]
    if sum(len(np.unique(b[u & (b >= 0)])) for b, u in zip(blocks, used, strict=True)) < 10:
        raise ValueError(
            f"the flights have fewer than 10 blocks of {BLOCK:g} s in the air; expected at least 10"
        )
    whole = [u & (b >= 0) for b, u in zip(blocks, used, strict=True)]
    x, noise = mean.copy(), (0.3, 0.03)
    slope: list[Array] = []
    for step in range(5):
        if step in DERIVED:
            slope = [_derivative(model, flight, k, x, prior) for k, flight in enumerate(flights)]
        left = [_raw(model, flight, k, x) for k, flight in enumerate(flights)]
        x = x - prior * _step(left, slope, used, noise, (x - mean) / prior)
        left = [_raw(model, flight, k, x) for k, flight in enumerate(flights)]
        noise = _noise(left, used)
        if step < 3:
            used = [u & _usual(r, b, w) for r, b, w, u in zip(left, blocks, whole, used, strict=True)]
    covariance = _covariance(left, slope, used, blocks, noise)
    period = [float(np.median(np.diff(c.time))) for c in cells]
    seconds = sum(p * int(u.sum()) for p, u in zip(period, used, strict=True))
    flown = sum(p * int(w.sum()) for p, w in zip(period, whole, strict=True))
    figures, correlation = _figures(model, x, covariance, prior)
    if mass is not None:
        figures = [replace(one, weighed=True) if one.name == "mass" else one for one in figures]
    found = model.at(x)
    return Identified(
        figures + lag,
        correlation,
        _vehicle(vehicle, found, lag),
        seconds,
        flown - seconds,
        noise,
        [found.predict(flight, k) for k, flight in enumerate(fine)],
    )


def _raw(model: _Model, flight: Flight, number: int, x: Array) -> Array:
    """Measured minus predicted: specific force, and rate relative to the mean of its window, (N, 6)."""
    force, alpha = model.at(x).predict(flight, number)
    step = np.diff(flight.time, prepend=flight.time[0])[:, None]
    rate = np.cumsum(0.5 * step * (alpha + np.roll(alpha, 1, axis=0)), axis=0)
    left = flight.rows(np.hstack([flight.specific_force - force, flight.angular_velocity - rate]), CELL)
    left[:, 3:] = centred(left[:, 3:], windows(flight.coarser(CELL), WINDOW))
    return left


def _noise(left: list[Array], used: list[Mask]) -> tuple[float, float]:
    """Robust deviations of the residuals: specific force, m/s^2, and rate, rad/s."""
    kept = np.vstack([r[u] for r, u in zip(left, used, strict=True)])
    robust = 1.4826 * np.median(abs(kept), axis=0)
    return float(np.sqrt(np.mean(robust[:3] ** 2))), float(np.sqrt(np.mean(robust[3:] ** 2)))


def _usual(residual: Array, block: NDArray[np.int64], used: Mask) -> Mask:
    """Blocks whose mean specific force and rms of the rate are similar to those of the other blocks."""
    inside = used
    number = np.where(block >= 0, block, 0)
    counts = np.maximum(np.bincount(number, inside), 1)
    sums = [np.bincount(number, column * inside) / counts for column in residual[:, :3].T]
    rate = np.sqrt(np.bincount(number, np.sum(residual[:, 3:] ** 2, axis=1) * inside) / counts)
    score = np.zeros(len(counts))
    there = np.bincount(number, inside) > 0
    for values in (*sums, rate):
        middle = np.median(values[there])
        spread = 1.4826 * np.median(abs(values[there] - middle)) + 1e-9
        score = np.maximum(score, abs(values - middle) / spread)
    usual: Mask = (score < OUTLIER)[number]
    return usual


def _derivative(model: _Model, flight: Flight, number: int, x: Array, prior: Array) -> Array:
    """Derivative of the residuals by each parameter, times its prior deviation, (N, 6, k)."""
    here = _raw(model, flight, number, x)
    columns = []
    for k, size in enumerate(prior):
        step = np.zeros(len(x))
        step[k] = 1e-4 * size
        columns.append((_raw(model, flight, number, x + step) - here) / 1e-4)
    return np.stack(columns, axis=2)


def _stacked(
    left: list[Array], slope: list[Array], used: list[Mask], noise: tuple[float, float]
) -> tuple[Array, Array]:
    """Residuals (N, 6) and their derivative (N, 6, k) of the used samples, divided by their noise."""
    scale = np.r_[[1 / noise[0]] * 3, [1 / noise[1]] * 3]
    rows = np.vstack([r[u] for r, u in zip(left, used, strict=True)]) * scale
    return rows, np.vstack([s[u] for s, u in zip(slope, used, strict=True)]) * scale[:, None]


def _step(
    left: list[Array], slope: list[Array], used: list[Mask], noise: tuple[float, float], off: Array
) -> Array:
    """One Gauss-Newton step; `off`: parameters minus their means. Both are in prior deviations."""
    here, jacobian = _stacked(left, slope, used, noise)
    rows = jacobian.reshape(-1, len(off))
    step: Array = np.linalg.solve(rows.T @ rows + np.eye(len(off)), rows.T @ here.ravel() + off)
    return step


def _covariance(
    left: list[Array],
    slope: list[Array],
    used: list[Mask],
    blocks: list[NDArray[np.int64]],
    noise: tuple[float, float],
) -> Array:
    """Covariance from blocks (a sandwich estimator), in units of the squared prior deviations."""
    here, jacobian = _stacked(left, slope, used, noise)
    size = jacobian.shape[2]
    rows = jacobian.reshape(-1, size)
    score = np.einsum("nij,ni->nj", jacobian, here)
    numbers, offset = [], 0
    for block, u in zip(blocks, used, strict=True):
        numbers.append(block[u] + offset)
        offset += block.max() + 2
    number = np.unique(np.concatenate(numbers), return_inverse=True)[1]
    sums = np.zeros((number.max() + 1, size))
    np.add.at(sums, number, score)
    count = len(sums)
    inverse = np.linalg.inv(rows.T @ rows + np.eye(size))
    # The parameters use up degrees of freedom of the residuals.
    taken = float(np.trace(inverse @ rows.T @ rows))
    spread = sums.T @ sums * count / max(count - taken / 6, 1)
    covariance: Array = inverse @ (spread + np.eye(size)) @ inverse
    return covariance


def _values(model: _Model, x: Array) -> tuple[list[tuple[str, str]], Array]:
    """Names with units, and values, of the reported parameters."""
    at = model.at(x)
    ratio = at.thrust / model.thrust
    names = [("mass", "kg"), ("thrust, all rotors", "of model")]
    names += [(f"thrust, rotor {k + 1}", "of model") for k in range(len(ratio))]
    names += [("drag moment", "of model"), *((f"centre of mass {a}", "m") for a in "xyz")]
    names += [(f"inertia {a}", "kg m^2") for a in ("xx", "yy", "zz", "xy", "xz", "yz")]
    names += [("rotor drag", "N s/m/Hz"), ("age of rotor speeds", "s")]
    drag = float(np.linalg.norm(at.drag) / np.linalg.norm(model.drag))
    i = at.inertia
    moments = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
    values = [at.mass, ratio.mean(), *ratio, drag, *at.centre, *moments, at.rotor_drag, at.speed_age]
    return names, np.array(values)


def _figures(model: _Model, x: Array, covariance: Array, prior: Array) -> tuple[list[Figure], Array]:
    names, values = _values(model, x)
    gain = np.empty((len(values), len(x)))
    for k, size in enumerate(prior):
        step = np.zeros(len(x))
        step[k] = 1e-3 * size
        gain[:, k] = (_values(model, x + step)[1] - _values(model, x - step)[1]) / 2e-3
    spread = gain @ covariance @ gain.T
    deviation = np.sqrt(np.diag(spread))
    before = np.sqrt(np.diag(gain @ gain.T))
    told = _values(model, np.zeros(len(x)))[1]
    figures = [
        Figure(name, unit, float(value), float(off), float(b), float(m))
        for (name, unit), value, off, b, m in zip(names, values, deviation, before, told, strict=True)
    ]
    return figures, spread / np.outer(deviation, deviation)


def _vehicle(vehicle: Vehicle, found: _Set, lag: Sequence[Figure]) -> Vehicle:
    """The corrected model; positions move relative to the centre of mass.

    Raises:
        ValueError: The flight determined so little that no vehicle has these values.
    """
    centre = found.centre
    rotors = [
        rotor
        | {
            "position": position.tolist(),
            "axis": axis.tolist(),
            "thrust_coefficient": float(thrust),
            "drag_coefficient": float(abs(drag)),
        }
        for rotor, position, axis, thrust, drag in zip(
            vehicle.rotors, found.position, found.axis, found.thrust, found.drag, strict=True
        )
    ]
    keys = {
        "name": vehicle.name,
        "mass": found.mass,
        "inertia": found.inertia.tolist(),
        "rotor_time_constant": lag[0].value if lag else vehicle.rotor_time_constant,
        "tool_position": (vehicle.tool_position - centre).tolist(),
        "tool_rotation_deg": _angles(vehicle.tool_rotation),
        "imu_position": (vehicle.imu_position - centre).tolist(),
        "imu_rotation_deg": _angles(vehicle.imu_rotation),
        "rotors": rotors,
    }
    try:
        return Vehicle.from_dict(keys)
    except ValueError as error:
        raise ValueError(
            f"the flight does not determine the vehicle, the fit found an impossible one: {error}; "
            "fly the trajectory of `tilthex excite` (docs/identification.md)"
        ) from error


def _angles(rotation: Array) -> list[float]:
    """Roll, pitch and yaw, degrees."""
    from scipy.spatial.transform import Rotation

    angles: list[float] = Rotation.from_matrix(rotation).as_euler("ZYX", degrees=True)[::-1].tolist()
    return angles


__all__ = ["Figure", "Flight", "Identified", "identify"]
