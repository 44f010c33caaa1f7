"""A log for Foxglove: the channels of the log, poses and a scene in addition, and a layout.

`foxglove.PoseInFrame` on `/setpoint_pose` and `/reference_pose`, and `foxglove.SceneUpdate` on `/scene`: the
vehicle in the frame `robot` of the log's own `/tf`, and the observed wrench as arrows in `world`.
"""

from __future__ import annotations

import heapq
import json
from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex._core import Config
from tilthex._quaternions import quaternion_from_rotation
from tilthex.log import Log
from tilthex.view.geometry import Cylinder, cylinders, turn
from tilthex.view.looks import FORCE, FORCE_LENGTH, TORQUE, TORQUE_LENGTH
from tilthex.view.sample import Flown, Pose, Sample, tool_pose

Array = NDArray[np.float64]
Message = tuple[int, int | str, Any]
"""Log time, ns, topic and message."""

PERIOD = 0.02
"""Time between two poses, s."""
AGAIN = 1.0
"""Time between two messages with the vehicle, s, so that a viewer that jumps in time finds it."""


def write(log: Log, out: Path) -> None:
    """Writes `flight.mcap` and `layout.json` into a new folder.

    Raises:
        ImportError: Foxglove's schemas are not installed.
    """
    try:
        import foxglove_schemas_protobuf  # noqa: F401
    except ImportError as error:
        raise ImportError("Foxglove's schemas are not installed: pip install 'tilthex[logs]'") from error
    from mcap.writer import Writer
    from mcap_protobuf.schema import build_file_descriptor_set

    flown = Flown(log)
    out.mkdir(parents=True)
    with (out / "flight.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(library="tilthex")
        for name, data in log.attachments.items():
            writer.add_attachment(0, 0, name, "text/plain", data)
        # Channels of the log by number, new channels by topic.
        channels: dict[int | str, int] = {}
        for number, (topic, encoding, schema) in log.channels.items():
            known = writer.register_schema(*schema)
            channels[number] = writer.register_channel(topic, encoding, known)
        scene = Scene(flown.config)
        every: Iterator[Message] = heapq.merge(log.raw(), scene.messages(flown), key=itemgetter(0))
        for time, channel, message in every:
            if not isinstance(message, bytes):
                if channel not in channels:
                    kind = message.DESCRIPTOR.full_name
                    schema_data = build_file_descriptor_set(type(message)).SerializeToString()
                    known = writer.register_schema(kind, "protobuf", schema_data)
                    channels[channel] = writer.register_channel(str(channel), "protobuf", known)
                message = message.SerializeToString()
            writer.add_message(channels[channel], time, message, time)
        writer.finish()  # type: ignore[no-untyped-call]
    rotors = flown.config.vehicle.rotor_count
    (out / "layout.json").write_text(json.dumps(layout(rotors), indent=2) + "\n", encoding="utf-8")


class Scene:
    """The messages of a flight for Foxglove's 3-D panel."""

    def __init__(self, config: Config) -> None:
        from foxglove_schemas_protobuf import (
            ArrowPrimitive_pb2,
            CylinderPrimitive_pb2,
            PoseInFrame_pb2,
            SceneUpdate_pb2,
        )

        self._arrow = ArrowPrimitive_pb2.ArrowPrimitive
        self._cylinder = CylinderPrimitive_pb2.CylinderPrimitive
        self._pose = PoseInFrame_pb2.PoseInFrame
        self._update = SceneUpdate_pb2.SceneUpdate
        self._config = config

    def messages(self, flown: Flown) -> Iterator[Message]:
        """The messages in the order of their times."""
        shown = drawn = -float("inf")
        for row, at in enumerate(flown.times):
            # A message may be up to half a tick early.
            if at - shown < PERIOD - 1e-3:
                continue
            shown = at
            time, sample = int(flown.stamps[row]), flown.sample(row)
            yield time, "/setpoint_pose", self.pose(time, sample.setpoint)
            yield time, "/reference_pose", self.pose(time, sample.reference)
            if at - drawn >= AGAIN:
                drawn = at
                yield time, "/scene", self.vehicle(time)
            yield time, "/scene", self.wrench(time, sample)

    def pose(self, time: int, pose: Pose) -> Any:
        """A `PoseInFrame` of the tool in the world."""
        message = self._pose(frame_id="world")
        message.timestamp.FromNanoseconds(time)
        _place(message.pose, pose.position, pose.rotation)
        return message

    def vehicle(self, time: int) -> Any:
        """The vehicle, which moves with the frame `robot`."""
        message, entity = self._entity(time, "vehicle", "robot")
        entity.frame_locked = True
        for shape in cylinders(self._config.vehicle):
            entity.cylinders.append(self._shape(shape))
        return message

    def wrench(self, time: int, sample: Sample) -> Any:
        """The observed wrench on the tool, as two arrows."""
        message, entity = self._entity(time, "wrench", "world")
        tip = tool_pose(sample.robot, self._config).position
        for along, colour in ((FORCE_LENGTH * sample.force, FORCE), (TORQUE_LENGTH * sample.torque, TORQUE)):
            length = float(np.linalg.norm(along))
            if not (np.isfinite(tip).all() and 1e-6 < length < np.inf):
                continue
            head = min(0.04, 0.5 * length)
            arrow = self._arrow(
                shaft_length=length - head, shaft_diameter=0.016, head_length=head, head_diameter=0.04
            )
            _place(arrow.pose, tip, turn([1.0, 0.0, 0.0], along))
            _paint(arrow.color, colour, 1.0)
            entity.arrows.append(arrow)
        return message

    def _entity(self, time: int, name: str, frame: str) -> tuple[Any, Any]:
        message = self._update()
        entity = message.entities.add(frame_id=frame, id=name)
        entity.timestamp.FromNanoseconds(time)
        return message, entity

    def _shape(self, shape: Cylinder) -> Any:
        cylinder = self._cylinder(bottom_scale=1.0, top_scale=1.0)
        _place(cylinder.pose, shape.centre, shape.rotation)
        cylinder.size.x = cylinder.size.y = 2.0 * shape.radius
        cylinder.size.z = shape.length
        _paint(cylinder.color, shape.colour, shape.opacity)
        return cylinder


def _place(pose: Any, position: Array, rotation: Array) -> None:
    pose.position.x, pose.position.y, pose.position.z = map(float, position)
    turned = pose.orientation
    turned.x, turned.y, turned.z, turned.w = map(float, quaternion_from_rotation(rotation))


def _paint(colour: Any, rgb: tuple[int, int, int], opacity: float) -> None:
    colour.r, colour.g, colour.b = (part / 255.0 for part in rgb)
    colour.a = opacity


def layout(rotors: int) -> dict[str, Any]:
    """A layout of Foxglove for a vehicle with `rotors` rotors: scene, phase, lines of text, and plots."""
    plots = {
        "Plot!position": _plot("tool position, m", ["/setpoint.position_w", "/reference.position_w"]),
        "Plot!error": _plot("position error, m", ["/control.position_error_w"]),
        "Plot!force": _plot("tool force, N", ["/wrench.tool_w.force"]),
        "Plot!torque": _plot("tool torque, N m", ["/wrench.tool_w.torque"]),
        "Plot!rotors": _plot("rotor speed, Hz", [], [f"/rotors.measured[{i}]" for i in range(rotors)]),
    }
    left = _split("column", "3D!scene", _split("column", "StateTransitions!phase", "RosOut!log", 50), 70)
    right: Any = list(plots)[-1]
    for count, name in enumerate(reversed(list(plots)[:-1]), 2):
        right = _split("column", name, right, 100 / count)
    visible = {topic: {"visible": True} for topic in ("/scene", "/setpoint_pose", "/reference_pose")}
    panels: dict[str, Any] = {
        "3D!scene": {
            "followMode": "follow-none",
            "followTf": "world",
            "topics": visible,
            "layers": {"grid": {"layerId": "foxglove.Grid", "instanceId": "grid", "visible": True}},
        },
        "StateTransitions!phase": {"isSynced": True, "paths": [_path("/flight.phase")]},
        "RosOut!log": {"topicToRender": "/log", "searchTerms": [], "minLogLevel": 1},
        **plots,
    }
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _split("row", left, right, 60),
    }


def _split(direction: str, first: Any, second: Any, part: float) -> dict[str, Any]:
    return {"direction": direction, "first": first, "second": second, "splitPercentage": part}


def _path(value: str) -> dict[str, Any]:
    return {"value": value, "enabled": True, "timestampMethod": "receiveTime"}


def _plot(title: str, vectors: list[str], values: list[str] | None = None) -> dict[str, Any]:
    paths = [f"{vector}.{axis}" for vector in vectors for axis in "xyz"] + (values or [])
    return {
        "foxglovePanelTitle": title,
        "paths": [_path(path) for path in paths],
        "showLegend": True,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "showXAxisLabels": True,
        "showYAxisLabels": True,
    }
