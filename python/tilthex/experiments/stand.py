"""The start of a vehicle with `--wire`: feet, and a stand beside the scene.

The feet are so short that they do not reach the scene while the tool touches it. The stand is two beams,
and the tool hangs between them.
"""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from tilthex import Vehicle
from tilthex.experiments.scenes import METAL, Scene
from tilthex.mjcf import contact_geom, numbers

Vector = NDArray[np.float64]

PLACE = (-1.3, 0.0)
"""Position of the vehicle's centre of mass at the start, m, W: beside every scene."""
STANCE = 0.3
"""Half the distance between neighbouring feet, m."""
FOOT = 0.1
"""Height of the centre of mass above the feet, m."""
RADIUS = 0.01
"""Radius of a foot, m."""
GAP = 0.05
"""Height of the tool's tip above the floor, m."""
FRICTION = 0.6


def start(vehicle: Vehicle) -> Vector:
    """Position of the centre of mass on the stand, m, W."""
    return np.array([*PLACE, max(-float(vehicle.tool_position[2]), FOOT) + GAP])


def feet() -> list[ET.Element]:
    """Four feet without mass, for the body of the robot."""
    body = ET.Element("body")
    for x, y in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
        place = numbers((x * STANCE, y * STANCE, RADIUS - FOOT))
        contact_geom(body, FRICTION, type="sphere", size=repr(RADIUS), pos=place, mass="0", rgba=METAL)
    return list(body)


def beside(scene: Scene, vehicle: Vehicle) -> Scene:
    """The scene with the stand and a solid floor."""
    height = float(start(vehicle)[2]) - FOOT
    body = ET.Element("body", name="stand")
    for side in (-STANCE, STANCE):
        place, half = (PLACE[0], PLACE[1] + side, 0.5 * height), (0.5, 0.08, 0.5 * height)
        contact_geom(body, FRICTION, type="box", pos=numbers(place), size=numbers(half), rgba=METAL)
    contact_geom(body, FRICTION, name="ground", type="plane", size="4 4 0.1", rgba="0 0 0 0")
    return replace(scene, elements=(*scene.elements, body))
