"""The topics of a log and the state of a flight, as tilthex-rt declares them.

Written by `TILTHEX_WRITE_DOCS=1 cargo test --workspace --test log_document`; do not change it by hand.
"""
# ruff: noqa: E501

from __future__ import annotations

from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TOPICS = {
    "/state": "State",
    "/setpoint": "Target",
    "/reference": "Target",
    "/wrench": "Wrenches",
    "/control": "Control",
    "/rotors": "Rotors",
    "/flight": "Flight",
    "/link": "Link",
    "/model": "Model",
    "/input": "Input",
    "/output": "Output",
    "/timing": "Timing",
    "/command": "Command",
    "/truth": "Truth",
}
"""The topics of a flight and the messages that they hold."""


class Target(TypedDict):
    """A set-point of the tool."""

    position: Array
    """Position of the tool tip. [m]"""
    rotation: Array
    """Rotation of the tool."""
    velocity: Array
    """Velocity. [m/s]"""
    angular_velocity: Array
    """Angular velocity. [rad/s]"""
    force: Array
    """Wrench that the tool must exert, about its tip, world axes. [N, N m]"""
    torque: Array
    """Wrench that the tool must exert, about its tip, world axes. [N, N m]"""


class Model(TypedDict):
    """The vehicle's model that the laws use."""

    mass: float | None
    """Mass. [kg]"""
    centre_of_mass: Array
    """Centre of mass, relative to the one of the configuration. [m]"""
    false_force: float | None
    """Contact force that tilted hovers may show without contact: one standard deviation. [N]"""
    false_torque: float | None
    """Contact torque that tilted hovers may show without contact: one standard deviation. [N m]"""
    hovers: int
    """Number of hovers from which the model was learnt; 0 for the configured model."""


class State(TypedDict):
    """The newest state of a flight; docs/log.md has the same as a table."""

    position: Array
    """Position of the centre of mass. [m]"""
    velocity: Array
    """Velocity of the centre of mass. [m/s]"""
    rotation: Array
    """Rotation of the robot."""
    angular_velocity: Array
    """Angular velocity. [rad/s]"""
    specific_force: Array
    """Specific force at the centre of mass. [m/s^2]"""
    position_deviation: float | None
    """Deviation of the position: root of the summed variances. [m]"""
    velocity_deviation: float | None
    """Deviation of the velocity: root of the summed variances. [m/s]"""
    rotation_deviation: float | None
    """Deviation of the rotation: root of the summed variances. [rad]"""
    pose_age: float | None
    """Age of the newest pose whose position was applied. [s]"""
    latency: float | None
    """Estimated latency: mean time from the capture of a pose to its arrival. [s]"""
    setpoint: Target
    """The commanded set-point of the tool."""
    reference: Target
    """The reference of the tool: the set-point after the admittance filter."""
    force: Array
    """About the tool tip, world axes. [N, N m]"""
    torque: Array
    """About the tool tip, world axes. [N, N m]"""
    wind: Array
    """Estimated velocity of the air; zero if `[contact] discrimination` is off. [m/s]"""
    contact_likelihood: float | None
    """Likelihood that the tool is touched; near 1 if `[contact] discrimination` is off. [1]"""
    contact_force: Array
    """The part of the wrench about the tool tip that is no drag of the wind; all of it if `[contact] discrimination` is off. [N, N m]"""
    contact_torque: Array
    """The part of the wrench about the tool tip that is no drag of the wind; all of it if `[contact] discrimination` is off. [N, N m]"""
    position_error: Array
    """Position error e_p. [m]"""
    compliant: bool
    """Whether contact moves the reference."""
    saturated: bool
    """Whether a rotor is at a limit."""
    given_up: str | None
    """The most important part of the wanted wrench that the rotors do not produce; none if they produce all of it."""
    energy_tank: float | None
    """Energy that the reference may still put into what the tool touches. [J]"""
    rotor_command: Array
    """Commanded speed of each rotor. [Hz]"""
    rotor_speeds: Array
    """Measured speed of each rotor; the model's where a measurement is missing, doubted or impossible. [Hz]"""
    battery: float | None
    """Voltage of the battery; NaN (null) before it is known. [V]"""
    tick: int
    """Number of the tick, from 0."""
    time: float | None
    """Time of the tick. [s]"""
    phase: str
    """Phase after the tick."""
    faults: list[str]
    """Active faults, one bit each; docs/faults.md lists bit and name."""
    model: Model
    """The vehicle's model that the laws use."""
    late: int
    """Periods of the loop that were skipped, total."""
    refused: int
    """Requests on the control socket that were refused, total."""
    controls: str | None
    """Name of the client that holds the controls; None if no client holds them."""
