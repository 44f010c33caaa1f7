"""`tilthex fit`: what a flight says about the vehicle's model, by least squares."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex import log
from tilthex._core import Config, Vehicle

Vector = NDArray[np.float64]
WINDOW = 0.1
"""Length of the smoothing polynomial, s: both sides of each equation pass through it."""
VAGUE = 0.2
"""A figure whose standard error is above this part of it is not known from the flight."""


@dataclass(frozen=True)
class Flight:
    """One row a sample of a flight without contact."""

    time: Vector
    specific_force: Vector
    """At the centre of mass, m/s^2, robot, (N, 3)."""
    angular_velocity: Vector
    """rad/s, robot, (N, 3)."""
    rotor_speeds: Vector
    """Hz, (N, n)."""


@dataclass(frozen=True)
class Estimate:
    """A figure with its standard error."""

    name: str
    unit: str
    value: float
    error: float
    model: float
    """What the configuration says."""

    def __str__(self) -> str:
        figure = f"{self.name:20s} {self.value:12.5g} +- {self.error:9.2g} {self.unit:9s}"
        vague = self.model != 0.0 and self.error > VAGUE * abs(self.model)
        return f"{figure} (model: {self.model:.5g})" + ("  not excited enough to be known" if vague else "")


def fit(flight: Flight, vehicle: Vehicle, *, unknown: str = "thrust") -> list[Estimate]:
    """Fits thrust or mass, the principal moments of inertia and the wrench bias.

    Force: m s = k F1 u + b; torque: J dw/dt + w x J w = k F2 u + c, linear in
    (k, b) and (J, c). A flight shows only the ratio k of thrust to mass, so one
    of them is taken from the model.

    Args:
        flight: A flight without contact.
        vehicle: The model.
        unknown: "thrust" with the model's mass, or "mass" with the model's thrust coefficient.
    """
    if unknown not in ("thrust", "mass"):
        raise ValueError(f"unknown is {unknown!r}; expected 'thrust' or 'mass'")
    period = float(np.median(np.diff(flight.time)))
    half = max(2, round(WINDOW / period / 2))
    if len(flight.time) < 20 * half:
        raise ValueError(f"the flight has {len(flight.time)} samples; expected at least {20 * half}")
    speeds = flight.rotor_speeds
    produced = _smooth(speeds * abs(speeds) @ vehicle.allocation.T, half, period)
    force = vehicle.mass * _smooth(flight.specific_force, half, period)
    omega = _smooth(flight.angular_velocity, half, period)
    alpha = _smooth(flight.angular_velocity, half, period, derivative=1)

    samples = len(force)
    ones = np.tile(np.eye(3), (samples, 1))
    independent = max(1.0, samples / (2 * half + 1))
    (k, *force_bias), error = _solve(np.c_[produced[:, :3].ravel(), ones], force.ravel(), independent)
    # w x J w with J = diag(J): each row holds the products of the other two rates.
    x, y, z = omega.T
    ax, ay, az = alpha.T
    rows = np.stack(
        [np.c_[ax, -y * z, y * z], np.c_[x * z, ay, -x * z], np.c_[-x * y, x * y, az]], axis=1
    ).reshape(-1, 3)
    # Thrust is k times the model's, or it is the model's and the mass 1/k times.
    thrust, lighter = (k, 1.0) if unknown == "thrust" else (1.0, k)
    turned, turned_error = _solve(np.c_[rows, -ones], thrust * produced[:, 3:].ravel(), independent)

    if unknown == "thrust":
        figures = [Estimate("thrust ratio", "", k, error[0], 1.0)]
    else:
        figures = [Estimate("mass", "kg", vehicle.mass / k, vehicle.mass * error[0] / k**2, vehicle.mass)]
    moments = np.diag(vehicle.inertia)
    for i, axis in enumerate("xyz"):
        figures.append(Estimate(f"inertia {axis}", "kg m^2", turned[i], turned_error[i], moments[i]))
    for i, axis in enumerate("xyz"):
        figures.append(
            Estimate(f"force bias {axis}", "N", force_bias[i] / lighter, error[1 + i] / lighter, 0.0)
        )
    for i, axis in enumerate("xyz"):
        figures.append(Estimate(f"torque bias {axis}", "N m", turned[3 + i], turned_error[3 + i], 0.0))
    return figures


def _smooth(values: Vector, half: int, period: float, derivative: int = 0) -> Vector:
    from scipy.signal import savgol_filter

    smoothed = savgol_filter(values, 2 * half + 1, 3, deriv=derivative, delta=period, axis=0)
    return np.asarray(smoothed)[half:-half]


def _solve(matrix: Vector, right: Vector, independent: float) -> tuple[Vector, Vector]:
    """Least squares that forgives outliers, and standard errors for so many independent samples an axis."""
    from scipy.optimize import least_squares

    start = np.linalg.lstsq(matrix, right, rcond=None)[0]
    scale = float(np.median(abs(matrix @ start - right))) or 1e-9

    def residuals(x: Vector) -> Vector:
        return matrix @ x - right

    def jacobian(_: Vector) -> Vector:
        return matrix

    found = least_squares(residuals, start, jac=jacobian, loss="soft_l1", f_scale=2 * scale).x
    spread = float(np.median(abs(matrix @ found - right))) / 0.6745
    covariance = np.linalg.pinv(matrix.T @ matrix) * spread**2 * (len(right) / 3 / independent)
    return found, np.sqrt(np.diag(covariance))


def read(path: str | Path, begin: float | None = None, end: float | None = None) -> Flight:
    """The part of a log in which the vehicle flies, between two times since its start."""
    topics = log.read(path, ["/state", "/rotors", "/flight"])
    state, rotors, flight = topics["/state"], topics["/rotors"], topics["/flight"]
    time = state["log_time"]
    since = time - time[0]
    phase = flight["phase"][np.searchsorted(flight["log_time"], time).clip(max=len(flight["log_time"]) - 1)]
    keep = log.flying(phase)
    keep &= since >= (begin if begin is not None else 0.0)
    keep &= since <= (end if end is not None else np.inf)
    if not keep.any():
        raise ValueError(f"{path}: nothing is flown between those times; expected a part in flight")
    speeds = [np.interp(time[keep], rotors["log_time"], one) for one in rotors["measured"].T]
    return Flight(
        time=time[keep],
        specific_force=state["specific_force_r"][keep],
        angular_velocity=state["angular_velocity_r"][keep],
        rotor_speeds=np.stack(speeds, axis=1),
    )


def add_parser(commands: Any) -> None:
    """Adds the subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "fit", help="fit the vehicle's model to a flight's log", description=__doc__
    )
    parser.add_argument("log", type=Path, metavar="LOG", help="MCAP file of tilthex-rt")
    parser.add_argument(
        "--unknown", choices=("thrust", "mass"), default="thrust", help="the other is taken as known"
    )
    parser.add_argument(
        "--begin", type=float, metavar="S", help="use the log from this time on, s since its start"
    )
    parser.add_argument("--end", type=float, metavar="S", help="use the log up to this time")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> None:
    vehicle = Config.from_text(log.configuration(arguments.log)).vehicle
    flight = read(arguments.log, arguments.begin, arguments.end)
    for estimate in fit(flight, vehicle, unknown=arguments.unknown):
        print(estimate)
