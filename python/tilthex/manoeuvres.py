"""`tilthex manoeuvres`: the effect of rotor limits on a flight, with the allocator and with a clip.

Flies manoeuvres that demand more than the rotors can produce, with the flight of `tilthex-rt`. To
compare, flies them with a controller that ignores the limits: it always holds the attitude of the
reference, and clips the inputs `A^+ w`.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tilthex import (
    GRAVITY,
    Config,
    Controller,
    Drawn,
    Loop,
    Plant,
    Setpoint,
    Truth,
    Vehicle,
    WrenchObserver,
    _json,
    so3,
)
from tilthex.simulation import TRUTH_HELP

Array = NDArray[np.float64]
PERIOD = 0.002
START = 1.0
"""Time at which a manoeuvre begins, s."""
MANOEUVRES = ("step", "push", "roll")
"""2 m sideways at once; 10 N on the centre of mass for one second; 60 deg of roll commanded at once."""
WAYS = ("clip", "fixed", "turned")
"""A clip; the allocator with the reference's attitude; the allocator with an attitude that yields."""


@dataclass(frozen=True)
class Flight:
    """One flight, sampled at 500 Hz.

    Attributes:
        time: (N,), s.
        position_error: (N,), m, of the centre of mass.
        attitude_error: (N,), deg, from the attitude to which the controller flies.
        tilt: (N,), deg.
        false_force: (N,), N: observed external force minus the force that the same observer gives for the
            push on a vehicle at rest.
        saturated: Share of the ticks in which a limit was active.
        lost: Whether the vehicle turned over or flew away.
    """

    time: Array
    position_error: Array
    attitude_error: Array
    tilt: Array
    false_force: Array
    saturated: float
    lost: bool


def fly(
    vehicle: Vehicle,
    manoeuvre: str,
    way: str,
    seconds: float = 6.0,
    drawn: Drawn | None = None,
    **sections: Any,
) -> Flight:
    """Flies one of `MANOEUVRES` in one of `WAYS` from a hover, on the simulated plant with exact sensors.

    Args:
        vehicle: The vehicle.
        manoeuvre: The manoeuvre.
        way: How limits are treated.
        seconds: Duration, s.
        drawn: The true vehicle, if it differs from its model; its sensors stay ideal.
        **sections: Changes of the vehicle's default configuration.
    """
    for name, found, known in (("manoeuvre", manoeuvre, MANOEUVRES), ("way", way, WAYS)):
        if found not in known:
            raise ValueError(f"{name} is `{found}`; expected one of {', '.join(known)}")
    fully = np.linalg.matrix_rank(vehicle.allocation) == 6
    if way != "turned" and fully:
        sections = {**sections, "attitude": {"mode": "fixed-tilt"}}
    config = Config.default(vehicle).replace(**sections)
    at_rest = WrenchObserver(vehicle, config)
    true_vehicle = vehicle if drawn is None else drawn.vehicle
    plant = Plant(true_vehicle, [0.0, 0.0, 1.0], effects=None if drawn is None else drawn.effects())
    pilot = _Clipped(config) if way == "clip" else _Flown(config, plant)
    home, home_rotation = plant.tool_position, plant.tool_rotation
    count = round(seconds / PERIOD)
    tilt, felt_at_rest = np.full(count, np.nan), np.full((count, 3), np.nan)
    lost = False
    felt_push = np.zeros(3)
    for k in range(count):
        begun = k * PERIOD >= START
        push = np.zeros(6)
        place, rotation = home, home_rotation
        if begun and manoeuvre == "step":
            place = home + np.array([2.0, 0.0, 0.0])
        elif begun and manoeuvre == "push" and k * PERIOD < START + 1.0:
            push[0] = 10.0
        elif begun and manoeuvre == "roll":
            # About the centre of mass, whose position stays commanded.
            rotation = so3.exp(np.array([math.radians(60), 0.0, 0.0])) @ home_rotation
            place = [0.0, 0.0, 1.0] + rotation @ vehicle.tool_rotation.T @ vehicle.tool_position
        command = pilot.step((k + 1) * PERIOD, plant, Setpoint(position=place, rotation=rotation))
        tilt[k] = math.degrees(math.acos(min(1.0, max(-1.0, plant.rotation[2, 2]))))
        felt_at_rest[k] = at_rest.step(
            rotation=np.eye(3),
            angular_velocity=np.zeros(3),
            specific_force=(felt_push / vehicle.mass) + [0.0, 0.0, GRAVITY],
            rotor_speeds=vehicle.hover_speeds(),
        )[:3]
        felt_push = push[:3]
        plant.step(command, wrench=push, dt=PERIOD)
        if not np.linalg.norm(plant.position) < 50:
            lost = True
            break
    flown = pilot.columns()
    steps = len(flown.saturated)
    lost = lost or bool(np.nanmax(tilt) > 120)

    def padded(values: Array) -> Array:
        return np.concatenate((values, np.full(count - steps, np.nan)))

    return Flight(
        time=np.asarray(np.arange(count) * PERIOD, dtype=float),
        position_error=padded(flown.position_error),
        attitude_error=padded(flown.attitude_error),
        tilt=tilt,
        false_force=padded(np.linalg.norm(flown.force - felt_at_rest[:steps], axis=1)),
        saturated=float(flown.saturated.sum()) / count,
        lost=lost,
    )


