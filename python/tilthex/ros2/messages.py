"""A flight in the standard messages of ROS 2, for bags and for the bridge.

Axes are those of REP 103 (world z up, robot x forward and y left), frames those of REP 105. `map` is the
world; `base_link` the robot, its origin the centre of mass; `tool` the tool, its origin the tip.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex._core import Vehicle
from tilthex._logged import State, Target
from tilthex._quaternions import quaternion_from_rotation, rotations_from_quaternions

Array = NDArray[Any]
Row = dict[str, Any]

FRAMES = {"world": "map", "robot": "base_link", "tool": "tool"}
"""Names of the frames."""


def rows(state: State) -> dict[str, Row]:
    """A state of the control socket as a row of each topic of a log, in the columns of `tilthex.log.read`."""
    return {
        "/state": {
            "position_w": state["position"],
            "velocity_w": state["velocity"],
            "orientation": quaternion_from_rotation(state["rotation"]),
            "angular_velocity_r": state["angular_velocity"],
            "specific_force_r": state["specific_force"],
            "position_deviation": state["position_deviation"],
            "velocity_deviation": state["velocity_deviation"],
            "rotation_deviation": state["rotation_deviation"],
        },
        "/setpoint": _target(state["setpoint"]),
        "/reference": _target(state["reference"]),
        "/wrench": {"tool_w.force": state["force"], "tool_w.torque": state["torque"]},
        "/rotors": {"measured": state["rotor_speeds"]},
    }


def _target(target: Target) -> Row:
    return {
        "position_w": target["position"],
        "orientation": quaternion_from_rotation(target["rotation"]),
        "wrench_w.force": target["force"],
        "wrench_w.torque": target["torque"],
    }


class RosMessages:
    """Converts rows of a log to messages of ROS 2.

    Args:
        types: By the name of a message, such as "nav_msgs/msg/Odometry": a function that makes it from its
            fields in their order.
    """

    def __init__(self, types: Mapping[str, Callable[..., Any]]) -> None:
        self._types = types

    def topics(self) -> Iterator[tuple[str, str, str, Callable[[int, Row], Any]]]:
        """Topic and message in ROS, topic of the log, and what makes the message from time, ns, and row."""
        yield "odom", "nav_msgs/msg/Odometry", "/state", self.odometry
        yield "imu", "sensor_msgs/msg/Imu", "/state", self.imu
        yield "/tf", "tf2_msgs/msg/TFMessage", "/state", self.transforms
        yield "setpoint", "geometry_msgs/msg/PoseStamped", "/setpoint", self.pose
        yield "reference", "geometry_msgs/msg/PoseStamped", "/reference", self.pose
        yield "commanded_wrench", "geometry_msgs/msg/WrenchStamped", "/setpoint", self.commanded_wrench
        yield "tool_wrench", "geometry_msgs/msg/WrenchStamped", "/wrench", self.tool_wrench
        yield "joint_states", "sensor_msgs/msg/JointState", "/rotors", self.joint_state

    def odometry(self, time: int, row: Row) -> Any:
        """Pose of the robot in the world; its twist in robot axes, as the message requires."""
        place, turn = row["position_deviation"], row["rotation_deviation"]
        pose = self._make("geometry_msgs/msg/PoseWithCovariance", self._pose(row), _covariance(place, turn))
        rotation = rotations_from_quaternions(row["orientation"][None])[0]
        twist = self._make(
            "geometry_msgs/msg/Twist",
            self._vector(rotation.T @ row["velocity_w"]),
            self._vector(row["angular_velocity_r"]),
        )
        speed = _covariance(row["velocity_deviation"], None)
        twist = self._make("geometry_msgs/msg/TwistWithCovariance", twist, speed)
        header = self._header(time, "world")
        return self._make("nav_msgs/msg/Odometry", header, FRAMES["robot"], pose, twist)

    def imu(self, time: int, row: Row) -> Any:
        """Angular velocity and specific force at the centre of mass, robot axes, without biases."""
        unknown = np.zeros(9)
        return self._make(
            "sensor_msgs/msg/Imu",
            self._header(time, "robot"),
            self._quaternion(row["orientation"]),
            _variance(row["rotation_deviation"]).flatten(),
            self._vector(row["angular_velocity_r"]),
            unknown,
            self._vector(row["specific_force_r"]),
            unknown,
        )

    def transforms(self, time: int, row: Row) -> Any:
        """Transform from the world to the robot."""
        return self._frame(time, "world", "robot", row["position_w"], row["orientation"])

    def tool(self, time: int, vehicle: Vehicle) -> Any:
        """Transform from the robot to the tool, which does not change."""
        turn = quaternion_from_rotation(vehicle.tool_rotation)
        return self._frame(time, "robot", "tool", vehicle.tool_position, turn)

    def pose(self, time: int, row: Row) -> Any:
        """Pose of the tool in the world."""
        return self._make("geometry_msgs/msg/PoseStamped", self._header(time, "world"), self._pose(row))

    def tool_wrench(self, time: int, row: Row) -> Any:
        """Observed wrench on the tool about its tip, world axes."""
        return self._wrench(time, row["tool_w.force"], row["tool_w.torque"])

    def commanded_wrench(self, time: int, row: Row) -> Any:
        """Wrench that the tool must exert, about its tip, world axes."""
        return self._wrench(time, row["wrench_w.force"], row["wrench_w.torque"])

    def joint_state(self, time: int, row: Row) -> Any:
        """Measured speeds of the rotors, rad/s."""
        speeds = 2.0 * np.pi * np.atleast_1d(row["measured"])
        names = [f"rotor_{i}" for i in range(len(speeds))]
        none = np.zeros(0)
        return self._make(
            "sensor_msgs/msg/JointState", self._header(time, "robot"), names, none, speeds, none
        )

    def _make(self, kind: str, *fields: Any) -> Any:
        return self._types[kind](*fields)

    def _header(self, time: int, frame: str) -> Any:
        stamp = self._make("builtin_interfaces/msg/Time", *divmod(time, 1_000_000_000))
        return self._make("std_msgs/msg/Header", stamp, FRAMES[frame])

    def _vector(self, values: Array) -> Any:
        return self._make("geometry_msgs/msg/Vector3", *map(float, values))

    def _quaternion(self, values: Array) -> Any:
        return self._make("geometry_msgs/msg/Quaternion", *map(float, values))

    def _pose(self, row: Row) -> Any:
        position = self._make("geometry_msgs/msg/Point", *map(float, row["position_w"]))
        return self._make("geometry_msgs/msg/Pose", position, self._quaternion(row["orientation"]))

    def _wrench(self, time: int, force: Array, torque: Array) -> Any:
        wrench = self._make("geometry_msgs/msg/Wrench", self._vector(force), self._vector(torque))
        return self._make("geometry_msgs/msg/WrenchStamped", self._header(time, "world"), wrench)

    def _frame(self, time: int, parent: str, child: str, position: Array, turn: Array) -> Any:
        motion = self._make("geometry_msgs/msg/Transform", self._vector(position), self._quaternion(turn))
        header = self._header(time, parent)
        stamped = self._make("geometry_msgs/msg/TransformStamped", header, FRAMES[child], motion)
        return self._make("tf2_msgs/msg/TFMessage", [stamped])


def _variance(deviation: float | None) -> Array:
    """Covariance (3, 3) of a vector from the root of its summed variances; zeros if this is not known."""
    known = deviation is not None and np.isfinite(deviation)
    return np.eye(3) * (float(deviation or 0.0) ** 2 / 3.0 if known else 0.0)


def _covariance(linear: float | None, angular: float | None) -> Array:
    """Covariance (36,) of six numbers, row by row; zeros if it is not known."""
    whole = np.zeros((6, 6))
    whole[:3, :3], whole[3:, 3:] = _variance(linear), _variance(angular)
    return whole.flatten()
