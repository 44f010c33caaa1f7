"""The ranges of the numbers in an experiment's file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

RANGES = {
    "world.friction": (0.0, 10.0, "a coefficient"),
    "world.size": (1e-3, 100.0, "m"),
    "world.height": (1e-4, 10.0, "m"),
    "world.sides": (3.0, 200.0, "flat sides of the cone"),
    "random.friction": (0.0, 10.0, "a coefficient"),
    "random.offset": (0.0, 1.0, "m"),
    "noise.pose_period": (1e-3, 10.0, "s"),
    "noise": (0.0, 1e3, "a standard deviation or a time"),
    "push.start": (0.0, 1e5, "s"),
    "push.end": (0.0, 1e5, "s"),
    "learn_bias": (0.0, 1e5, "s"),
    "trajectory.velocity": (1e-4, 10.0, "m/s"),
    "trajectory.acceleration": (1e-4, 100.0, "m/s^2"),
    "trajectory.waypoint.hold": (0.0, 1e5, "s"),
    "trajectory.waypoint.duration": (0.0, 1e5, "s"),
}
"""For the path of a key or of its table: smallest value, largest value, and meaning."""


def check(table: Mapping[str, Any], path: str = "") -> None:
    """Refuses a number that is not finite, or outside of the range of its key, in all tables."""
    for key, value in table.items():
        _check(f"{path}{key}", value)


def _check(path: str, value: Any) -> None:
    if isinstance(value, Mapping):
        check(value, f"{path}.")
    elif isinstance(value, (list, tuple)):
        for one in value:
            _check(path, one)
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        table = path.partition(".")[0]
        lowest, highest, unit = RANGES.get(path) or RANGES.get(table) or (-math.inf, math.inf, "")
        if not (math.isfinite(value) and lowest <= value <= highest):
            expected = f"from {lowest:g} to {highest:g}, {unit}" if unit else "that is finite"
            raise ValueError(f"{path} is {value}; expected a number {expected}")
