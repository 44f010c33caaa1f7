"""`tilthex px4`: a vehicle as PX4's parameters `CA_ROTOR*`, and their check (docs/howto/px4.md).

PX4's axes are forward, right, down. Motor n of PX4, with the parameters `CA_ROTOR{n-1}_*`, is rotor n of the
vehicle. A file of parameters is one that QGroundControl saves and loads.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex import Vehicle, _json
from tilthex.check import named

PLACE = 0.02
"""Largest distance between the places of a motor in the two descriptions, m."""
ANGLE = 2.0
"""Largest angle between the axes of a motor in the two descriptions, degrees."""
FLU_TO_FRD = np.array([1.0, -1.0, -1.0])
TYPES = {int: 6, float: 9}
"""MAVLink's numbers of the types of parameters."""


def add_parser(subparsers: Any) -> None:
    """Registers the command with the parsers of `tilthex`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "px4",
        help="write or check the parameters of PX4 that describe a vehicle's rotors",
        description="Prints PX4's parameters CA_ROTOR* of a vehicle in the format of QGroundControl, or "
        "checks a file of parameters: order, places, axes and directions (the sign of KM) of the motors. "
        "Exit status of a check: 0 if all agree, 2 if not.",
    )
    parser.add_argument("config", help="a configuration, a vehicle's TOML file, or a preset")
    todo = parser.add_mutually_exclusive_group()
    todo.add_argument("--out", type=Path, metavar="FILE.params", help="write the parameters to this file")
    todo.add_argument("--check", type=Path, metavar="FILE.params", help="check the parameters in this file")
    _json.add_option(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Prints or writes the parameters, or the differences.

    Raises:
        ValueError: The checked parameters differ from the vehicle, or the file holds no parameters.
    """
    vehicle = named(arguments.config).vehicle
    if arguments.check:
        found = list(differences(vehicle, read(arguments.check)))
        if arguments.json:
            _json.say({"vehicle": vehicle.name, "file": arguments.check, "differences": found})
        if found:
            raise ValueError(f"{arguments.check}: " + "; ".join(found))
        if not arguments.json:
            print(
                f"{arguments.check}: the {vehicle.rotor_count} motors of PX4 are the rotors of {vehicle.name}"
            )
        return
    lines = ["# Vehicle-Id Component-Id Name Value Type"]
    lines += [f"1\t1\t{name}\t{value}\t{TYPES[type(value)]}" for name, value in parameters(vehicle).items()]
    if arguments.out:
        arguments.out.write_text("\n".join(lines) + "\n", encoding="utf-8")
        if not arguments.json:
            print(f"written: {arguments.out}")
    if arguments.json:
        _json.say({"vehicle": vehicle.name, "parameters": parameters(vehicle)})
    elif not arguments.out:
        print("\n".join(lines))


def parameters(vehicle: Vehicle) -> dict[str, int | float]:
    """The parameters of PX4 that describe the rotors of a vehicle."""
    found: dict[str, int | float] = {"CA_ROTOR_COUNT": vehicle.rotor_count}
    for index, rotor in enumerate(vehicle.rotors):
        place, axis = FLU_TO_FRD * rotor["position"], FLU_TO_FRD * rotor["axis"]
        moment = -rotor["spin"] * rotor["drag_coefficient"] / rotor["thrust_coefficient"]
        for name, x in zip((*_PLACE, *_AXIS, "KM"), (*place, *axis, moment), strict=True):
            # A sum with 0 has no negative zero.
            found[f"CA_ROTOR{index}_{name}"] = float(x) + 0.0
    return found


def read(path: Path) -> dict[str, float]:
    """The parameters in a file that QGroundControl has saved.

    Raises:
        ValueError: The file holds no parameters.
    """
    columns = [line.split() for line in path.read_text(encoding="utf-8").splitlines() if line[:1] != "#"]
    found = {row[2]: float(row[3]) for row in columns if len(row) == 5}
    if not found:
        raise ValueError(f"{path} holds no parameters; expected a file that QGroundControl has saved")
    return found


def differences(vehicle: Vehicle, found: dict[str, float]) -> Iterator[str]:
    """Says in one sentence each how parameters of PX4 differ from a vehicle."""
    expected = parameters(vehicle)
    if found.get("CA_ROTOR_COUNT", 0) != vehicle.rotor_count:
        count = found.get("CA_ROTOR_COUNT", 0)
        yield f"CA_ROTOR_COUNT is {count:g}; {vehicle.name} has {vehicle.rotor_count} rotors"
        return
    missing = [name for name in expected if name not in found]
    if missing:
        yield f"{missing[0]} is missing; expected the parameters of every motor"
        return
    places = [_vector(expected, other, _PLACE) for other in range(vehicle.rotor_count)]
    for index in range(vehicle.rotor_count):
        yield from _place(places, index, _vector(found, index, _PLACE))
        axis, wanted = _vector(found, index, _AXIS), _vector(expected, index, _AXIS)
        aligned = axis @ wanted >= np.cos(np.radians(ANGLE)) * np.linalg.norm(axis) * np.linalg.norm(wanted)
        if not axis.any() or not aligned:
            yield f"CA_ROTOR{index}_AX, _AY, _AZ are {_text(axis)}; expected {_text(wanted)}"
        moment, wanted_moment = found[f"CA_ROTOR{index}_KM"], expected[f"CA_ROTOR{index}_KM"]
        if wanted_moment and not moment * wanted_moment > 0.0:
            turns = "counter-clockwise" if wanted_moment > 0.0 else "clockwise"
            yield (
                f"CA_ROTOR{index}_KM is {moment:g}; expected {wanted_moment:.3g}: "
                f"rotor {index + 1} turns {turns}, seen against its thrust"
            )


_PLACE, _AXIS = ("PX", "PY", "PZ"), ("AX", "AY", "AZ")


def _place(places: list[NDArray[Any]], index: int, found: NDArray[Any]) -> Iterator[str]:
    """Compares the place of a motor, and says whose place it is if it is that of another rotor."""
    away = [float(np.linalg.norm(found - place)) for place in places]
    if away[index] <= PLACE:
        return
    nearest = int(np.argmin(away))
    if away[nearest] <= PLACE:
        yield f"motor {index + 1} of PX4 (CA_ROTOR{index}) is at the place of rotor {nearest + 1}"
    else:
        yield f"CA_ROTOR{index}_PX, _PY, _PZ are {_text(found)} m; expected {_text(places[index])} m"


def _vector(values: dict[str, Any], index: int, names: tuple[str, ...]) -> NDArray[Any]:
    return np.array([float(values[f"CA_ROTOR{index}_{name}"]) for name in names])


def _text(vector: NDArray[Any]) -> str:
    return ", ".join(f"{x:.3g}" for x in vector)
