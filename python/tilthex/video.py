"""`tilthex video`: a film of a flight's log.

It shows the vehicle, the set-point of the tool (white), its reference (axes in red, green and blue), the
force (red) and the torque (violet) on the tool, the phase and the time. The kind of the film follows from the
name: .gif or .webp. It needs no display, but EGL or OSMesa.
"""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tilthex._needed import require
from tilthex.log import Log
from tilthex.mjcf import to_mjcf
from tilthex.view.looks import FORCE, FORCE_LENGTH, TORQUE, TORQUE_LENGTH
from tilthex.view.sample import Flown, Sample, tool_pose

NEEDED = {"mujoco": "MuJoCo", "scipy": "SciPy", "PIL": "Pillow"}
SMALLEST, LARGEST = (64, 64), (1280, 960)
"""Sizes of a picture, width and height, pixels; the largest is that of MuJoCo's buffer in `to_mjcf`."""
FASTEST = 50.0
"""Pictures per second; browsers show a GIF with more of them slowly."""
SHORTEST = 0.005
"""Arrows that are shorter are not drawn, m."""
AXIS = 0.08
"""Length of an axis of the reference, m."""


def add_parser(subparsers: Any) -> None:
    """Registers the command with the parsers of `tilthex`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "video",
        help="make a video of a flight's log",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("log", type=Path, metavar="LOG", help="MCAP file of tilthex-rt")
    parser.add_argument(
        "--out", type=Path, help="video to write: .gif or .webp (default: LOG with .gif instead of .mcap)"
    )
    parser.add_argument("--fps", type=float, default=10.0, help="pictures per second (default: 10)")
    parser.add_argument(
        "--speed", type=float, default=1.0, help="seconds of the flight in a second (default: 1)"
    )
    parser.add_argument(
        "--size", default="640x480", metavar="WxH", help="width and height, pixels (default: 640x480)"
    )
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> None:
    out = arguments.out or arguments.log.with_suffix(".gif")
    size = re.fullmatch(r"(\d+)x(\d+)", arguments.size)
    if size is None:
        raise ValueError(
            f"--size is {arguments.size!r}; expected width and height in pixels, such as 640x480"
        )
    write(
        arguments.log,
        out,
        frames_per_second=arguments.fps,
        speed=arguments.speed,
        size=(int(size[1]), int(size[2])),
    )
    print(out)


def write(
    path: str | Path,
    out: str | Path,
    *,
    frames_per_second: float = 10.0,
    speed: float = 1.0,
    size: tuple[int, int] = (640, 480),
) -> None:
    """Writes a film of a log.

    Args:
        path: A log of tilthex-rt. A log that breaks off is shown up to its last record.
        out: The film, `.gif` or `.webp`; replaced if it exists.
        frames_per_second: Pictures in a second of the film, 1 to 50.
        speed: Seconds of the flight in a second of the film.
        size: Width and height, pixels, 64 x 64 to 1280 x 960.

    Raises:
        ValueError: The log cannot be read, or an argument is wrong.
        OSError: The machine cannot render without a display; the message says what it lacks.
        ImportError: A library is missing.
    """
    out = Path(out)
    if out.suffix not in (".gif", ".webp"):
        raise ValueError(f"{out} is no name of a video; expected one that ends with .gif or .webp")
    if not 1.0 <= frames_per_second <= FASTEST:
        raise ValueError(f"{frames_per_second} pictures per second; expected 1 to {FASTEST:g}")
    if not 0.0 < speed < math.inf:
        raise ValueError(f"the speed is {speed}; expected a positive number")
    if not all(low <= side <= high for low, side, high in zip(SMALLEST, size, LARGEST, strict=True)):
        sizes = " to ".join(f"{width}x{height}" for width, height in (SMALLEST, LARGEST))
        raise ValueError(f"the size is {size[0]}x{size[1]}; expected {sizes} pixels")
    require("a video needs", NEEDED, "analysis,experiments")
    flown = Flown(Log(path))
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("MUJOCO_GL", "egl")
    try:
        from tilthex.experiments.video import save
    except (AttributeError, ImportError) as error:
        # MuJoCo loads the library of its renderer when it is imported.
        raise OSError(f"no video: MuJoCo finds no renderer ({error}); it needs EGL or OSMesa") from error

    save(_pictures(flown, speed / frames_per_second, size), out, frames_per_second)


def _pictures(flown: Flown, step: float, size: tuple[int, int]) -> Iterator[Any]:
    """Pictures (height, width, 3), bytes, of the flight at every `step` seconds."""
    import mujoco

    from tilthex.experiments import video
    from tilthex.experiments.scenes import free_air

    model = mujoco.MjModel.from_xml_string(to_mjcf(flown.config.vehicle, free_air().elements))
    data = mujoco.MjData(model)
    robots = [sample.robot for sample in flown.thinned(200) if np.isfinite(sample.robot.position).all()]
    if not robots:
        raise ValueError("the log has no pose of the vehicle; expected a flight")
    positions, rotations = (np.array([getattr(one, of) for one in robots]) for of in ("position", "rotation"))
    camera = video.camera(flown.config.vehicle, positions, rotations, size[::-1])
    with video.renderer(model, size[::-1]) as drawing:
        # The last picture shows the last record.
        for k in range(math.ceil(flown.times[-1] / step) + 1):
            sample = flown.at(k * step)
            if np.isfinite(sample.robot.position).all():
                video.place(model, data, sample.robot.position, sample.robot.rotation)
            drawing.update_scene(data, camera)
            _mark(drawing.scene, flown, sample)
            yield _written(drawing.render(), sample)


def _mark(scene: Any, flown: Flown, sample: Sample) -> None:
    """Adds set-point, reference and wrench to a picture."""
    import mujoco

    def mark(kind: Any, begin: Any, end: Any, width: float, colour: tuple[int, ...]) -> None:
        if not np.isfinite([begin, end]).all() or scene.ngeom >= scene.maxgeom:
            return
        geom = scene.geoms[scene.ngeom]
        scene.ngeom += 1
        rgba = np.array([*colour, 255], dtype=np.float32) / 255.0
        mujoco.mjv_initGeom(geom, kind, np.full(3, width), np.asarray(begin), np.eye(3).ravel(), rgba)
        if kind != mujoco.mjtGeom.mjGEOM_SPHERE:
            mujoco.mjv_connector(geom, kind, width, begin, end)

    setpoint, reference = sample.setpoint.position, sample.reference
    mark(mujoco.mjtGeom.mjGEOM_SPHERE, setpoint, setpoint, 0.012, (255, 255, 255))
    for axis, colour in zip(reference.rotation.T, np.diag([220, 190, 255]), strict=True):
        end = reference.position + AXIS * axis
        mark(mujoco.mjtGeom.mjGEOM_CAPSULE, reference.position, end, 0.004, tuple(colour))
    tip = tool_pose(sample.robot, flown.config).position
    for vector, length, colours in (
        (sample.force, FORCE_LENGTH, FORCE),
        (sample.torque, TORQUE_LENGTH, TORQUE),
    ):
        if length * np.linalg.norm(vector) > SHORTEST:
            mark(mujoco.mjtGeom.mjGEOM_ARROW, tip, tip + length * vector, 0.008, colours)


def _written(picture: Any, sample: Sample) -> Any:
    """A picture with time, phase, force and faults in its corner."""
    from PIL import Image, ImageDraw

    image = Image.fromarray(picture)
    text = f"{sample.time:.2f} s  {sample.phase}  {np.linalg.norm(sample.force):.1f} N"
    text = "\n".join([text, *sample.faults])
    ImageDraw.Draw(image).text((8, 6), text, fill=(255, 255, 255), stroke_width=1, stroke_fill=(0, 0, 0))
    return np.asarray(image)


__all__ = ["add_parser", "write"]
