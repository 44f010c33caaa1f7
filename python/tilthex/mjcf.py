"""A vehicle as a MuJoCo model (MJCF).

The body frame is R with its origin in the centre of mass. The rotors are actuators: control i is the
rotor input u_i = w_i |w_i| in Hz^2, and its gear is column i of the allocation matrix (8)-(9), so that
thrust and drag moment act as in the controller's own model. The model has no rotor lag: the program that
sets the controls must apply it, because it acts on speeds and not on their squares.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from tilthex._core import GRAVITY, Vehicle
from tilthex._quaternions import quaternion_from_rotation

Vector = NDArray[np.float64]


TOOL_LENGTH = 0.2
"""Length of the tool's rod behind its tip, m."""
TOOL_RADIUS = 0.003
"""Radius of the tool's rod, m; its tip is a half-sphere about the tool's origin."""

ROTOR_RADIUS = 0.12
"""Radius of the discs that show the rotors, m."""

TIMESTEP = 0.001
"""Time step, s."""

# Contact parameters for this time step: stiff enough for 0.15 mm at 5 N, and a first solimp value
# near zero. With a larger value a sliding tip loses contact in every second step.
CONTACT = {"solref": "0.004 1", "solimp": "0.001 0.95 0.0001", "condim": "3"}


DAMPING = 0.02
"""Damping ratio of a bending rod in its first mode (Blevins, Formulas for natural frequency, ch. 2)."""


@dataclass(frozen=True)
class Rod:
    """A rod that bends: a rigid rod on two hinges with springs at its clamp."""

    stiffness: float
    """Lateral force at the tip divided by its lateral displacement, N/m."""
    length: float
    """Length from the clamp to the tip, m."""
    mass: float = 0.02
    """Mass of the rod, kg, which is part of the vehicle's mass; that of a carbon rod of 6 mm and 0.4
    m."""


def numbers(values: Iterable[float]) -> str:
    """Numbers as MJCF writes them, without loss of precision."""
    return " ".join(repr(float(x)) for x in values)


def quaternion(rotation: Vector) -> str:
    """A rotation matrix as MJCF's quaternion, w first."""
    x, y, z, w = quaternion_from_rotation(rotation)
    return numbers((w, x, y, z))


def contact_geom(parent: ET.Element, friction: float, **attributes: str) -> ET.Element:
    """A geom that collides, with one coefficient of friction between geoms of this kind."""
    return ET.SubElement(parent, "geom", CONTACT | {"friction": f"{friction!r} 0 0"} | attributes)


def robot_body(
    vehicle: Vehicle,
    position: Iterable[float],
    rotation: Vector,
    tool_length: float,
    feet: Sequence[ET.Element] = (),
    rod: Rod | None = None,
) -> ET.Element:
    """The robot: inertia, rod, sites `tool`, `imu`, `centre_of_mass`, and visible discs."""
    body = ET.Element("body", name="robot", pos=numbers(position), quat=quaternion(rotation))
    ET.SubElement(body, "freejoint", name="robot")
    tip, up = vehicle.tool_position, vehicle.tool_rotation[:, 2]
    mass, centre, inertia = vehicle.mass, np.zeros(3), vehicle.inertia
    # The tool's frame, and the body to which it is fixed.
    tool, origin, turned = body, tip, vehicle.tool_rotation
    if rod is not None:
        mass, centre, inertia = _without_rod(vehicle, rod)
        tool, origin, turned = _hang(body, vehicle, rod), np.array([0.0, 0.0, -rod.length]), np.eye(3)
    upper = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    inertial = ET.Element("inertial", pos=numbers(centre), mass=repr(float(mass)), fullinertia=numbers(upper))
    body.insert(1, inertial)
    contact_geom(
        tool,
        0.0,
        name="rod",
        type="capsule",
        size=repr(TOOL_RADIUS),
        fromto=numbers((*origin, *(origin + tool_length * turned[:, 2]))),
        rgba="0.75 0.75 0.78 1",
    )
    ET.SubElement(body, "site", name="centre_of_mass", pos="0 0 0")
    ET.SubElement(tool, "site", name="tool", pos=numbers(origin), quat=quaternion(turned))
    imu = {"pos": numbers(vehicle.imu_position), "quat": quaternion(vehicle.imu_rotation)}
    ET.SubElement(body, "site", imu, name="imu")
    _looks(body, vehicle, tip + tool_length * up)
    body.extend(feet)
    return body


