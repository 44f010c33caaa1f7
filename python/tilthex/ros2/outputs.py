"""The outputs of the bridge: the messages of each state."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile

from tilthex._core import Vehicle
from tilthex._logged import State
from tilthex.ros2 import diagnostics
from tilthex.ros2.clock import FlightClock
from tilthex.ros2.messages import RosMessages, Row, rows
from tilthex.ros2.types import RosTypes, message

DEPTH = 100
"""Number of messages that can wait for a slow subscriber: those of one second."""
TRANSFORMS = "tf2_msgs/msg/TFMessage"
LAST = Duration(seconds=0.2)
"""Longest wait at the end for a subscriber that has not received all messages."""
DIAGNOSTICS_PERIOD = 1.0
"""Time between two diagnostics if nothing changes, s."""


class Outputs:
    """The publishers of a node for one vehicle."""

    def __init__(self, node: Any, vehicle: Vehicle) -> None:
        self._node = node
        self._clock = FlightClock()
        self._types = RosTypes()
        self._diagnosed: tuple[int, str] | None = None
        self._diagnosed_at = 0.0
        messages = RosMessages(self._types)
        transforms = self._has_transforms()
        self._topics: list[tuple[Any, str, Callable[[int, Row], Any]]] = [
            (node.create_publisher(message(kind), topic, DEPTH), source, make)
            for topic, kind, source, make in messages.topics()
            if kind != TRANSFORMS or transforms
        ]
        self._diagnostics = node.create_publisher(
            message("diagnostic_msgs/msg/DiagnosticArray"), "/diagnostics", DEPTH
        )
        if transforms:
            kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            self._fixed = node.create_publisher(message(TRANSFORMS), "/tf_static", kept)
            self._fixed.publish(messages.tool(self._now(), vehicle))

    def publish(self, state: State, counts: Mapping[str, int]) -> None:
        """Publishes a state that has just arrived. `counts` are the counters of the bridge."""
        stamp = self._clock.stamp(state["time"] or 0.0, self._now())
        found = rows(state)
        for publisher, source, make in self._topics:
            publisher.publish(make(stamp, found[source]))
        self._diagnose(state, stamp, counts)

    def finish(self) -> None:
        """Waits until every subscriber that answers has received all messages."""
        for publisher in (*(publisher for publisher, *_ in self._topics), self._diagnostics):
            publisher.wait_for_all_acked(LAST)

    def _diagnose(self, state: State, stamp: int, counts: Mapping[str, int]) -> None:
        said, now = (diagnostics.level(state), diagnostics.message(state)), time.monotonic()
        if said == self._diagnosed and now - self._diagnosed_at < DIAGNOSTICS_PERIOD:
            return
        self._diagnosed, self._diagnosed_at = said, now
        make = self._make
        at = make("builtin_interfaces/msg/Time", *divmod(stamp, 1_000_000_000))
        header = make("std_msgs/msg/Header", at, "")
        listed = [diagnostics.status(make, state, counts)]
        self._diagnostics.publish(make("diagnostic_msgs/msg/DiagnosticArray", header, listed))

    def _make(self, kind: str, *fields: Any) -> Any:
        return self._types[kind](*fields)

    def _now(self) -> int:
        now: int = self._node.get_clock().now().nanoseconds
        return now

    def _has_transforms(self) -> bool:
        try:
            message(TRANSFORMS)
        except ModuleNotFoundError:
            self._node.get_logger().warning(
                "tf2_msgs is not installed: /tf and /tf_static are not published; install it with your ROS"
            )
            return False
        return True
