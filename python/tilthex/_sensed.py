"""The two wrenches that `tilthex compare` compares: that of a log, and that of an external sensor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tilthex import log, readers
from tilthex._core import Config
from tilthex.readers.columns import QUANTITIES, Stream

Array = NDArray[np.float64]

SETTLES = 0.5
"""The observed wrench and the low-pass follow a new bias in this time, s."""


@dataclass(frozen=True)
class Wrenches:
    """`time` s, (n,); `wrench` (n, 6): force in N, torque in N m. The axes depend on the use."""

    time: Array
    wrench: Array
    learnt: float = 0.0
    """Before this time since the first row, s, the observer's bias was not known."""


@dataclass(frozen=True)
class ToolPath:
    """The motion of the tool.

    `time` s (n,), `position` of its tip, m, world (n, 3), `rotation` to world (n, 3, 3).
    """

    time: Array
    position: Array
    rotation: Array


def observed(path: str | Path) -> tuple[Wrenches, ToolPath]:
    """The observed wrench of a flight in the air: on the robot, about the tip of the tool, world axes.

    Take-off and landing are left out, because the ground exerts a wrench there.
    """
    from scipy.spatial.transform import Rotation

    flight = log.Log(path)
    config = Config.from_text(flight.configuration)
    vehicle = config.vehicle
    wrench, state, phases = (flight.columns(topic) for topic in ("/wrench", "/state", "/flight"))
    rotation = Rotation.from_quat(state["orientation"])
    tool = rotation * Rotation.from_matrix(vehicle.tool_rotation)
    tip = state["position_w"] + rotation.apply(vehicle.tool_position)
    aloft = np.isin(phases["phase"], log.FREE_FLIGHT)
    count = min(len(tip), len(aloft), len(wrench["log_time"]))
    keep = np.flatnonzero(aloft[:count])
    if len(keep) < 2:
        raise ValueError(f"{path}: the vehicle does not fly in this log; expected a flight with contact")
    parts = [wrench[f"tool_w.{part}"][keep] for part in ("force", "torque")]
    time = state["log_time"][keep]
    learnt = log.learning_ends(flight, config.to_dict()["mission"]["bias_time"])
    return Wrenches(time, np.hstack(parts), learnt + SETTLES - time[0]), ToolPath(
        time, tip[keep], tool[keep].as_matrix()
    )


def read_sensor(path: str | Path, topic: str | None = None) -> Stream:
    """Reads a sensor's table or topic: `time`, force and torque, by their usual names.

    docs/recordings.md lists the names.

    Raises:
        ValueError: There is no sensor, or more than one.
    """
    streams = readers.read(Path(path))
    if topic is not None:
        streams = [stream for stream in streams if stream.place.endswith(topic)]
    whole = [
        s
        for s in streams
        if len(s.find("sensor_force")) == len(s.find("sensor_torque")) == 3 and s.find("time")
    ]
    if len(whole) != 1:
        found = "none" if not whole else ", ".join(stream.place for stream in whole)
        raise ValueError(
            f"{path}: expected one sensor with time, force_x, force_y, force_z, torque_x, torque_y and "
            f"torque_z; found {found}" + (": name one with --topic" if whole else "")
        )
    return whole[0]


def sensed(stream: Stream) -> Wrenches:
    """The readings of the sensor: on its clock, in its axes, torque about its origin."""
    parts = [stream.find("time")[""]]
    for quantity in ("sensor_force", "sensor_torque"):
        columns = stream.find(quantity)
        parts += [columns[axis] for axis in QUANTITIES[quantity].axes]
    rows = np.column_stack(parts)
    rows = rows[np.isfinite(rows).all(axis=1)]
    rows = rows[np.unique(rows[:, 0], return_index=True)[1]]
    if len(rows) < 10:
        raise ValueError(f"{stream.place} holds {len(rows)} readings; expected at least 10")
    step = float(np.median(np.diff(rows[:, 0])))
    if step > 0.1:
        raise ValueError(
            f"{stream.place}: the time rises by {step:.4g} each reading; expected seconds, 10 Hz at least: "
            "say another unit in the column's name, such as 'time [ns]'"
        )
    return Wrenches(rows[:, 0], rows[:, 1:])
