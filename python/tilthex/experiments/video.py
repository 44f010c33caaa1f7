"""A film of a flight, rendered without a display."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from tilthex.experiments.record import Record
from tilthex.experiments.spec import Run
from tilthex.experiments.world import PERIOD
from tilthex.mjcf import to_mjcf

FRAMES_PER_SECOND = 10


def render(run: Run, record: Record, path: Path, *, size: tuple[int, int] = (480, 640)) -> None:
    """Writes a flight as an animated GIF, in real time.

    Raises:
        OSError: The machine cannot render off-screen; the message says what it lacks.
    """
    from PIL import Image

    vehicle = run.drawn().vehicle
    scene = run.scene()
    model = mujoco.MjModel.from_xml_string(to_mjcf(vehicle, scene.elements))
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = np.add(scene.look_at, (0.0, 0.0, 0.15))
    camera.distance, camera.azimuth, camera.elevation = 1.4, 130.0, -12.0
    try:
        renderer = mujoco.Renderer(model, *size)
    except Exception as error:
        raise OSError(
            f"no video: MuJoCo cannot render without a display here ({error}); it needs EGL "
            "(MUJOCO_GL=egl, a GPU driver or Mesa) or OSMesa (MUJOCO_GL=osmesa)"
        ) from error
    frames = []
    with renderer:
        for k in range(0, len(record.time), round(1.0 / (FRAMES_PER_SECOND * PERIOD))):
            data.qpos[:3] = record.robot_position[k]
            mujoco.mju_mat2Quat(data.qpos[3:7], record.robot_rotation[k].reshape(9))
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera)
            frames.append(Image.fromarray(renderer.render()).quantize(64))
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=1000 // FRAMES_PER_SECOND, loop=0)
