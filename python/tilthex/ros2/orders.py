"""Converts messages of ROS 2 to orders. If a message is not a valid order, the error is one sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex._quaternions import rotations_from_quaternions
from tilthex.ros2.messages import FRAMES

Array = NDArray[np.float64]

UNIT = 0.01
"""Largest accepted error of a quaternion's length; the quaternion is then normalised."""


def pose(message: Any) -> tuple[Array, Array]:
    """Position (3,), m, and rotation (3, 3) of a `PoseStamped` in the world.

    Raises:
        ValueError: Another frame, a number that is not finite, or no unit quaternion.
    """
    check_frame(message)
    return _vector("position", message.pose.position), _rotation(message.pose.orientation)


def wrench(message: Any) -> tuple[Array, Array]:
    """Force (3,), N, and torque (3,), N m, of a `WrenchStamped` in world axes.

    Raises:
        ValueError: As of `pose`.
    """
    check_frame(message)
    return _vector("force", message.wrench.force), _vector("torque", message.wrench.torque)


def is_stream(trajectory: Any) -> bool:
    """Whether a `MultiDOFJointTrajectory` is one set-point of a stream: a single point without a time."""
    return len(trajectory.points) == 1 and _seconds(trajectory.points[0]) == 0.0


def setpoint(trajectory: Any) -> dict[str, Array]:
    """The arguments of `follow` for the one point of a trajectory: the tool in the world.

    Raises:
        ValueError: As of `pose`, or several bodies.
    """
    check_frame(trajectory)
    point = trajectory.points[0]
    found = _place(point, "the point")
    for name, twists in (("velocity", point.velocities), ("acceleration", point.accelerations)):
        if twists:
            found[name] = _vector(name, twists[0].linear)
            found[f"angular_{name}"] = _vector(f"angular {name}", twists[0].angular)
    return found


def waypoints(trajectory: Any) -> list[dict[str, Any]]:
    """The way-points of a trajectory: its points, with the time between them as their shortest duration.

    Raises:
        ValueError: As of `setpoint`; no point, or times that do not increase.
    """
    check_frame(trajectory)
    if not trajectory.points:
        raise ValueError("the trajectory has no points; expected one or more")
    found: list[dict[str, Any]] = []
    before = 0.0
    for k, point in enumerate(trajectory.points):
        time = _seconds(point)
        if time < before or (k and time == before):
            raise ValueError(
                f"point {k} of the trajectory has the time_from_start {time} s after {before} s;"
                " expected times that increase"
            )
        found.append({**_place(point, f"point {k}"), "duration": time - before})
        before = time
    return found


def unused(trajectory: Any) -> bool:
    """Whether the points of a trajectory have velocities or accelerations."""
    return any(point.velocities or point.accelerations for point in trajectory.points)


def check_frame(message: Any) -> None:
    """Accepts messages in the frame of the world, and messages without a frame.

    Raises:
        ValueError: Another frame.
    """
    frame, world = message.header.frame_id, FRAMES["world"]
    if frame not in ("", world):
        raise ValueError(f'the message is in the frame "{frame}"; expected "{world}"')


def _place(point: Any, name: str) -> dict[str, Any]:
    if len(point.transforms) != 1:
        raise ValueError(
            f"{name} of the trajectory has {len(point.transforms)} transforms; expected the tool's"
        )
    moved = point.transforms[0]
    return {"position": _vector("translation", moved.translation), "rotation": _rotation(moved.rotation)}


def _seconds(point: Any) -> float:
    return float(point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec)


def _vector(name: str, value: Any) -> Array:
    found = np.array([value.x, value.y, value.z])
    if not np.isfinite(found).all():
        raise ValueError(f"the {name} is {found.tolist()}; expected finite numbers")
    return found


def _rotation(value: Any) -> Array:
    xyzw = np.array([value.x, value.y, value.z, value.w])
    norm = float(np.linalg.norm(xyzw))
    if not abs(norm - 1.0) <= UNIT:
        raise ValueError(f"the quaternion {xyzw.tolist()} (x, y, z, w) has the length {norm:.4g}; expected 1")
    rotation: Array = rotations_from_quaternions(xyzw[None])[0]
    return rotation
