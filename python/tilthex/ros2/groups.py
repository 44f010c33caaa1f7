"""Groups of callbacks, each of which runs beside the others, and timers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def alone() -> Any:
    """A group whose callbacks wait for each other, and for no other group."""
    from rclpy.callback_groups import MutuallyExclusiveCallbackGroup

    return MutuallyExclusiveCallbackGroup()


def timer(node: Any, period: float, call: Callable[[], object], group: Any = None) -> Any:
    """A timer of a node, period in s, on the steady clock, because the clock of ROS may be set or stopped."""
    from rclpy.clock import Clock, ClockType

    steady = Clock(clock_type=ClockType.STEADY_TIME)
    return node.create_timer(period, call, callback_group=group, clock=steady)
