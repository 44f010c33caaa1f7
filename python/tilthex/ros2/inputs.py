"""The inputs of the bridge: topics and services that are orders to the flight."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from tilthex.client import Flight
from tilthex.ros2 import orders
from tilthex.ros2.groups import alone
from tilthex.ros2.types import message

DEPTH = 100
"""Number of messages that can wait while an order is sent: set-points of one second."""
AGAIN = 1.0
"""Time between two warnings with the same text, s."""
SERVICES = ("take_off", "zero_bias", "release_wrench", "take_controls")
"""Orders without arguments. Each has a service with its name."""
URGENT = ("kill", "land")
"""Orders without arguments that wait for no other order. Each has a service with its name."""


class Inputs:
    """The subscriptions and services of a node.

    Args:
        node: The node.
        pilot: The connection that gives the orders.
        brake: The connection of the urgent orders.
        lose: Called with the error of a connection that has ended.
    """

    def __init__(self, node: Any, pilot: Flight, brake: Flight, lose: Callable[[OSError], None]) -> None:
        self._node, self._pilot, self._lose = node, pilot, lose
        self._said: dict[str, tuple[str, float]] = {}
        self.setpoints = 0
        self.refused = 0
        for topic, kind, order in (
            ("command/pose", "geometry_msgs/msg/PoseStamped", self._go_to),
            ("command/trajectory", "trajectory_msgs/msg/MultiDOFJointTrajectory", self._fly),
            ("command/wrench", "geometry_msgs/msg/WrenchStamped", self._push),
        ):
            node.create_subscription(message(kind), topic, self._taking(topic, order), DEPTH)
        for names, flight, group in ((SERVICES, pilot, None), (URGENT, brake, alone())):
            for name in names:
                answer = self._serving(getattr(flight, name))
                node.create_service(message("std_srvs/srv/Trigger"), name, answer, callback_group=group)

    def _taking(self, topic: str, order: Callable[[Any], None]) -> Callable[[Any], None]:
        def take(received: Any) -> None:
            if reason := self._reason(lambda: order(received)):
                self.refused += 1
                self._warn(topic, reason)

        return take

    def _warn(self, topic: str, reason: str) -> None:
        """Logs a refusal. The same refusal of a stream is logged once per second."""
        now = time.monotonic()
        before, at = self._said.get(topic, ("", 0.0))
        if reason != before or now - at > AGAIN:
            self._said[topic] = (reason, now)
            self._node.get_logger().warning(f"{topic}: {reason}")

    def _serving(self, order: Callable[[], None]) -> Callable[[Any, Any], Any]:
        def serve(_: Any, response: Any) -> Any:
            reason = self._reason(order)
            response.success, response.message = reason is None, reason or ""
            return response

        return serve

    def _reason(self, order: Callable[[], None]) -> str | None:
        """Gives an order. Returns the reason if it is not obeyed."""
        try:
            order()
        except ValueError as error:
            return str(error)
        except OSError as error:
            self._lose(error)
            return f"the connection to the flight has ended ({error})"
        return None

    def _go_to(self, received: Any) -> None:
        position, rotation = orders.pose(received)
        self._pilot.go_to(position, rotation)

    def _fly(self, trajectory: Any) -> None:
        if orders.is_stream(trajectory):
            self._pilot.follow(**orders.setpoint(trajectory))
            self.setpoints += 1
            return
        ways = orders.waypoints(trajectory)
        self._pilot.play(ways)
        if orders.unused(trajectory):
            self._node.get_logger().warning(
                "command/trajectory: velocities and accelerations of its points are not used; the flight"
                " plans them. To give them, send single points without a time"
            )

    def _push(self, received: Any) -> None:
        force, torque = orders.wrench(received)
        self._pilot.set_wrench(force, torque)