def to_mjcf(
    vehicle: Vehicle,
    world: Sequence[ET.Element] = (),
    *,
    extra: Sequence[ET.Element] = (),
    feet: Sequence[ET.Element] = (),
    position: Iterable[float] = (0.0, 0.0, 1.0),
    rotation: Vector | None = None,
    tool_length: float = TOOL_LENGTH,
    rod: Rod | None = None,
) -> str:
    """A MuJoCo model of a vehicle among the bodies and geoms of `world`.

    Args:
        vehicle: The vehicle; rotors become actuators `rotor1`, `rotor2`, ... whose
            controls are inputs u = w |w| in Hz^2 within the rotors' limits.
        world: Elements of the world body.
        extra: Elements of the model itself, such as `equality`.
        feet: Elements of the robot's body, R; elements without mass do not change its inertia.
        position: Position of the centre of mass at the start, m, W.
        rotation: Rotation of the robot at the start, robot to world; level if it is missing.
        tool_length: Length of the rod behind the tip, m.
        rod: The bending of the rod, which then is a body `tool` on two hinges. A rigid rod if it is
            missing.

    Returns:
        The model as XML text. Sensors: `accelerometer`, `gyro` (IMU axes).
    """
    model = ET.Element("mujoco", model=vehicle.name)
    ET.SubElement(
        model,
        "option",
        timestep=repr(TIMESTEP),
        integrator="implicitfast",
        cone="elliptic",
        impratio="10",
        gravity=numbers((0.0, 0.0, -GRAVITY)),
    )
    visual = ET.SubElement(model, "visual")
    ET.SubElement(visual, "global", offwidth="1280", offheight="960")
    # Shadows as far as the floor is seen; beyond their range it would have specks.
    ET.SubElement(visual, "quality", shadowsize="8192")
    ET.SubElement(visual, "map", znear="0.002", shadowclip="20")
    ET.SubElement(visual, "headlight", ambient="0.35 0.35 0.35", diffuse="0.4 0.4 0.4", specular="0 0 0")
    # One colour: the few colours of a GIF are for what flies.
    sky = {"type": "skybox", "builtin": "flat", "rgb1": "0.8 0.87 0.95", "rgb2": "0.8 0.87 0.95"}
    ET.SubElement(ET.SubElement(model, "asset"), "texture", sky, width="64", height="384")
    body = ET.SubElement(model, "worldbody")
    ET.SubElement(body, "light", pos="1 -1 4", dir="-0.25 0.25 -1", directional="true")
    turned = np.eye(3) if rotation is None else rotation
    robot = robot_body(vehicle, position, turned, tool_length, feet, rod)
    # The robot's coordinates are the first of the model, also if a body of the world has joints.
    jointed = any(part.tag in ("joint", "freejoint") for element in world for part in element.iter())
    body.extend([robot, *world] if jointed else [*world, robot])
    actuators = ET.SubElement(model, "actuator")
    limits = vehicle.rotor_speed_limits
    inputs = limits * np.abs(limits)
    for i, column in enumerate(vehicle.allocation.T):
        ET.SubElement(
            actuators,
            "general",
            name=f"rotor{i + 1}",
            site="centre_of_mass",
            gear=numbers(column),
            ctrllimited="true",
            ctrlrange=numbers(inputs[i]),
        )
    sensors = ET.SubElement(model, "sensor")
    ET.SubElement(sensors, "accelerometer", name="accelerometer", site="imu")
    ET.SubElement(sensors, "gyro", name="gyro", site="imu")
    model.extend(extra if rod is None else [_on_the_rod(element) for element in extra])
    ET.indent(model)
    return ET.tostring(model, encoding="unicode")


def _hang(body: ET.Element, vehicle: Vehicle, rod: Rod) -> ET.Element:
    """The rod's body at its clamp, in the tool's axes, on hinges about x and y."""
    place = vehicle.tool_position + rod.length * vehicle.tool_rotation[:, 2]
    hung = ET.SubElement(
        body, "body", name="tool", pos=numbers(place), quat=quaternion(vehicle.tool_rotation)
    )
    across = rod.mass * rod.length**2 / 3.0
    stiffness = rod.stiffness * rod.length**2
    spring = {
        "stiffness": repr(stiffness),
        "damping": repr(2.0 * DAMPING * np.sqrt(stiffness * across).item()),
    }
    for name, axis in (("x", "1 0 0"), ("y", "0 1 0")):
        ET.SubElement(hung, "joint", spring, name=f"rod_{name}", type="hinge", axis=axis)
    own = rod.mass * rod.length**2 / 12.0
    middle, thin = numbers((0.0, 0.0, -0.5 * rod.length)), 0.5 * rod.mass * TOOL_RADIUS**2
    ET.SubElement(hung, "inertial", pos=middle, mass=repr(rod.mass), diaginertia=numbers((own, own, thin)))
    return hung


def _without_rod(vehicle: Vehicle, rod: Rod) -> tuple[float, Vector, Vector]:
    """Mass, centre of mass (R) and inertia about it of the vehicle without the rod.

    Together with the rod they give those of the vehicle.
    """
    up = vehicle.tool_rotation[:, 2]
    middle = vehicle.tool_position + 0.5 * rod.length * up
    mass = vehicle.mass - rod.mass
    centre = -rod.mass / mass * middle
    thin, own = 0.5 * rod.mass * TOOL_RADIUS**2, rod.mass * rod.length**2 / 12.0
    rods = own * (np.eye(3) - np.outer(up, up)) + thin * np.outer(up, up)

    def moved(m: float, c: Vector) -> Vector:
        return np.asarray(m * (c @ c * np.eye(3) - np.outer(c, c)))

    inertia = vehicle.inertia - rods - moved(rod.mass, middle) - moved(mass, centre)
    return mass, centre, inertia


def _on_the_rod(element: ET.Element) -> ET.Element:
    """An equality that holds the robot at its tool; it is moved to the rod."""
    text = ET.tostring(element, encoding="unicode").replace('body1="robot"', 'body1="tool"')
    return ET.fromstring(text)


def _looks(body: ET.Element, vehicle: Vehicle, rod_end: Vector) -> None:
    """Arms and discs, without mass or contact, where the rotors are."""
    unseen = {"contype": "0", "conaffinity": "0", "mass": "0"}
    dark = unseen | {"rgba": "0.2 0.22 0.25 1", "type": "capsule"}
    for rotor in vehicle.rotors:
        place, axis = np.array(rotor["position"]), np.array(rotor["axis"])
        if place @ place > 0.0:
            ET.SubElement(body, "geom", dark, size="0.008", fromto=numbers((0, 0, 0, *place)))
        disc = numbers((*place, *(place + 0.004 * axis)))
        ET.SubElement(
            body,
            "geom",
            unseen,
            type="cylinder",
            size=repr(ROTOR_RADIUS),
            fromto=disc,
            rgba="0.2 0.5 0.8 0.35",
        )
    ET.SubElement(body, "geom", dark, size="0.004", fromto=numbers((*rod_end, 0, 0, 0)))
