"""Named columns of a recording: the usual names of quantities, and their units."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SECOND = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_DEGREE = np.pi / 180
_RATE = {"rad/s": 1.0, "rads^-1": 1.0, "deg/s": _DEGREE, "degs^-1": _DEGREE, "dps": _DEGREE, "°/s": _DEGREE}
_ACCELERATION = {"m/s^2": 1.0, "m/s2": 1.0, "m/s²": 1.0, "ms^-2": 1.0, "g": 9.80665, "mg": 9.80665e-3}
_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_FORCE = {"n": 1.0, "kn": 1e3, "lbf": 4.4482216152605}
_TORQUE = {"nm": 1.0, "n*m": 1.0, "nmm": 1e-3, "n*mm": 1e-3}
_NONE = {"": 1.0, "-": 1.0}
SINCE_1970 = 1e17
"""A time above this is in nanoseconds, as `#timestamp` of EuRoC."""


@dataclass(frozen=True)
class Quantity:
    """A quantity that a column may hold.

    Its units with the factor to ours, its names before the axis, and its axes.
    """

    units: Mapping[str, float]
    stems: tuple[str, ...]
    axes: tuple[str, ...]


_POSE = ("pose", "pose_pose", "transform", "vicon", "mocap", "opt", "body", "rigid_body")
QUANTITIES = {
    "time": Quantity(
        _SECOND, ("time", "t", "timestamp", "stamp", "imu_time", "pose_time", "log_time"), ("",)
    ),
    "arrival": Quantity(_SECOND, ("arrival", "arrival_time", "pose_arrival_time"), ("",)),
    "gyro": Quantity(
        _RATE,
        ("gyro", "gyr", "gyroscope", "angular_velocity", "omega", "w", "w_rs_s", "imu_gyr", "imu_gyro"),
        ("x", "y", "z"),
    ),
    "force": Quantity(
        _ACCELERATION,
        (
            *(
                "force",
                "specific_force",
                "acc",
                "accel",
                "acceleration",
                "accelerometer",
                "linear_acceleration",
            ),
            *("a", "a_rs_s", "imu_acc", "imu_accel"),
        ),
        ("x", "y", "z"),
    ),
    "position": Quantity(
        _LENGTH,
        (
            *("position", "pos", "p", "p_rs_r", "translation", "", "t"),
            *(f"{of}_{what}" for of in _POSE for what in ("position", "pos", "translation")),
        ),
        ("x", "y", "z"),
    ),
    "quaternion": Quantity(
        _NONE,
        (
            *("quaternion", "quat", "q", "q_rs", "orientation", "rotation"),
            *(f"{of}_{what}" for of in _POSE for what in ("orientation", "rotation", "quaternion", "quat")),
        ),
        ("x", "y", "z", "w"),
    ),
    "rotation": Quantity(_NONE, ("rotation", "r", "rot"), tuple(f"{i}{j}" for i in "123" for j in "123")),
    "sensor_force": Quantity(
        _FORCE, ("f", "force", "wrench_force", "ft_force", "sensor_force"), ("x", "y", "z")
    ),
    "sensor_torque": Quantity(
        _TORQUE,
        ("t", "torque", "m", "moment", "wrench_torque", "ft_torque", "sensor_torque"),
        ("x", "y", "z"),
    ),
}
"""Quantities by our name for them."""


@dataclass(frozen=True)
class Stream:
    """Rows of named columns from one place: a table, a topic, a variable.

    `place` is its name, `row` names its rows (such as "line 5"). `columns` are (n,) each, with the names
    and in the units of the file. A unit may be part of the name: `gyro_x [deg/s]`, `time_ns`. NaN stands
    for a missing value.
    """

    place: str
    columns: dict[str, Array]
    rows: tuple[str, int] = ("row", 1)
    """The word for a row, and the number of the first."""

    def row(self, index: int) -> str:
        """The name by which a user of the file finds a row."""
        word, first = self.rows
        return f"{word} {first + index}"

    def find(self, quantity: str) -> dict[str, Array]:
        """The columns of a quantity in our units, by axis, for the name that has most axes.

        Raises:
            ValueError: The unit is not a unit of this quantity.
        """
        kind = QUANTITIES[quantity]
        plain = {name: split_unit(name, kind.units) for name in self.columns}
        found: dict[str, str] = {}
        for stem in kind.stems:
            spelled = {
                axis: name
                for axis in kind.axes
                for name, (text, _) in plain.items()
                if text in (f"{stem}_{axis}".strip("_"), stem + axis)
            }
            if len(spelled) > len(found):
                found = spelled
        return {
            axis: self.columns[name] * self._factor(name, plain[name][1], kind)
            for axis, name in found.items()
        }

    def _since_1970(self, name: str) -> bool:
        """Whether a time is in nanoseconds since 1970, which no other unit can be."""
        values = self.columns[name]
        return bool(np.isfinite(values).any() and np.nanmin(values) > SINCE_1970)

    def _factor(self, name: str, unit: str, kind: Quantity) -> float:
        if unit in kind.units:
            return kind.units[unit]
        if not unit:
            return 1e-9 if kind.units is _SECOND and self._since_1970(name) else 1.0
        expected = ", ".join(filter(None, kind.units)) or "no unit"
        raise ValueError(f"{self.place}: the column '{name}' has the unit '{unit}'; expected {expected}")


def split_unit(name: str, units: Mapping[str, float]) -> tuple[str, str]:
    """A column's plain name and its unit: in brackets, as an ending (`time_ns`), or empty."""
    text, _, rest = name.strip().lstrip("#").strip().lower().partition("[")
    if not rest:
        text, _, rest = text.partition("(")
    unit = re.sub(r"[\s\])]", "", rest)
    plain = re.sub(r"[^a-z0-9]+", "_", text).strip("_")
    if not unit:
        for ending in units:
            tail = re.sub(r"[^a-z0-9]+", "_", ending)
            if tail and plain.endswith("_" + tail):
                return plain.removesuffix("_" + tail), ending
    return plain, unit
