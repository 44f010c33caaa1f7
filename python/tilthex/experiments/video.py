"""A film of a flight, rendered without a display."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from tilthex import Vehicle
from tilthex.experiments.record import Record
from tilthex.experiments.spec import Run
from tilthex.experiments.world import PERIOD
from tilthex.mjcf import ROTOR_RADIUS, to_mjcf

Vector = NDArray[np.float64]

FRAMES_PER_SECOND = 10
FIELD_OF_VIEW = math.radians(45.0)
"""Of MuJoCo's free camera, from top to bottom."""
STEPS = {".gif": 10, ".webp": 1}
"""Kinds of videos, by the ending of their names, with the unit of a picture's duration, ms."""


def render(run: Run, record: Record, path: Path, *, size: tuple[int, int] = (480, 640)) -> None:
    """Writes a flight as an animated GIF, in real time.

    Raises:
        OSError: The machine cannot render off-screen; the message says what it lacks.
    """
    vehicle = run.drawn().vehicle
    scene = run.scene()
    model = mujoco.MjModel.from_xml_string(to_mjcf(vehicle, scene.elements, extra=scene.extra))
    data = mujoco.MjData(model)
    seen = camera(vehicle, record.robot_position, record.robot_rotation, size, scene.look_at)
    pictures = []
    with renderer(model, size) as drawing:
        for k in range(0, len(record.time), round(1.0 / (FRAMES_PER_SECOND * PERIOD))):
            data.qpos[7:] = record.scene_joints[k]
            place(model, data, record.robot_position[k], record.robot_rotation[k])
            drawing.update_scene(data, seen)
            pictures.append(drawing.render())
    save(pictures, path, FRAMES_PER_SECOND)


def camera(
    vehicle: Vehicle,
    positions: Vector,
    rotations: Vector,
    size: tuple[int, int],
    look_at: Sequence[float] | None = None,
) -> Any:
    """A camera that sees the whole vehicle all the time.

    Args:
        vehicle: The vehicle.
        positions: Positions of its centre of mass, m, (n, 3).
        rotations: Its orientations, (n, 3, 3).
        size: Height and width of the picture.
        look_at: The point at which the camera looks, m; the middle of the flight if it is missing.
    """
    seen = mujoco.MjvCamera()
    tools = positions + rotations @ vehicle.tool_position
    both = np.vstack([positions, tools])
    seen.lookat[:] = 0.5 * (both.min(axis=0) + both.max(axis=0)) if look_at is None else look_at
    # What the tool touches is in front of it, so the camera is beside its back.
    back = (rotations @ vehicle.tool_rotation[:, 2]).mean(axis=0)
    level = math.hypot(back[0], back[1]) > 0.5
    azimuth = math.atan2(-back[1], -back[0]) + math.radians(60.0) if level else math.radians(130.0)
    elevation = math.radians(-12.0)
    seen.azimuth, seen.elevation = math.degrees(azimuth), math.degrees(elevation)
    right = np.array([math.sin(azimuth), -math.cos(azimuth), 0.0])
    forward = np.append(math.cos(elevation) * np.array([-right[1], right[0]]), math.sin(elevation))
    across = math.tan(0.5 * FIELD_OF_VIEW) * np.array([size[1] / size[0], 1.0])
    rotors = [positions + rotations @ np.array(rotor["position"]) for rotor in vehicle.rotors]
    points = np.vstack([tools, *rotors]) - seen.lookat
    # The planes of the frustum touch the spheres around the rotors.
    around = ROTOR_RADIUS * np.hypot(1.0, across)
    wide = np.abs(points @ np.column_stack([right, np.cross(right, forward)])) + around
    seen.distance = np.max(wide / across - (points @ forward)[:, None])
    return seen


def renderer(model: Any, size: tuple[int, int]) -> Any:
    """A renderer of pictures with a size (height, width).

    Raises:
        OSError: The machine cannot render off-screen; the message says what it lacks.
    """
    try:
        return mujoco.Renderer(model, *size)
    except Exception as error:
        raise OSError(
            f"no video: MuJoCo cannot render without a display here ({error}); it needs EGL "
            "(MUJOCO_GL=egl, a GPU driver or Mesa) or OSMesa (MUJOCO_GL=osmesa)"
        ) from error


def place(model: Any, data: Any, position: Any, rotation: Any) -> None:
    """Moves the robot to a position (3,), m, and a rotation (3, 3), robot to world."""
    data.qpos[:3] = position
    mujoco.mju_mat2Quat(data.qpos[3:7], rotation.reshape(9))
    mujoco.mj_forward(model, data)


def save(pictures: Iterable[Any], path: Path, frames_per_second: float) -> None:
    """Writes pictures (height, width, 3), bytes, as a film: `.gif` (64 colours) or `.webp` (all colours)."""
    from PIL import Image

    step = STEPS[path.suffix]
    frames = [Image.fromarray(picture) for picture in pictures]
    if path.suffix == ".gif":
        # The octree keeps the colours of thin lines and arrows.
        frames = [frame.quantize(64, Image.Quantize.FASTOCTREE) for frame in frames]
    # Rounded times, and not rounded durations: the film does not become faster or slower.
    ends = [step * round(1000.0 * k / (frames_per_second * step)) for k in range(len(frames) + 1)]
    durations = [end - begin for begin, end in itertools.pairwise(ends)]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=durations, loop=0)
