"""What a user knows of a vehicle's figures before a flight, as numbers with standard deviations."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tilthex._identified import Array, Figure

FORM = "NAME=VALUE+-DEVIATION, for example mass=2.41+-0.005"
POSITIVE = re.compile(r"mass|thrust|drag moment|inertia (xx|yy|zz)|rotor lag")
"""Figures that are above 0; a prior of one of them is within `FACTOR` of the model's value."""
NOT_NEGATIVE = re.compile(r"rotor drag|dead time|throttle exponent")
FACTOR = 5.0
FARTHEST = 20.0
"""A prior of another figure is within this many of the deviations before the flight."""
DEVIATION = 1e-5, 1e3
"""Range of the deviation of a prior, in deviations before the flight; others leave no digits."""
CORRECTIONS = 20
"""Steps to the mean of figures that are not linear in the parameters."""
STEP = 1e-3
"""Step of the derivatives, in deviations before the flight."""


@dataclass(frozen=True)
class Prior:
    """A value with its standard deviation, in the unit of the figure; `unit` is as the user named it."""

    value: float
    deviation: float
    unit: str = ""


def parse(text: str) -> tuple[str, Prior]:
    """The name and the prior in `NAME=VALUE+-DEVIATION [UNIT]`.

    Raises:
        ValueError: The text has another form.
    """
    found = re.fullmatch(r"([^=]+)=(.+?)(?:\+-|±)\s*([^\s]+)\s*(.*)", text.strip())
    try:
        if found is None:
            raise ValueError
        name, value, deviation, unit = found.groups()
        return name.strip(), Prior(float(value), float(deviation), unit)
    except ValueError:
        raise ValueError(f"--prior is {text!r}; expected {FORM}") from None


def key(name: str) -> str:
    """A name without what is hard to type: `thrust, rotor 1` is `thrust_rotor_1`."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def checked(priors: Mapping[str, Prior], before: Sequence[Figure]) -> dict[str, Prior]:
    """The priors by the names of the figures.

    Args:
        priors: By names, or by what `key` makes of them.
        before: The figures before the flight, those of the model.

    Raises:
        ValueError: A name is unknown, or a number is impossible or probably in another unit.
    """
    figures = {key(one.name): one for one in before}
    found: dict[str, Prior] = {}
    for name, prior in priors.items():
        one = figures.get(key(name))
        if one is None:
            raise ValueError(f"prior: no figure is named {name!r}; expected one of {', '.join(figures)}")
        if one.name in found:
            raise ValueError(f"prior: {one.name} is given twice; expected one prior for each figure")
        found[one.name] = prior
        if prior.unit not in ("", one.unit):
            raise ValueError(f"prior: {one.name} is given in {prior.unit}; expected {one.unit}")
        least, most = (part * one.prior for part in DEVIATION)
        if not least <= prior.deviation <= most:
            raise ValueError(
                f"prior: the deviation of {one.name} is {prior.deviation:g}; expected {least:.2g} to "
                f"{most:.2g} {one.unit}"
            )
        if POSITIVE.match(one.name):
            low, high = one.model / FACTOR, one.model * FACTOR
        else:
            low, high = (one.model + side * FARTHEST * one.prior for side in (-1, 1))
            low = max(low, 0.0) if NOT_NEGATIVE.match(one.name) else low
        if not low <= prior.value <= high:
            raise ValueError(
                f"prior: {one.name} is {prior.value:g}, that of the model {one.model:.4g} {one.unit}; "
                f"expected {low:.3g} to {high:.3g} {one.unit}"
            )
    return found


def informed(
    values: Callable[[Array], Array], size: int, given: Mapping[str, Prior], names: Sequence[str]
) -> tuple[Array, Array]:
    """Means (k,) and information matrix (k, k) of parameters whose deviations are 1 without priors.

    The distribution of the given figures becomes that of the priors. What is known of the other parameters
    for given values of these figures stays (Jeffrey's rule).

    Args:
        values: All figures of the parameters.
        size: Number of the parameters, k.
        given: The priors by names of figures.
        names: The names of the figures.

    Raises:
        ValueError: Some of the given figures follow from the others.
    """
    mean, information = np.zeros(size), np.eye(size)
    if not given:
        return mean, information
    rows = [names.index(name) for name in given]
    target = np.array([one.value for one in given.values()])
    deviation = np.array([one.deviation for one in given.values()])
    for _ in range(CORRECTIONS):
        slope = slopes(values, mean)[rows]
        if np.linalg.matrix_rank(slope / np.linalg.norm(slope, axis=1, keepdims=True), tol=1e-6) < len(rows):
            raise ValueError(f"prior: of {', '.join(given)}, one follows from the others; leave one out")
        spread = slope @ slope.T
        mean = slope.T @ np.linalg.solve(spread, target - values(mean)[rows] + slope @ mean)
    information += slope.T @ (np.diag(deviation**-2) - np.linalg.inv(spread)) @ slope
    return mean, information


def slopes(values: Callable[[Array], Array], at: Array) -> Array:
    """Derivatives of all figures by the parameters, (figures, k)."""
    columns = [(values(at + e) - values(at - e)) / (2 * STEP) for e in STEP * np.eye(len(at))]
    found: Array = np.stack(columns, axis=1)
    return found
