"""A log for Rerun: the vehicle, its tool's poses and wrench in 3-D, and plots, in one .rrd file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tilthex._quaternions import quaternion_from_rotation
from tilthex.log import Log
from tilthex.view.geometry import cylinders
from tilthex.view.looks import FORCE, FORCE_LENGTH, TORQUE, TORQUE_LENGTH
from tilthex.view.sample import Flown, tool_pose

AXIS = 0.1
"""Length of the axes of a frame, m."""


def write(log: Log, out: Path) -> None:
    """Writes `flight.rrd` into a new folder.

    Raises:
        ImportError: Rerun is not installed.
    """
    try:
        import rerun as rr
    except ImportError as error:
        raise ImportError("Rerun is not installed: pip install 'tilthex[rerun]'") from error

    flown = Flown(log)
    out.mkdir(parents=True)
    stream = rr.RecordingStream("tilthex")
    stream.save(out / "flight.rrd")
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    shapes = cylinders(flown.config.vehicle)
    stream.log(
        "world/robot/shape",
        rr.Cylinders3D(
            lengths=[shape.length for shape in shapes],
            radii=[shape.radius for shape in shapes],
            centers=[shape.centre for shape in shapes],
            quaternions=[quaternion_from_rotation(shape.rotation) for shape in shapes],
            colors=[(*shape.colour, round(255 * shape.opacity)) for shape in shapes],
            fill_mode="solid",
        ),
        static=True,
    )
    Columns(rr, stream, flown).send()
    stream.disconnect()


class Columns:
    """The flight's columns on two time lines: `log_time`, and `flight` from the start of the flight."""

    def __init__(self, rr: Any, stream: Any, flown: Flown) -> None:
        self._rr, self._stream, self._flown = rr, stream, flown
        self._times = [
            rr.TimeColumn("log_time", timestamp=np.array(flown.stamps).astype("datetime64[ns]")),
            rr.TimeColumn("flight", duration=flown.times),
        ]

    def send(self) -> None:
        """Sends all columns."""
        samples = [self._flown.sample(row) for row in range(len(self._flown.times))]
        config = self._flown.config
        self._poses("robot", [sample.robot for sample in samples])
        self._poses("setpoint", [sample.setpoint for sample in samples])
        self._poses("reference", [sample.reference for sample in samples])
        tips = [tool_pose(sample.robot, config).position for sample in samples]
        self._arrows("force", tips, [FORCE_LENGTH * sample.force for sample in samples], FORCE)
        self._arrows("torque", tips, [TORQUE_LENGTH * sample.torque for sample in samples], TORQUE)
        vectors = {
            "setpoint_position": [sample.setpoint.position for sample in samples],
            "reference_position": [sample.reference.position for sample in samples],
            "position_error": [sample.position_error for sample in samples],
            "tool_force": [sample.force for sample in samples],
            "tool_torque": [sample.torque for sample in samples],
        }
        for name, rows in vectors.items():
            for axis, values in zip("xyz", np.array(rows).T, strict=True):
                self._scalars(f"plots/{name}/{axis}", values)
        for rotor, values in enumerate(np.array([sample.rotor_speeds for sample in samples]).T, 1):
            self._scalars(f"plots/rotor_speed/{rotor}", values)
        for at, what in self._flown.events():
            self._stream.set_time("flight", duration=at)
            row = int(np.searchsorted(self._flown.times, at))
            self._stream.set_time("log_time", timestamp=self._flown.stamps[row] * 1e-9)
            self._stream.log("events", self._rr.TextLog(what))

    def _poses(self, name: str, poses: list[Any]) -> None:
        transform = self._rr.Transform3D
        self._columns(
            f"world/{name}",
            transform.columns(
                translation=[pose.position for pose in poses],
                quaternion=[quaternion_from_rotation(pose.rotation) for pose in poses],
            ),
        )
        self._stream.log(f"world/{name}", self._rr.TransformAxes3D(AXIS), static=True)

    def _arrows(self, name: str, begins: list[Any], vectors: list[Any], colour: tuple[int, int, int]) -> None:
        arrows = self._rr.Arrows3D
        self._columns(f"world/{name}", arrows.columns(origins=begins, vectors=vectors))
        self._stream.log(f"world/{name}", arrows.from_fields(colors=[colour], radii=[0.008]), static=True)

    def _scalars(self, path: str, values: Any) -> None:
        self._columns(path, self._rr.Scalars.columns(scalars=values))

    def _columns(self, path: str, columns: Any) -> None:
        self._stream.send_columns(path, indexes=self._times, columns=columns)
