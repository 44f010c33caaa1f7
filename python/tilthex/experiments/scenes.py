"""The worlds of the experiments: each scene builds the elements of a MuJoCo world body.

The place and the friction of a scene are keyword arguments, which an experiment's file gives in its
`[world]` section under `scene = NAME`. The tool's origin is the centre of the half-sphere of its tip: if
the tip touches a plane, the origin is one tip radius away from it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tilthex.mjcf import TOOL_RADIUS, contact_geom, numbers, quaternion

Vector = NDArray[np.float64]
WOOD = "0.72 0.58 0.42 1"
METAL = "0.55 0.6 0.65 0.45"


@dataclass(frozen=True)
class Scene:
    """A world, and the parts of its geometry that the checks of an experiment need."""

    elements: tuple[ET.Element, ...]
    extra: tuple[ET.Element, ...] = ()
    rotation: Vector = field(default_factory=lambda: np.eye(3))
    """Orientation of the scene: maps its coordinates (z along plane normal or hole axis) to W."""
    origin: Vector = field(default_factory=lambda: np.zeros(3))
    """A point of the plane, or the middle of the entrance of the tube, m, W."""
    look_at: tuple[float, float, float] | None = None
    """The point at which a camera looks, m, W; the middle of the flight if it is missing."""

    def along(self, points: Vector) -> Vector:
        """Points of W in the scene's coordinates, one per row."""
        return (points - self.origin) @ self.rotation


def free_air() -> Scene:
    """A floor that is only visible."""
    return Scene((floor(),))


def plane(*, point: list[float], tilt_deg: list[float], friction: float = 0.2, size: float = 0.6) -> Scene:
    """A board through `point` (m), rotated about x, then about y of the world (deg)."""
    rotation = Rotation.from_euler("xy", tilt_deg, degrees=True).as_matrix()
    board = ET.Element("body", name="board", pos=numbers(point), quat=quaternion(rotation))
    contact_geom(board, friction, type="box", size=f"{size} {size} 0.02", pos="0 0 -0.02", rgba=WOOD)
    at = np.array(point)
    return Scene((floor(), board), rotation=rotation, origin=at)


@dataclass(frozen=True)
class Funnel:
    """Dimensions of the funnel, m."""

    mouth: float = 0.028
    cone: float = 0.012
    tube: float = 0.009
    depth: float = 0.048


def funnel(
    *,
    entrance: list[float],
    tilt_deg: float,
    direction_deg: float = 90.0,
    friction: float = 0.2,
    sides: int = 16,
) -> Scene:
    """A cone that narrows to a tube with a closed end, made of convex boxes; its axis is tilted.

    `entrance` is the middle of the entrance of the tube, m. The axis is the vertical rotated by
    `tilt_deg` about the horizontal direction at `direction_deg` from x. Each face of the cone ends at the
    entrance. The inside is the intersection of the faces' half-spaces, so that wide boxes do not reach
    into it.
    """
    size = Funnel()
    turn = math.radians(direction_deg)
    axis = np.array([math.cos(turn), math.sin(turn), 0.0])
    rotation = Rotation.from_rotvec(math.radians(tilt_deg) * axis).as_matrix()
    body = ET.Element("body", name="funnel", pos=numbers(entrance), quat=quaternion(rotation))
    wall = 0.006
    tube, mouth = 0.5 * size.tube, 0.5 * size.mouth
    slope = math.hypot(size.cone, mouth - tube)
    along = np.array([mouth - tube, 0.0, size.cone]) / slope
    inward = np.array([-along[2], 0.0, along[0]])
    face = np.column_stack([along, np.cross(inward, along), inward])
    width = math.tan(math.pi / sides)
    for k in range(sides):
        around = Rotation.from_euler("z", 2.0 * math.pi * k / sides).as_matrix()
        contact_geom(
            body,
            friction,
            type="box",
            pos=numbers(around @ [tube + 0.5 * wall, 0.0, -0.5 * size.depth]),
            quat=quaternion(around),
            size=numbers((0.5 * wall, (tube + wall) * width, 0.5 * size.depth)),
            rgba=METAL,
        )
        centre = np.array([tube, 0.0, 0.0]) + 0.5 * slope * along - 0.5 * wall * inward
        contact_geom(
            body,
            friction,
            type="box",
            pos=numbers(around @ centre),
            quat=quaternion(around @ face),
            size=numbers((0.5 * slope, mouth * width + 0.001, 0.5 * wall)),
            rgba=METAL,
        )
    end = numbers((0.0, 0.0, -size.depth - 0.005))
    contact_geom(body, friction, type="cylinder", pos=end, size=f"{tube + wall} 0.005", rgba=METAL)
    at = np.array(entrance)
    return Scene((floor(), body), rotation=rotation, origin=at)


def plate_with_ledges(
    *, point: list[float], ledge_x: float, ledge_y: float, friction: float = 0.2, height: float = 0.03
) -> Scene:
    """A level plate through `point` (m) with two upright ledges.

    The tool's origin touches them at x = `ledge_x` and y = `ledge_y`, m.
    """
    plate = ET.Element("body", name="plate", pos=numbers(point))
    at = np.array(point)
    contact_geom(plate, friction, type="box", size="0.4 0.4 0.01", pos="0 0 -0.01", rgba=WOOD)
    thick = 0.01
    x = ledge_x + TOOL_RADIUS + thick - at[0]
    y = ledge_y + TOOL_RADIUS + thick - at[1]
    tall = 0.5 * height
    for position, half in (((x, 0.0), (thick, 0.4)), ((0.0, y), (0.4, thick))):
        contact_geom(
            plate,
            friction,
            type="box",
            pos=numbers((*position, tall)),
            size=numbers((*half, tall)),
            rgba=METAL,
        )
    return Scene((floor(), plate), origin=at)


def clamp(*, stiffness_time: float = 0.004) -> Scene:
    """The tool fixed to the world, as by a six-axis sensor: a weld at its origin."""
    equality = ET.Element("equality")
    ET.SubElement(
        equality,
        "weld",
        name="sensor",
        body1="robot",
        solref=f"{stiffness_time!r} 1",
        solimp="0.95 0.99 0.0001",
    )
    return Scene((floor(),), extra=(equality,))


SCENES: dict[str, Callable[..., Scene]] = {
    "free": free_air,
    "plane": plane,
    "funnel": funnel,
    "plate-with-ledges": plate_with_ledges,
    "clamp": clamp,
}


def floor() -> ET.Element:
    """A visible floor below everything, without contact."""
    look = {"contype": "0", "conaffinity": "0", "rgba": "0.7 0.71 0.7 1"}
    return ET.Element("geom", look, name="floor", type="plane", size="0 0 0.1")