@dataclass(frozen=True)
class _Columns:
    """The values of each period: m, deg, N (n, 3), and whether a limit was active."""

    position_error: Array
    attitude_error: Array
    force: Array
    saturated: Array


class _Flown:
    """The flight of `tilthex-rt`, with a supervisor that does not stop a manoeuvre."""

    LIMITS: ClassVar[dict[str, float]] = {
        "max_position_error": 10.0,
        "max_rotation_error_deg": 90.0,
        "max_tilt_deg": 180.0,
        "max_speed": 100.0,
        "geofence": 1e4,
        "geofence_height": 1e4,
    }

    def __init__(self, config: Config, plant: Plant) -> None:
        self._loop = Loop(config.replace(supervisor=self.LIMITS))
        self._loop.initialize(0.0, plant.position, plant.rotation)

    def step(self, time: float, plant: Plant, setpoint: Setpoint) -> Array:
        return self._loop.step_from(time, setpoint=setpoint, **plant.measured)

    def columns(self) -> _Columns:
        record = self._loop.record()
        # |e_R| is the sine of the angle.
        sine = np.minimum(1.0, np.linalg.norm(record["rotation_error"], axis=1))
        return _Columns(
            position_error=np.linalg.norm(record["position_error"], axis=1),
            attitude_error=np.degrees(np.arcsin(sine)),
            force=record["wrench_robot"][:, :3],
            saturated=record["saturated"][:, 0],
        )


class _Clipped:
    """The comparison: the controller with its inputs `A^+ w` clipped at the limits.

    No program flies this way.
    """

    def __init__(self, config: Config) -> None:
        vehicle = config.vehicle
        self._controller = Controller(vehicle, config)
        self._inverse = np.linalg.pinv(vehicle.allocation)
        self._lower, self._upper = (vehicle.rotor_speed_limits * np.abs(vehicle.rotor_speed_limits)).T
        self._rows: list[tuple[float, float, Array, bool]] = []

    def step(self, time: float, plant: Plant, setpoint: Setpoint) -> Array:
        out = self._controller.step(setpoint=setpoint, **plant.measured)
        turn = out.robot_reference.rotation.T @ plant.rotation
        attitude_error = math.degrees(float(np.linalg.norm(so3.log(turn))))
        self._rows.append(
            (float(np.linalg.norm(out.position_error)), attitude_error, out.wrench_robot[:3], out.saturated)
        )
        inputs = np.clip(self._inverse @ out.wanted_wrench, self._lower, self._upper)
        return np.asarray(np.sign(inputs) * np.sqrt(np.abs(inputs)), float)

    def columns(self) -> _Columns:
        return _Columns(*(np.array(column, float) for column in zip(*self._rows, strict=True)))


