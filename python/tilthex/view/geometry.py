"""The shape of a vehicle, from its MuJoCo model, and the forces that it can produce."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tilthex import so3
from tilthex.polytope import NO_TORQUE, wrench_polytope

if TYPE_CHECKING:
    from tilthex import Vehicle

Array = NDArray[np.float64]

ROTOR_RADIUS = 0.02
"""Cylinders of at least this radius are rotors, m; thinner ones are arms and rods."""


@dataclass(frozen=True)
class Cylinder:
    """A cylinder or capsule, in robot coordinates."""

    begin: Array
    """(3,), m."""
    end: Array
    """(3,), m."""
    radius: float
    """m."""
    colour: tuple[int, int, int]
    opacity: float

    @property
    def centre(self) -> Array:
        """(3,), m."""
        return 0.5 * (self.begin + self.end)

    @property
    def length(self) -> float:
        """M."""
        return float(np.linalg.norm(self.end - self.begin))

    @property
    def rotation(self) -> Array:
        """A rotation (3, 3) that maps the z axis to the axis of the cylinder."""
        return turn([0.0, 0.0, 1.0], self.end - self.begin)

    @property
    def is_rotor(self) -> bool:
        """Whether it is a rotor. Rotors are in their order in the vehicle."""
        return self.radius >= ROTOR_RADIUS


def turn(axis: ArrayLike, direction: Array) -> Array:
    """The shortest rotation (3, 3) that maps a unit axis to a direction."""
    begin, end = np.asarray(axis, dtype=float), direction / np.linalg.norm(direction)
    across = np.cross(begin, end)
    sine, cosine = float(np.linalg.norm(across)), float(begin @ end)
    if sine < 1e-9:
        # The same direction, or the opposite one: then 180 deg about any axis normal to it.
        other = np.cross(begin, np.eye(3)[np.argmin(np.abs(begin))])
        return np.eye(3) if cosine > 0.0 else so3.exp(np.pi * other / np.linalg.norm(other))
    return so3.exp(np.arctan2(sine, cosine) * across / sine)


def cylinders(vehicle: Vehicle) -> list[Cylinder]:
    """The geoms of the body `robot` in the vehicle's MuJoCo model."""
    robot = ET.fromstring(vehicle.to_mjcf()).find(".//body[@name='robot']")
    assert robot is not None, "to_mjcf writes a body of this name"
    return [_cylinder(geom) for geom in robot.iter("geom") if geom.get("type") in ("capsule", "cylinder")]


def _cylinder(geom: ET.Element) -> Cylinder:
    ends = np.array(geom.get("fromto", "").split(), dtype=float).reshape(2, 3)
    red, green, blue, opacity = (float(x) for x in geom.get("rgba", "0.5 0.5 0.5 1").split())
    colour = (round(255 * red), round(255 * green), round(255 * blue))
    return Cylinder(ends[0], ends[1], float(geom.get("size", "0").split()[0]), colour, opacity)


class Reach:
    """The forces that the rotors can produce without a torque, and their distance from the limits.

    Attributes:
        vertices: (v, 3), N, R: corners of the attainable forces.
        faces: (f, 3): triangles of their hull, as rows of `vertices`.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._weight = vehicle.weight
        self._set = wrench_polytope(vehicle, fix=NO_TORQUE)
        self._allocation = vehicle.allocation[:3]
        self._lower, self._upper = _inputs(vehicle.rotor_speed_limits).T
        axes = np.array([rotor["axis"] for rotor in vehicle.rotors])
        # N/Hz^2, along each rotor's own axis.
        self._along = np.sum(self._allocation.T * axes, axis=1)
        self.vertices = self._set.vertices
        self.faces = np.zeros((0, 3), dtype=np.uint32)
        if self._set.dimension == 3:
            from scipy.spatial import ConvexHull

            self.faces = np.asarray(ConvexHull(self.vertices).simplices, dtype=np.uint32)

    def weight(self, rotation: Array) -> Array:
        """The force that carries the weight, N, robot axes, at a rotation (3, 3) of the robot."""
        return np.asarray(rotation.T @ np.array([0.0, 0.0, self._weight]))

    def margin(self, rotor_speeds: Array) -> float:
        """Distance of the rotors' force from the edge of the attainable forces, N; negative outside.

        Infinite for a vehicle whose attainable forces have no volume, because all of them are on the
        edge.
        """
        if self._set.dimension < 3:
            return float("inf")
        return float(self._set.margin(self._allocation @ _inputs(rotor_speeds)))

    def loads(self, rotor_speeds: Array) -> Array:
        """Load of each rotor: 0 at its lower limit of thrust, 1 at the upper; (n,)."""
        return np.asarray((_inputs(rotor_speeds) - self._lower) / (self._upper - self._lower))

    def thrusts(self, rotor_speeds: Array) -> Array:
        """Thrust of each rotor along its axis, N; (n,)."""
        return np.asarray(self._along * _inputs(rotor_speeds))


def _inputs(rotor_speeds: Array) -> Array:
    """Rotor inputs, Hz^2, of speeds, Hz."""
    return rotor_speeds * np.abs(rotor_speeds)
