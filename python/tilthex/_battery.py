"""How the speed of a rotor at a throttle depends on the battery's voltage, in flights of a vehicle with PX4.

speed = x(throttle) (voltage / nominal)^k, with the map x and the nominal voltage of the vehicle's `[link]`.
The logarithms of speed, x and voltage, as means over `MEAN`, give k by least squares. Found with it: a factor
of each rotor with each map, an error of the map's slope, and a change of all motors by `DRIFT` from flight to
flight and within each flight, as when they warm up. So a voltage that hardly moves tells nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tilthex._identified import PRIOR, Array, Figure, Flight, windows
from tilthex._priors import Prior

NAME = "throttle exponent"
MEAN = 5.0
"""Length of the means, s: the voltage is measured about once in a second."""
SLOPE = 0.1
"""Standard deviation of the logarithm's slope of the map."""
DRIFT = 0.002
"""Standard deviation of a motor's slow change, as a part of its speed."""
APART = 10.0
"""Residuals that are further apart than this count as independent, s: motors warm up slowly."""


def speeds_of(throttle: Array, coefficients: Sequence[float]) -> Array:
    """The speeds, Hz, that the map of a link gives for throttles at its voltage; NaN where it does not."""
    c0, c1, c2 = coefficients
    above = np.where((throttle > 0.0) & (throttle < 1.0), throttle - c0, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        found = above / c1 if c2 == 0.0 else (np.sqrt(c1 * c1 + 4 * c2 * above) - c1) / (2 * c2)
    return np.asarray(np.where(found > 0.0, found, np.nan))


def exponent_before(flights: Sequence[Flight]) -> list[Figure]:
    """The exponent before a flight; none if no log has throttles."""
    told = [one for one in flights if one.mapped_speeds is not None]
    if not told:
        return []
    off = PRIOR["throttle_exponent"]
    return [Figure(NAME, "1", told[0].exponent, off, off, told[0].exponent)]


def exponent(flights: Sequence[Flight], given: Mapping[str, Prior] | None = None) -> list[Figure]:
    """The exponent k, common to all rotors and flights; none if no log has throttles.

    It stays as it was before the flights if no mean is whole.
    """
    before = exponent_before(flights)
    if not before:
        return []
    one = before[0]
    prior = (given or {}).get(NAME, Prior(one.model, one.prior))
    known = prior.value if NAME in (given or {}) else None
    told = [(_blocks(flight), flight.throttle_map) for flight in flights if flight.mapped_speeds is not None]
    rows = [row for row, _ in told if len(row[3])]
    if not rows:
        return [Figure(NAME, "1", prior.value, prior.deviation, prior.deviation, one.model, known)]
    speed, mapped, volts = (np.vstack([row[k] for row in rows]) for k in range(3))
    number = np.concatenate([1_000_000 * k + np.floor(row[3] / APART) for k, row in enumerate(rows)])
    # A factor of each rotor is free, and another one for another map: their means are taken away.
    maps = [one for row, one in told for _ in row[3]]
    left, slope, power = (_without_means(each, maps) for each in (speed - mapped, mapped, volts))
    columns = [power, slope]
    drifts = _without_means(_drifts([row[3] for row in rows]), maps)
    columns += [np.repeat(one[:, None], left.shape[1], axis=1) for one in drifts.T]
    design = np.stack(columns, axis=2)
    sizes = np.r_[prior.deviation, SLOPE, [DRIFT] * (len(columns) - 2)]
    start, information = np.zeros(len(sizes)), np.diag(sizes**-2)
    start[0] = prior.value
    found, noise = start, 0.01
    for _ in range(5):
        normal = np.einsum("bik,bil->kl", design, design) / noise**2 + information
        score = np.einsum("bik,bi->k", design, left - design @ found) / noise**2
        found = found + np.linalg.solve(normal, score + information @ (start - found))
        noise = max(1.4826 * float(np.median(abs(left - design @ found))), 1e-6)
    inverse = np.linalg.inv(np.einsum("bik,bil->kl", design, design) / noise**2 + information)
    groups = np.unique(number, return_inverse=True)[1]
    sums = np.zeros((groups.max() + 1, len(sizes)))
    np.add.at(sums, groups, np.einsum("bik,bi->bk", design, left - design @ found) / noise**2)
    spread = sums.T @ sums * len(sums) / max(len(sums) - 2, 1)
    # A few groups may be alike by chance.
    covariance = np.maximum(np.diag(inverse @ (spread + information) @ inverse), np.diag(inverse))
    deviation = np.sqrt(covariance)
    return [Figure(NAME, "1", float(found[0]), float(deviation[0]), prior.deviation, one.model, known)]


def _without_means(values: Array, maps: Sequence[tuple[float, ...]]) -> Array:
    """The columns minus their means over the rows with the same map."""
    left: Array = values.copy()
    for one in set(maps):
        same = np.array([each == one for each in maps])
        left[same] -= values[same].mean(axis=0)
    return left


def _drifts(times: Sequence[Array]) -> Array:
    """A step for each flight in the rows of its blocks, and a slope in time that deviates by 1, (m, 2 f)."""
    flight = np.repeat(np.arange(len(times)), [len(time) for time in times])
    slopes = [(time - time.mean()) / max(float(time.std()), 1e-9) for time in times]
    own = flight[:, None] == np.arange(len(times))
    return np.hstack([own.astype(float), own * np.concatenate(slopes)[:, None]])


def _blocks(flight: Flight) -> tuple[Array, Array, Array, Array]:
    """Means over whole blocks of the logarithms of speed, mapped speed and voltage, (m, n), and times."""
    assert flight.mapped_speeds is not None and flight.voltage is not None
    with np.errstate(invalid="ignore", divide="ignore"):
        volts = np.repeat(np.log(flight.voltage)[:, None], flight.rotor_speeds.shape[1], axis=1)
        columns = np.log(flight.rotor_speeds), np.log(flight.mapped_speeds), volts
    fine = np.isfinite(np.hstack(columns)).all(axis=1)
    fine &= flight.used if flight.used is not None else True
    block = windows(flight, MEAN)
    inside = block >= 0
    count = int(block.max(initial=-1)) + 1
    samples = np.bincount(block[inside], minlength=count)
    whole = (np.bincount(block[inside & fine], minlength=count) == samples) & (samples > 0)
    kept = inside & whole[np.maximum(block, 0)] if count else np.zeros(len(block), bool)
    number = np.unique(block[kept], return_inverse=True)[1]

    def mean(values: Array) -> Array:
        sums = [np.bincount(number, column[kept]) / np.bincount(number) for column in values.T]
        return np.stack(sums, axis=1)

    return (
        mean(columns[0]),
        mean(columns[1]),
        mean(columns[2]),
        MEAN * np.flatnonzero(whole).astype(np.float64),
    )
