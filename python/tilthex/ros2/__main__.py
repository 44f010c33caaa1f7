"""`python -m tilthex.ros2`: a flight on ROS 2 (docs/howto/ros2.md)."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from tilthex import _control
from tilthex.client import HEARTBEAT, Flight
from tilthex.ros2.groups import alone, timer
from tilthex.ros2.poses import PoseSender
from tilthex.ros2.pulse import Pulse

USAGE, LINK, INTERRUPTED = 2, 3, 130
"""Exit status, as of `tilthex-rt`: wrong usage or configuration; the connection broke; interrupted."""
AGAIN = 0.2
"""Time between two attempts to connect to the flight, s."""
THREADS = 4
"""One for each group of callbacks: orders, kill and land, poses, pulse."""


def main() -> int:
    """Runs the bridge until the flight ends or the bridge is stopped. Returns the exit status."""
    try:
        import rclpy
        from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
        from rclpy.utilities import remove_ros_args
    except ModuleNotFoundError as error:
        return _failed(
            f"ROS 2 was not found ({error}); source its setup.bash, or install the wheels that"
            " docs/howto/ros2.md names",
            USAGE,
        )
    arguments = _parser().parse_args(remove_ros_args(sys.argv)[1:])
    pulse = Pulse()
    try:
        connect = _control.connector(arguments.control, arguments.control_token_file)
        connection = partial(connect, present=pulse)
        sender = PoseSender(arguments.pose_to, arguments.pose_body) if arguments.pose_topic else None
    except (ValueError, OSError) as error:
        return _failed(str(error), USAGE)
    rclpy.init()
    node = rclpy.create_node("tilthex")
    # Poses, kill and land, and the pulse do not wait while an order waits for the vehicle's answer.
    executor = MultiThreadedExecutor(num_threads=THREADS)
    executor.add_node(node)
    timer(node, HEARTBEAT, pulse.beat, group=alone())
    try:
        if sender is not None:
            _forward_poses(node, arguments.pose_topic, sender)
        status = _run(node, executor, connection, arguments.rate)
        if status == LINK and sender is not None:
            node.get_logger().warning("poses are still forwarded, because the vehicle needs them to land")
            executor.spin()
        return status
    except (KeyboardInterrupt, ExternalShutdownException):
        return INTERRUPTED
    finally:
        rclpy.try_shutdown()


def _failed(sentence: str, status: int) -> int:
    print(f"tilthex.ros2: {sentence}", file=sys.stderr)
    return status


def _run(node: Any, executor: Any, connection: Callable[[], Flight], rate: float) -> int:
    """Waits for a flight and bridges it. Returns the exit status."""
    from tilthex.ros2.bridge import Bridge

    try:
        pilot = _wait(node, executor, connection)
        if pilot is None:
            return INTERRUPTED
        with pilot, connection() as watcher, connection() as brake:
            bridge = Bridge(node, pilot, watcher, brake, rate)
            node.get_logger().info("connected to the flight")
            executor.spin_until_future_complete(bridge.ended)
            if not bridge.ended.done():
                return INTERRUPTED
            bridge.ended.result()
    except ValueError as error:
        return _failed(str(error), USAGE)
    except OSError as error:
        return _failed(f"the connection to the flight broke: {error}", LINK)
    done = ", ".join(f"{count} {what}" for what, count in bridge.counts().items())
    node.get_logger().info(f"the flight has ended: {done}")
    return 0


def _wait(node: Any, executor: Any, connection: Callable[[], Flight]) -> Flight | None:
    """Waits for a flight; None if ROS ends before. Forwards poses meanwhile: tilthex-rt needs them."""
    told = False
    while node.context.ok():
        try:
            return connection()
        except ConnectionError as error:
            if not told:
                node.get_logger().info(f"{error}; waiting for it")
                told = True
        again = time.monotonic() + AGAIN
        while node.context.ok() and time.monotonic() < again:
            executor.spin_once(timeout_sec=AGAIN)
    return None


def _forward_poses(node: Any, topic: str, sender: PoseSender) -> None:
    from rclpy.qos import qos_profile_sensor_data

    from tilthex.ros2.types import message

    def forward(received: Any) -> None:
        try:
            sender.send(received, node.get_clock().now().nanoseconds)
        # A short failure of the network must not end the bridge.
        except (ValueError, OSError) as error:
            node.get_logger().warning(f"{topic}: {error}", throttle_duration_sec=1.0)

    node.create_subscription(
        message("geometry_msgs/msg/PoseStamped"),
        topic,
        forward,
        qos_profile_sensor_data,
        callback_group=alone(),
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tilthex.ros2", description=__doc__)
    _control.add_options(parser)
    parser.add_argument(
        "--rate", type=float, default=100.0, help="states per second, 0.1 to 100 Hz; default: %(default)s"
    )
    parser.add_argument(
        "--pose-topic", metavar="TOPIC", help="PoseStamped topic that is sent to tilthex-rt as motion capture"
    )
    parser.add_argument(
        "--pose-to",
        default="127.0.0.1",
        metavar="HOST[:PORT]",
        help="computer on which tilthex-rt --mocap udp://... runs; default: %(default)s",
    )
    parser.add_argument(
        "--pose-body",
        default="hex",
        metavar="NAME",
        help="name of the body in that URI; default: %(default)s",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
