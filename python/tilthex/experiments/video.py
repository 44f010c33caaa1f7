"""A film of a flight, rendered without a display."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from tilthex.experiments.record import Record
from tilthex.experiments.spec import Run
from tilthex.experiments.world import PERIOD
from tilthex.mjcf import to_mjcf

FRAMES_PER_SECOND = 10
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
    seen = camera(np.add(scene.look_at, (0.0, 0.0, 0.15)), 1.4)
    pictures = []
    with renderer(model, size) as drawing:
        for k in range(0, len(record.time), round(1.0 / (FRAMES_PER_SECOND * PERIOD))):
            place(model, data, record.robot_position[k], record.robot_rotation[k])
            drawing.update_scene(data, seen)
            pictures.append(drawing.render())
    save(pictures, path, FRAMES_PER_SECOND)


def camera(look_at: Any, distance: float) -> Any:
    """A camera that looks at a point (3,), m, from a distance, m."""
    seen = mujoco.MjvCamera()
    seen.lookat[:] = look_at
    seen.distance, seen.azimuth, seen.elevation = distance, 130.0, -12.0
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
        frames = [frame.quantize(64) for frame in frames]
    # Rounded times, and not rounded durations: the film does not become faster or slower.
    ends = [step * round(1000.0 * k / (frames_per_second * step)) for k in range(len(frames) + 1)]
    durations = [end - begin for begin, end in itertools.pairwise(ends)]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=durations, loop=0)
