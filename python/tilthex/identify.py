"""A vehicle's parameters from contact-free flight: the most probable ones, with standard deviations.

The specific force, and the change of the angular rate over short windows, are predicted from the measured
rotor speeds. Both are compared where they are measured, so that their noise causes no bias; the noise of
the rotor speeds is small in comparison. Each parameter has a standard deviation before the flight, which
is that of a vehicle from its drawings (docs/truth.md, *cad*). A parameter that the flight does not
determine stays at the model's value with that deviation. The deviations after the flight hold for noise
of any colour up to `BLOCK`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tilthex._battery import exponent, exponent_before
from tilthex._core import Vehicle
from tilthex._identified import BLOCK, PRIOR, WINDOW, Array, Figure, Flight, Mask, centred, windows
from tilthex._parameters import Model, corrected, reported
from tilthex._priors import Prior, checked, informed, slopes
from tilthex._rotor_lag import lag_before, rotor_lag, without_noise

DERIVED = (0, 1, 2, 3)
"""Number of steps with a new derivative; after them the model is almost linear."""
CELL = 0.05
"""Residuals are means over this time, s. Motors follow the noise of the gyro, which is faster than that,
and this must not count as excitation."""
STEP = 0.004
"""Samples are averaged over about this time, s; rotors are slower."""
WEIGHED = 0.002
"""Deviation of a weighed mass, as a part of it."""
MOMENTS = ("inertia xx", "inertia yy", "inertia zz")
AGE = "age of rotor speeds"
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


def identify(
    flights: Sequence[Flight],
    vehicle: Vehicle,
    *,
    mass: float | None = None,
    priors: Mapping[str, Prior] | None = None,
) -> Identified:
    """The most probable parameters of a vehicle.

    A flight determines forces and moments only relative to the mass. So the mass keeps its prior
    deviation, and the other parameters share it, unless the mass was weighed.

    Args:
        flights: Flights that are free of contact for most of the time.
        vehicle: The model.
        mass: The weighed mass, kg; it counts as correct to within `WEIGHED`.
        priors: What is known of figures, by their names, `thrust, rotor 1` or `thrust_rotor_1`. They replace
            the deviations of `PRIOR`.

    Raises:
        ValueError: The time in flight is too short, or a prior is impossible.
    """
    model = Model.of(vehicle, flights)
    prior = np.array([PRIOR[name] for name in model.names])
    priors = dict(priors or {})
    if mass is not None:
        if "mass" in priors:
            raise ValueError("the mass is given twice; expected it weighed, or as a prior")
        priors["mass"] = Prior(mass, WEIGHED * mass)
    names = [name for name, _ in reported(model, np.zeros(len(prior)))[0]]

    def values(z: Array) -> Array:
        return reported(model, prior * z)[1]

    nothing = np.zeros(len(prior))
    before, _ = _figures(model, nothing, np.eye(len(prior)), (prior, np.eye(len(prior))), {})
    given = checked(priors, [*before, *lag_before(flights, vehicle), *exponent_before(flights)])
    own = {name: one for name, one in given.items() if name in names}
    mean, information = informed(values, len(prior), own, names)
    lag = rotor_lag(flights, vehicle, given)
    battery = exponent(flights, given)
    fine = [without_noise(flight, lag) for flight in flights]
    flights = [flight.coarser(STEP) for flight in fine]
    cells = [flight.coarser(CELL) for flight in flights]
    used = [np.ones(len(c.time), bool) if c.used is None else c.used for c in cells]
    blocks = [windows(cell, BLOCK) for cell in cells]
    if sum(len(np.unique(b[u & (b >= 0)])) for b, u in zip(blocks, used, strict=True)) < 10:
        raise ValueError(
            f"the flights have fewer than 10 blocks of {BLOCK:g} s in the air; expected at least 10"
        )
    whole, flying = [u & (b >= 0) for b, u in zip(blocks, used, strict=True)], used
    x, noise = prior * mean, (0.3, 0.03)
    slope: list[Array] = []
    for step in range(5):
        if step in DERIVED:
            slope = [_derivative(model, flight, k, x, prior) for k, flight in enumerate(flights)]
        left = [_raw(model, flight, k, x) for k, flight in enumerate(flights)]
        x = x - prior * _step(left, slope, used, noise, x / prior - mean, information)
        left = [_raw(model, flight, k, x) for k, flight in enumerate(flights)]
        noise = _noise(left, used)
        if step < 3:
            used = [u & _usual(r, b, w) for r, b, w, u in zip(left, blocks, whole, used, strict=True)]
    covariance = _covariance(left, slope, used, blocks, noise, information)
    period = [float(np.median(np.diff(c.time))) for c in cells]
    seconds = sum(p * int(u.sum()) for p, u in zip(period, used, strict=True))
    flown = sum(p * int(u.sum()) for p, u in zip(period, flying, strict=True))
    figures, correlation = _figures(model, x, covariance, (prior, information), given)
    figures = _aged(figures)
    found = model.at(x)
    return Identified(
        figures + lag + battery,
        correlation,
        corrected(vehicle, found, figures + lag),
        seconds,
        flown - seconds,
        noise,
        [found.predict(flight, k) for k, flight in enumerate(fine)],
    )


def _raw(model: Model, flight: Flight, number: int, x: Array) -> Array:
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


def _derivative(model: Model, flight: Flight, number: int, x: Array, prior: Array) -> Array:
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
    left: list[Array],
    slope: list[Array],
    used: list[Mask],
    noise: tuple[float, float],
    off: Array,
    information: Array,
) -> Array:
    """One Gauss-Newton step; `off`: parameters minus their means. Both are in prior deviations."""
    here, jacobian = _stacked(left, slope, used, noise)
    rows = jacobian.reshape(-1, len(off))
    step: Array = np.linalg.solve(rows.T @ rows + information, rows.T @ here.ravel() + information @ off)
    return step


def _covariance(
    left: list[Array],
    slope: list[Array],
    used: list[Mask],
    blocks: list[NDArray[np.int64]],
    noise: tuple[float, float],
    information: Array,
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
    inverse = np.linalg.inv(rows.T @ rows + information)
    # The parameters use up degrees of freedom of the residuals.
    taken = float(np.trace(inverse @ rows.T @ rows))
    spread = sums.T @ sums * count / max(count - taken / 6, 1)
    covariance: Array = inverse @ (spread + information) @ inverse
    return covariance


def _aged(figures: list[Figure]) -> list[Figure]:
    """The age of the rotor speeds is not learnt if a moment of inertia is not known.

    In a gentle flight the motors mostly follow the noise of the gyro: an age that is not there explains it.
    """
    if all(one.known for one in figures if one.name in MOMENTS):
        return figures
    return [
        replace(one, deviation=one.prior) if one.name == AGE and one.given is None else one for one in figures
    ]


def _value(given: Mapping[str, Prior], name: str) -> float | None:
    return given[name].value if name in given else None


def _figures(
    model: Model, x: Array, covariance: Array, prior: tuple[Array, Array], given: Mapping[str, Prior]
) -> tuple[list[Figure], Array]:
    """The figures, and their correlation. `prior`: deviations without priors, and information."""
    size, information = prior
    names, values = reported(model, x)
    gain = slopes(lambda z: reported(model, size * z)[1], x / size)
    spread = gain @ covariance @ gain.T
    deviation = np.sqrt(np.diag(spread))
    before = np.sqrt(np.diag(gain @ np.linalg.inv(information) @ gain.T))
    told = reported(model, np.zeros(len(x)))[1]
    figures = [
        Figure(name, unit, float(value), float(off), float(b), float(m), _value(given, name))
        for (name, unit), value, off, b, m in zip(names, values, deviation, before, told, strict=True)
    ]
    return figures, spread / np.outer(deviation, deviation)


__all__ = ["Figure", "Flight", "Identified", "Prior", "identify"]