def add_parser(subparsers: Any) -> None:
    """Registers the command with the parsers of `tilthex`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "manoeuvres",
        help="fly manoeuvres beyond the rotors' limits, with the allocator and with a clip",
        description="Flies these manoeuvres with every vehicle, prints a table and plots each.",
    )
    parser.add_argument(
        "--vehicle", action="append", help="a preset or a TOML file, any number of times (default: all)"
    )
    parser.add_argument("--truth", metavar="LEVEL", help=TRUTH_HELP)
    parser.add_argument("--seed", type=int, default=1, help="with --truth: seed of the vehicle")
    parser.add_argument("--out", type=Path, default=Path("out/manoeuvres"), help="folder of the plots")
    _json.add_option(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Flies all manoeuvres, prints a Markdown table and writes a plot for each vehicle."""
    arguments.out.mkdir(parents=True, exist_ok=True)
    columns = (
        "vehicle",
        "manoeuvre",
        "way",
        "attitude error, most [deg]",
        "position error, end [m]",
        "saturated",
        "false contact, most [N]",
    )
    flown: list[dict[str, object]] = []
    if not arguments.json:
        print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|")
    for name in arguments.vehicle or Vehicle.presets():
        vehicle = Vehicle.named(name)
        drawn = Truth(vehicle, arguments.truth).draw(arguments.seed)
        ways = WAYS if np.linalg.matrix_rank(vehicle.allocation) == 6 else ("clip", "turned")
        flights = {(m, w): fly(vehicle, m, w, drawn=drawn) for m in MANOEUVRES for w in ways}
        for (manoeuvre, way), flight in flights.items():
            attitude = float(np.nanmax(attitude_errors(flight, manoeuvre, way)))
            end, force = float(flight.position_error[-1]), float(np.nanmax(flight.false_force))
            if arguments.json:
                flown.append(
                    {
                        "vehicle": vehicle.name,
                        "manoeuvre": manoeuvre,
                        "way": way,
                        "lost": flight.lost,
                        "attitude_error_deg": attitude,
                        "position_error": end,
                        "saturated": flight.saturated,
                        "false_contact": force,
                    }
                )
                continue
            cells = (
                vehicle.name,
                manoeuvre,
                way,
                f"{attitude:.1f}",
                "lost" if flight.lost else f"{end:.3f}",
                f"{100 * flight.saturated:.0f} %",
                f"{force:.3f}",
            )
            print(f"| {' | '.join(cells)} |")
        stem = Path(name).stem
        _plot(flights, ways, vehicle.name, arguments.out / f"{stem}.png")
    if arguments.json:
        _json.say({"flights": flown})


def attitude_errors(flight: Flight, manoeuvre: str, way: str) -> Array:
    """The attitude errors that count, deg.

    For an attitude that does not yield, the error of a roll begins at 60 deg.
    """
    begin = START + 1.5 if manoeuvre == "roll" and way != "turned" else 0.0
    return flight.attitude_error[flight.time >= begin]


def _plot(flights: dict[tuple[str, str], Flight], ways: tuple[str, ...], title: str, path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 7), layout="constrained")
    figure.suptitle(title)
    for column, manoeuvre in enumerate(MANOEUVRES):
        upper = figure.add_subplot(2, 3, column + 1, title=manoeuvre, ylabel="attitude error [deg]")
        lower = figure.add_subplot(2, 3, column + 4, xlabel="time [s]", ylabel="position error [m]")
        for way in ways:
            flight = flights[manoeuvre, way]
            upper.plot(flight.time, flight.attitude_error, label=way)
            lower.plot(flight.time, flight.position_error, label=way)
        # A lost flight leaves the picture; the others stay readable.
        upper.set_ylim(0, 20)
        lower.set_ylim(0, 3)
        for axes in (upper, lower):
            axes.grid(alpha=0.4)
        upper.axhline(5, color="k", linestyle=":", linewidth=1)
        upper.legend()
    figure.savefig(path, dpi=110)
