"""The noises of a recording: those with which the innovations of the filter are most likely.

The innovations have Student's t-distribution, so that a few outliers do not count as noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex import _core
from tilthex.calibration import SETTLE
from tilthex.recording import Recording

Array = NDArray[np.float64]

BOUNDS = {
    "position_noise": (1e-4, 0.1),
    "rotation_noise_deg": (0.02, 10.0),
    "gyro_noise": (1e-5, 0.1),
    "accelerometer_noise": (1e-4, 1.0),
}
"""The keys of `[estimator]` that are found, each with the bounds of the search.

The lower bounds keep poses from being trusted too much.
"""
FREEDOM = 5.0
"""Degrees of freedom of the t-distribution."""
SCALE = 0.8566
"""Scale of the distribution. With it, the most likely deviation of normal innovations is their own."""
COARSE, FINE, CURVED = float(np.log(3.0)), 0.3, 0.1
"""First steps of the search, and the step of the curvature, in natural logarithms."""
UNKNOWN = 3.0
"""Largest deviation; the recording does not determine a noise that has it."""
FEWEST = 100
"""Fewest poses of a recording whose noises are searched."""


@dataclass(frozen=True)
class Noises:
    """The noises of a recording, by their keys in `[estimator]`, in the units of the keys.

    `deviation` holds the standard deviation of the natural logarithm of each value: 0.1 is 10 percent.
    """

    values: dict[str, float]
    deviation: dict[str, float]

    def config(self, config: _core.Config) -> _core.Config:
        """A configuration with these noises."""
        return config.replace(estimator=self.values)

    def __str__(self) -> str:
        """The keys of a configuration, with the deviations as comments."""
        return "\n".join(f"{key} = {value:.4g}  # {self._remark(key)}" for key, value in self.values.items())

    def _remark(self, key: str) -> str:
        if np.isclose(self.values[key], BOUNDS[key]).any():
            return "at the bound of the search"
        if self.deviation[key] >= UNKNOWN:
            return "not determined by this recording"
        return f"within a factor of {np.exp(self.deviation[key]):.2f} (standard deviation)"


def find_noises(recording: Recording, config: _core.Config, *, settle: float = SETTLE) -> Noises:
    """Finds the noises of poses and inertial samples by maximum likelihood.

    Args:
        recording: A flight, the longer the better; the vehicle must turn and move.
        config: The configuration, with the place of the captured body and the latency; its noises are
            where the search begins.
        settle: Innovations before this time do not count, s.

    Returns:
        The noises. The deviation of each is the larger one of two: from the curvature of the likelihood,
        and from the difference between the two halves of the recording.

    Raises:
        ValueError: The recording has too few poses.
    """
    recording = recording.tracked()
    time = recording.pose_time
    if len(time) < FEWEST:
        raise ValueError(f"the recording has {len(time)} poses; expected {FEWEST} or more to find noises")
    config = config.replace(estimator={"gate_probability": 1.0})
    keys = config.to_dict()["estimator"]
    counts = time > time[0] + settle
    search = _Search(recording, config)
    configured = np.log([np.clip(float(keys[key]), *bounds) for key, bounds in BOUNDS.items()])
    best = search.most_likely(counts, configured, COARSE)
    later = time >= 0.5 * (time[0] + time[-1])
    first, second = (search.most_likely(half, best, FINE) for half in (counts & ~later, counts & later))
    deviation = np.maximum(search.deviation(counts, best), np.abs(first - second) / 2)
    return Noises(search.values(best), dict(zip(BOUNDS, deviation.tolist(), strict=True)))


class _Search:
    """The search for the noises of a recording, in natural logarithms."""

    def __init__(self, recording: Recording, config: _core.Config) -> None:
        self._recording = recording
        self._config = config
        self._low, self._high = np.array(list(BOUNDS.values())).T

    def values(self, logarithms: Array) -> dict[str, float]:
        """The noises, within their bounds."""
        inside = np.clip(np.exp(logarithms), self._low, self._high)
        return dict(zip(BOUNDS, inside.tolist(), strict=True))

    def most_likely(self, counts: NDArray[np.bool_], start: Array, step: float) -> Array:
        """The most likely noises by the innovations that count; the search begins with a step."""
        from scipy.optimize import minimize

        def cost(logarithms: Array) -> float:
            return self._cost(counts, logarithms)

        found: Any = minimize(
            cost,
            start,
            method="Nelder-Mead",
            options={
                "initial_simplex": np.vstack([start, start + step * np.eye(len(start))]),
                "xatol": 0.02,
                "fatol": 0.5,
                "maxfev": 300,
            },
        )
        best: Array = np.log(list(self.values(found.x).values()))
        return best

    def deviation(self, counts: NDArray[np.bool_], best: Array) -> Array:
        """Standard deviations from the curvature of the likelihood."""
        least = self._cost(counts, best)
        curvature = np.array(
            [
                (self._cost(counts, best + h) - 2 * least + self._cost(counts, best - h)) / CURVED**2
                for h in CURVED * np.eye(len(best))
            ]
        )
        deviation: Array = 1 / np.sqrt(np.maximum(curvature, UNKNOWN**-2))
        return deviation

    def _cost(self, counts: NDArray[np.bool_], logarithms: Array) -> float:
        """The negative logarithm of the likelihood."""
        ukf = _core.Ukf(self._config.replace(estimator=self.values(logarithms)))
        run = self._recording.estimate(ukf)
        deviation = run.innovation_deviation[counts]
        squares = (run.innovation[counts] / (SCALE * deviation)) ** 2
        each = np.log(deviation) + 0.5 * (FREEDOM + 1) * np.log1p(squares / FREEDOM)
        return float(np.nan_to_num(each, nan=1e3).sum())
