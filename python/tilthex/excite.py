"""`tilthex excite`: a flight from which a vehicle's parameters can be identified, within limits."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tilthex._core import Trajectory, Vehicle

Array = NDArray[np.float64]

ROOM = 0.15
"""Part of each rotor's range of input that a hover at the largest tilt keeps free at either end."""


def largest_tilt(vehicle: Vehicle, wanted: float) -> float:
    """The largest tilt about any horizontal axis, rad, up to `wanted`, that leaves the rotors `ROOM`."""
    from scipy.spatial.transform import Rotation

    if vehicle.tracks != "position and attitude":
        return 0.0
    lower, upper = vehicle.rotor_speed_limits.T
    low, high = lower * abs(lower), upper * abs(upper)
    for tilt in np.arange(wanted, np.radians(2), -np.radians(0.5)):
        axes = [[np.cos(a), np.sin(a), 0] for a in np.arange(0, 2 * np.pi, np.pi / 6)]
        speeds = np.array(
            [vehicle.hover_speeds(Rotation.from_rotvec(tilt * np.array(a)).as_matrix()) for a in axes]
        )
        share = (speeds * abs(speeds) - low) / (high - low)
        if share.min() > ROOM and share.max() < 1 - ROOM:
            return float(tilt)
    return 0.0


def waypoints(
    vehicle: Vehicle,
    position: ArrayLike,
    *,
    heading: float = 0.0,
    radius: float = 0.4,
    tilt: float = np.radians(12.0),
    repeat: int = 2,
) -> list[dict[str, Any]]:
    """Way-points of the tool: rotations about each axis and about pairs of axes, climbs and sidesteps.

    Args:
        vehicle: The vehicle that flies.
        position: Position of the tool at the start, m, world, (3,).
        heading: Heading at the start, rad.
        radius: Largest distance of the centre of mass from its first position along each axis, m.
        tilt: Largest tilt, rad; smaller if the rotors have no room for it (`largest_tilt`).
        repeat: How often the whole sequence is flown.

    Returns:
        The way-points for `Trajectory` and the order `play`.
    """
    from scipy.spatial.transform import Rotation

    level = Rotation.from_euler("z", heading)
    tool = Rotation.from_matrix(vehicle.tool_rotation)
    centre = np.asarray(position, dtype=float) - level.apply(vehicle.tool_position)
    angle = largest_tilt(vehicle, tilt)
    turn = np.radians(25.0)
    moves: list[tuple[ArrayLike, ArrayLike]] = []
    for k, axis in enumerate(([1, 0, 0], [0, 1, 0], [1, 1, 0], [1, -1, 0])):
        size = angle * (1.0 if k < 2 else 0.7)
        moves += [([0, 0, 0], size * np.array(axis)), ([0, 0, 0], -size * np.array(axis))] * (
            2 if k < 2 else 1
        )
    moves += [([0, 0, 0], [0, 0, turn]), ([0, 0, 0], [0, 0, -turn])] * 2
    moves += [([0, 0, radius], [0, 0, 0]), ([0, 0, 0], [0, 0, 0])] * 2
    moves += [([radius, 0, 0], [0, 0, turn]), ([0, radius, 0], [0, 0, -turn])] * 2
    moves += [
        ([0, 0, radius], angle * np.array([0.7, 0, 1])),
        ([0, 0, 0], angle * np.array([0, -0.7, -1])),
    ] * 2
    if angle == 0.0:
        moves = [(p, [0, 0, np.asarray(r)[2]]) for p, r in moves]

    def at(move: ArrayLike, rotvec: ArrayLike, hold: float) -> dict[str, Any]:
        rotation = level * Rotation.from_rotvec(np.asarray(rotvec, dtype=float))
        place = centre + level.apply(np.asarray(move, dtype=float)) + rotation.apply(vehicle.tool_position)
        return {"position": place.tolist(), "rotation": (rotation * tool).as_matrix().tolist(), "hold": hold}

    still = at([0, 0, 0], [0, 0, 0], 2.0)
    return [still, *(at(m, r, 0.0) for _ in range(repeat) for m, r in moves), still]


LIMITS = {"velocity": 1.0, "acceleration": 3.0, "angular_velocity": 1.2, "angular_acceleration": 6.0}
"""Limits of the motion between way-points: m/s, m/s^2, rad/s, rad/s^2."""


def trajectory(vehicle: Vehicle, position: ArrayLike, **options: Any) -> Trajectory:
    """The flight of `waypoints`, within `LIMITS`."""
    return Trajectory(waypoints(vehicle, position, **options), **LIMITS)


def to_toml(vehicle: Vehicle, position: ArrayLike, **options: Any) -> str:
    """The flight of `waypoints` as a file for `tilthex-rt --trajectory`."""
    from scipy.spatial.transform import Rotation

    lines = [
        f"# Flown to learn the parameters of {vehicle.name} (tilthex excite); read by tilthex fit.",
        "[limits]",
    ]
    lines += [f"{name} = {value}" for name, value in LIMITS.items()]
    for point in waypoints(vehicle, position, **options):
        angles = Rotation.from_matrix(point["rotation"]).as_euler("ZYX", degrees=True)
        lines += ["", "[[waypoint]]", f"position = {_numbers(point['position'])}"]
        lines += [f"yaw_pitch_roll_deg = {_numbers(angles)}", f"hold = {point['hold']}"]
    return "\n".join(lines) + "\n"


def _numbers(values: ArrayLike) -> str:
    return "[" + ", ".join(f"{float(x) + 0.0:.6f}" for x in np.asarray(values)) + "]"


def add_parser(commands: Any) -> None:
    """Adds the subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "excite",
        help="write a flight from which a vehicle's parameters can be identified",
        description=__doc__,
    )
    parser.add_argument("vehicle", help="a preset, or a vehicle's or configuration's TOML file")
    parser.add_argument(
        "--position",
        type=float,
        nargs=3,
        default=[0.0, 0.0, 1.0],
        help="position of the tool at the start, m (default: 0 0 1)",
    )
    parser.add_argument("--heading-deg", type=float, default=0.0, help="heading at the start (default: 0)")
    parser.add_argument(
        "--radius",
        type=float,
        default=0.4,
        help="largest distance of the centre of mass from its first position, m (default: 0.4)",
    )
    parser.add_argument(
        "--tilt-deg",
        type=float,
        default=12.0,
        help="largest tilt (default: 12); smaller if the rotors have no room for it",
    )
    parser.add_argument("--out", type=Path, help="the file to write (default: standard output)")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> None:
    if not 0.05 <= arguments.radius <= 5.0:
        raise ValueError(f"--radius is {arguments.radius}; expected 0.05 to 5 m")
    if not 0.0 <= arguments.tilt_deg <= 30.0:
        raise ValueError(f"--tilt-deg is {arguments.tilt_deg}; expected 0 to 30")
    vehicle = Vehicle.named(arguments.vehicle)
    options = {
        "heading": float(np.radians(arguments.heading_deg)),
        "radius": arguments.radius,
        "tilt": float(np.radians(arguments.tilt_deg)),
    }
    text = to_toml(vehicle, arguments.position, **options)
    if arguments.out:
        arguments.out.write_text(text, encoding="utf-8")
        flight = trajectory(vehicle, arguments.position, **options)
        print(f"{arguments.out}: {flight.duration:.0f} s for tilthex-rt --trajectory; then `tilthex fit LOG`")
    else:
        print(text, end="")
