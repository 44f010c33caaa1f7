"""The way-points of an experiment's file, and their checks."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Vector = NDArray[np.float64]

NUMBERS = {
    "position": (3, "m"),
    "rpy_deg": (3, "degrees"),
    "wrench": (6, "N and N m"),
}
"""Keys with several numbers: how many, and their unit."""
TIMES = ("duration", "hold")
"""Keys with a number of seconds."""
KEYS = {"phase", "force_axes", *NUMBERS, *TIMES}


@dataclass(frozen=True)
class Waypoint:
    """A tool pose that is reached and left at rest.

    Also the duration of the motion to it, and the time of the stay.
    """

    phase: str
    position: tuple[float, ...]
    rpy_deg: tuple[float, ...]
    duration: float
    hold: float
    wrench: tuple[float, ...]
    force_axes: tuple[str, ...] = ()
    """Axes of the tool along which the wrench is controlled instead of the pose, until the next point."""

    @property
    def rotation(self) -> Vector:
        """Orientation of the tool, tool to world."""
        return np.asarray(Rotation.from_euler("xyz", self.rpy_deg, degrees=True).as_matrix())


def read(items: Sequence[dict[str, Any]]) -> tuple[Waypoint, ...]:
    """The way-points of the tables `[[trajectory.waypoint]]`.

    Pose, wrench, force axes and phase are those of the way-point before unless given; times are not.

    Raises:
        ValueError: There is none, or one has an unknown key or a wrong value; with its number, from 1.
    """
    made: list[Waypoint] = []
    last: dict[str, Any] = {"rpy_deg": (0.0, 0.0, 0.0), "wrench": (0.0,) * 6, "force_axes": ()}
    for number, item in enumerate(items, 1):
        where = f"[[trajectory.waypoint]] {number}"
        _check(where, item)
        last = last | {"duration": 0.0, "hold": 0.0} | item
        if "position" not in last or "phase" not in last:
            raise ValueError(f"{where}: the first one needs `position` (3 numbers, m) and `phase`")
        tuples = {key: tuple(map(float, last[key])) for key in NUMBERS}
        times: dict[str, Any] = {key: last[key] for key in TIMES}
        made.append(Waypoint(last["phase"], force_axes=tuple(last["force_axes"]), **times | tuples))
    if not made:
        raise ValueError("[trajectory] has no [[trajectory.waypoint]]; it needs at least one")
    return tuple(made)


def check_number(where: str, key: str, value: Any, unit: str) -> None:
    """Refuses what is not a finite number."""
    if not _is_number(value):
        raise ValueError(f"{where}: {key} is {value!r}; expected a number, in {unit}")


def check_numbers(where: str, key: str, value: Any, count: int, unit: str) -> None:
    """Refuses what is not a list of so many finite numbers."""
    if not isinstance(value, (list, tuple)) or len(value) != count or not all(map(_is_number, value)):
        raise ValueError(f"{where}: {key} is {value!r}; expected {count} numbers, in {unit}")


def check_keys(where: str, table: Any, known: set[str]) -> None:
    """Refuses what is no table, and a key that is not known."""
    if not isinstance(table, Mapping):
        raise ValueError(f"{where} is {table!r}; expected a table of keys")
    for key in table:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1, cutoff=0.0)
            raise ValueError(f"{where}: unknown key `{key}`; the nearest known one is `{near[0]}`")


def _check(where: str, item: dict[str, Any]) -> None:
    check_keys(where, item, KEYS)
    for key, value in item.items():
        if key in NUMBERS:
            check_numbers(where, key, value, *NUMBERS[key])
        elif key in TIMES:
            check_number(where, key, value, "s")
        elif key == "phase" and not isinstance(value, str):
            raise ValueError(f"{where}: phase is {value!r}; expected a text, the name of the phase")
        elif key == "force_axes" and not (
            isinstance(value, (list, tuple)) and all(isinstance(one, str) for one in value)
        ):
            raise ValueError(f'{where}: force_axes is {value!r}; expected a list of axes, such as ["z"]')


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
