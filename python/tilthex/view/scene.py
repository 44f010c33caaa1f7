"""The vehicle, its tool's reference and set-point, wrench, rotor loads and attainable forces in 3-D."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import viser.transforms as vtf
from numpy.typing import NDArray

from tilthex.view.geometry import Cylinder, Reach, cylinders
from tilthex.view.looks import FORCE, FORCE_LENGTH, TORQUE, TORQUE_LENGTH
from tilthex.view.sample import Pose, Sample, tool_pose

if TYPE_CHECKING:
    import viser

    from tilthex import Config

Array = NDArray[np.float64]
Points = NDArray[np.float32]

THRUST_LENGTH = 0.02
"""Length of the arrow of a thrust, m/N."""
REACH_LENGTH = 0.02
"""Length of an attainable force, m/N."""
THRUST = (40, 140, 60)
CALM, FULL = np.array([51, 128, 204]), np.array([230, 50, 30])


class Scene:
    """The 3-D part of the page."""

    def __init__(self, server: viser.ViserServer, config: Config) -> None:
        self._config = config
        vehicle = config.vehicle
        self.reach = Reach(vehicle)
        scene = server.scene
        scene.set_up_direction("+z")
        scene.add_grid("/ground", width=6.0, height=6.0, cell_size=0.5)
        self._robot = scene.add_frame("/robot", show_axes=False)
        self._discs: list[viser.CylinderHandle] = []
        self._rotors: list[Cylinder] = []
        for number, shape in enumerate(cylinders(vehicle)):
            handle = _add(scene, f"/robot/{number}", shape)
            if shape.is_rotor:
                self._discs.append(handle)
                self._rotors.append(shape)
        self._thrusts = scene.add_arrows(
            "/robot/thrusts",
            self._thrust_arrows(np.zeros(len(self._rotors))),
            THRUST,
            shaft_radius=0.006,
            head_radius=0.015,
            head_length=0.03,
        )
        self.hull = scene.add_mesh_simple(
            "/robot/attainable",
            REACH_LENGTH * self.reach.vertices,
            self.reach.faces,
            color=(90, 160, 90),
            opacity=0.2,
            side="double",
            visible=False,
        )
        self._setpoint = scene.add_frame(
            "/set-point", axes_length=0.12, axes_radius=0.003, origin_radius=0.008
        )
        self._reference = scene.add_frame(
            "/reference", axes_length=0.08, axes_radius=0.006, origin_radius=0.012
        )
        scene.add_label("/set-point/name", "set-point", anchor="top-right")
        scene.add_label("/reference/name", "reference", anchor="bottom-left")
        none = np.zeros((1, 2, 3))
        self._force = scene.add_arrows(
            "/force", none, FORCE, shaft_radius=0.008, head_radius=0.02, head_length=0.04
        )
        self._torque = scene.add_arrows(
            "/torque", none, TORQUE, shaft_radius=0.008, head_radius=0.02, head_length=0.04
        )
        server.initial_camera.position = (1.6, -1.6, 1.6)
        server.initial_camera.look_at = (0.0, 0.0, 0.6)

    def show(self, sample: Sample) -> None:
        """Moves all parts to their poses at a moment."""
        _move(self._robot, sample.robot)
        _move(self._setpoint, sample.setpoint)
        _move(self._reference, sample.reference)
        tip = tool_pose(sample.robot, self._config).position
        self._force.points = _arrow(tip, FORCE_LENGTH * sample.force)
        self._torque.points = _arrow(tip, TORQUE_LENGTH * sample.torque)
        if len(sample.rotor_speeds) != len(self._rotors) or not np.isfinite(sample.rotor_speeds).all():
            return
        self._thrusts.points = self._thrust_arrows(self.reach.thrusts(sample.rotor_speeds))
        for disc, load in zip(self._discs, self.reach.loads(sample.rotor_speeds), strict=True):
            part = float(np.clip(load, 0.0, 1.0))
            red, green, blue = (round(float(x)) for x in CALM + part * (FULL - CALM))
            disc.color = (red, green, blue)
        # The attainable forces in addition to the force that carries the weight.
        self.hull.position = -REACH_LENGTH * self.reach.weight(sample.robot.rotation)

    def _thrust_arrows(self, thrusts: Array) -> Points:
        begins = np.array([rotor.begin for rotor in self._rotors])
        axes = np.array([rotor.end - rotor.begin for rotor in self._rotors])
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        arrows = np.stack([begins, begins + THRUST_LENGTH * thrusts[:, None] * axes], axis=1)
        return arrows.astype(np.float32)


def wxyz(rotation: Array) -> Array:
    """A rotation matrix as viser's quaternion, scalar first."""
    return np.asarray(vtf.SO3.from_matrix(rotation).wxyz)


def _move(handle: viser.SceneNodeHandle, pose: Pose) -> None:
    if np.isfinite(pose.position).all() and np.isfinite(pose.rotation).all():
        handle.position, handle.wxyz = pose.position, wxyz(pose.rotation)


def _arrow(begin: Array, along: Array) -> Points:
    """One arrow, (1, 2, 3); without length if its value is not known."""
    if not (np.isfinite(begin).all() and np.isfinite(along).all()):
        return np.zeros((1, 2, 3), np.float32)
    return np.stack([begin, begin + along])[None].astype(np.float32)


def _add(scene: viser.SceneApi, name: str, shape: Cylinder) -> viser.CylinderHandle:
    """Adds a cylinder; its own axis is z."""
    return scene.add_cylinder(
        name,
        radius=shape.radius,
        height=shape.length,
        color=shape.colour,
        opacity=shape.opacity if shape.opacity < 1.0 else None,
        # Shadows of transparent bodies would be dotted.
        cast_shadow=shape.opacity == 1.0,
        position=shape.centre,
        wxyz=wxyz(shape.rotation),
    )
