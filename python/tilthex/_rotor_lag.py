"""The rotors' lag and dead time, from commands and measured speeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np

from tilthex._core import Vehicle
from tilthex._identified import BLOCK, PRIOR, WINDOW, Array, Figure, Flight, Mask, centred, windows
from tilthex._priors import Prior

TRUSTED = 0.1
"""Time constant, s: the measured speed gives the slow part, the answer to the command the fast part."""


def answered(flight: Flight, lag: float, dead_time: float) -> Array:
    """The speeds that follow from the commands, Hz, (N, n); lag and dead time in s."""
    from scipy.signal import lfilter

    assert flight.rotor_command is not None
    step = float(np.median(np.diff(flight.time)))
    # A command acts from its own tick on, so that the speed in the same row is older by one step.
    late = flight.time - step - dead_time
    command = np.stack([np.interp(late, flight.time, c) for c in flight.rotor_command.T], axis=1)
    keep = float(np.exp(-step / max(lag, 1e-4)))
    speeds: Array = lfilter([1 - keep], [1, -keep], command, axis=0, zi=keep * flight.rotor_speeds[:1])[0]
    return speeds


def without_noise(flight: Flight, lag: Sequence[Figure]) -> Flight:
    """The flight with rotor speeds that are almost free of measurement noise.

    Noise of the speeds looks like a torque that the vehicle does not follow, so that it would seem
    heavier.
    """
    from scipy.ndimage import uniform_filter1d

    if not lag or flight.rotor_command is None:
        return flight
    speeds = answered(flight, lag[0].value, lag[1].value)
    width = max(1, round(TRUSTED / float(np.median(np.diff(flight.time)))))
    rest = uniform_filter1d(flight.rotor_speeds - speeds, width, axis=0, mode="nearest")
    return replace(flight, rotor_speeds=speeds + rest)


def lag_before(flights: Sequence[Flight], vehicle: Vehicle) -> list[Figure]:
    """Time constant and dead time before a flight; none if there are no commands, or the model has no lag."""
    start = vehicle.rotor_time_constant
    if start <= 0 or all(f.rotor_command is None for f in flights):
        return []
    prior = PRIOR["rotor_lag"] * start, PRIOR["dead_time"]
    names = ("rotor lag", start), ("dead time", 0.0)
    return [Figure(name, "s", m, p, p, m) for (name, m), p in zip(names, prior, strict=True)]


def rotor_lag(
    flights: Sequence[Flight], vehicle: Vehicle, given: Mapping[str, Prior] | None = None
) -> list[Figure]:
    """Time constant and dead time from command to measured speed, common to all rotors.

    Args:
        flights: The flights.
        vehicle: The model.
        given: What is known of the two before the flight.
    """
    from scipy.optimize import least_squares

    told = [
        (f, np.ones(len(f.time), bool) if f.used is None else f.used)
        for f in flights
        if f.rotor_command is not None
    ]
    before = lag_before(flights, vehicle)
    if not before:
        return []
    own = [(given or {}).get(one.name, Prior(one.model, one.prior)) for one in before]
    mean, prior = (np.array([getattr(one, part) for one in own]) for part in ("value", "deviation"))

    def left(x: Array, flight: Flight, mask: Mask) -> Array:
        # Changes that no command causes, as of a battery that discharges, are slow.
        off = flight.rotor_speeds - answered(flight, x[0], x[1])
        rows: Array = centred(off, windows(flight, WINDOW))[mask]
        return rows

    def stacked(x: Array) -> Array:
        return np.vstack([left(x, f, u) for f, u in told])

    first = stacked(mean)
    noise = 1.4826 * float(np.median(abs(first))) + 1e-9

    def residual(z: Array, noise: float) -> Array:
        x = mean + prior * z
        rows: Array = np.r_[stacked(x).ravel() / noise, z]
        return rows

    def loss(squares: Array) -> Array:
        """`soft_l1`, but what is known before the flight is no outlier."""
        root = np.sqrt(1 + squares)
        rho = np.stack([2 * (root - 1), 1 / root, -0.5 / root**3])
        rho[:, -2:] = [squares[-2:], [1.0, 1.0], [0.0, 0.0]]
        return rho

    z = np.zeros(2)
    for _ in range(2):
        found = least_squares(residual, z, args=(noise,), loss=cast(Any, loss))
        z = found.x
        noise = 1.4826 * float(np.median(abs(stacked(mean + prior * z)))) + 1e-9
    jacobian = np.stack(
        [(residual(z + e, noise) - residual(z - e, noise)) / 0.02 for e in 0.01 * np.eye(2)], axis=1
    )
    rows, plain = residual(z, noise)[:-2], jacobian[:-2]
    n = told[0][0].rotor_speeds.shape[1]
    number = np.repeat(
        np.concatenate([windows(f, BLOCK)[u] + 10_000 * k for k, (f, u) in enumerate(told)]), n
    )
    number = np.unique(number, return_inverse=True)[1]
    sums = np.stack([np.bincount(number, plain[:, k] * rows) for k in range(2)], axis=1)
    inverse = np.linalg.inv(plain.T @ plain + np.eye(2))
    spread = inverse @ (sums.T @ sums + np.eye(2)) @ inverse
    values, deviation = mean + prior * z, prior * np.sqrt(np.diag(spread))
    return [
        replace(
            one,
            value=float(v),
            deviation=float(d),
            prior=float(p.deviation),
            given=p.value if one.name in (given or {}) else None,
        )
        for one, v, d, p in zip(before, values, deviation, own, strict=True)
    ]
