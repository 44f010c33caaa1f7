"""The values that the page shows of one moment, from the state of a running flight or from a log."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tilthex._core import Config
from tilthex._faults import FAULTS
from tilthex._logged import State, Target
from tilthex._quaternions import rotations_from_quaternions
from tilthex.log import Columns, Log

Array = NDArray[np.float64]

TOPICS = ("/state", "/setpoint", "/reference", "/wrench", "/control", "/rotors", "/flight")


@dataclass(frozen=True)
class Pose:
    """A pose in the world."""

    position: Array
    """Position, (3,), m."""
    rotation: Array
    """Rotation, (3, 3), maps its coordinates to world coordinates."""


@dataclass(frozen=True)
class Sample:
    """One moment of a flight; frames and units as in docs/log.md."""

    time: float
    """Time, s: on the host's monotonic clock, or since the start of the log."""
    robot: Pose
    """Pose of the robot (centre of mass)."""
    setpoint: Pose
    """Set-point of the tool."""
    reference: Pose
    """Reference of the tool."""
    force: Array
    """Force of the environment on the tool, (3,), N, world."""
    torque: Array
    """Torque of the environment about the tool tip, (3,), N m, world."""
    position_error: Array
    """Position error, (3,), m, world."""
    rotor_speeds: Array
    """Measured rotor speeds, (n,), Hz."""
    phase: str
    faults: tuple[str, ...]
    given_up: str | None
    compliant: bool
    battery: float
    """Voltage of the battery, V; NaN before it is known."""
    pose_age: float
    """s."""
    controls: str | None = None
    """Name of the client that holds the controls; a log does not have it."""


def from_state(state: State) -> Sample:
    """The sample of a state of the control socket."""
    return Sample(
        time=_number(state["time"]),
        robot=Pose(state["position"], state["rotation"]),
        setpoint=_target(state["setpoint"]),
        reference=_target(state["reference"]),
        force=state["force"],
        torque=state["torque"],
        position_error=state["position_error"],
        rotor_speeds=state["rotor_speeds"],
        phase=state["phase"],
        faults=tuple(state["faults"]),
        given_up=state["given_up"],
        compliant=state["compliant"],
        battery=_number(state["battery"]),
        pose_age=_number(state["pose_age"]),
        controls=state["controls"],
    )


class Flown:
    """A log as samples.

    Attributes:
        config: The configuration of the flight.
        times: (N,), s since the start of the log.
        stamps: The same times, ns since 1970.
    """

    def __init__(self, log: Log) -> None:
        self.config = Config.from_text(log.configuration)
        columns = {topic: log.columns(topic) for topic in TOPICS}
        # A log that breaks off may lack the last messages of some topics.
        rows = min(len(column["log_time"]) for column in columns.values())
        self._columns: dict[str, Columns] = {
            topic: {name: values[:rows] for name, values in column.items()}
            for topic, column in columns.items()
        }
        # The fault bits have 64 bits, more than a column of floating-point numbers can hold.
        self._faults = [message.faults for _, message in log.messages("/flight")][:rows]
        stamps = self._columns["/flight"]["log_time"]
        self.times: Array = stamps - stamps[0]
        self.stamps = [round(1e9 * float(stamp)) for stamp in stamps]
        self._rotations = {
            topic: rotations_from_quaternions(self._columns[topic]["orientation"])
            for topic in ("/state", "/setpoint", "/reference")
        }

    def at(self, time: float) -> Sample:
        """The last sample not later than a time, s since the start of the log; before it, the first one."""
        row = max(0, int(np.searchsorted(self.times, time + 1e-9, side="right")) - 1)
        return self.sample(row)

    def sample(self, row: int) -> Sample:
        """The sample of a row."""
        of = self._columns
        given_up = str(of["/control"]["given_up"][row])
        return Sample(
            time=float(self.times[row]),
            robot=self._pose("/state", row),
            setpoint=self._pose("/setpoint", row),
            reference=self._pose("/reference", row),
            force=of["/wrench"]["tool_w.force"][row],
            torque=of["/wrench"]["tool_w.torque"][row],
            position_error=of["/control"]["position_error_w"][row],
            rotor_speeds=of["/rotors"]["measured"][row],
            phase=str(of["/flight"]["phase"][row]),
            faults=tuple(_names(self._faults[row])),
            given_up=None if given_up == "none" else given_up,
            compliant=bool(of["/control"]["compliant"][row]),
            battery=float(of["/rotors"]["battery"][row]),
            pose_age=float(of["/state"]["pose_age"][row]),
        )

    def thinned(self, most: int) -> Iterator[Sample]:
        """At most `most` samples at equal distances."""
        for row in np.unique(np.linspace(0, len(self.times) - 1, most).astype(int)):
            yield self.sample(int(row))

    def events(self) -> list[tuple[float, str]]:
        """Changes of the phase, and starts of faults: time, s since the start of the log, and a sentence."""
        phases, found = self._columns["/flight"]["phase"], []
        for row in range(1, len(self.times)):
            time = float(self.times[row])
            if phases[row] != phases[row - 1]:
                found.append((time, str(phases[row])))
            found += [(time, name) for name in _names(self._faults[row] & ~self._faults[row - 1])]
        return found

    def _pose(self, topic: str, row: int) -> Pose:
        return Pose(self._columns[topic]["position_w"][row], self._rotations[topic][row])


def tool_pose(robot: Pose, config: Config) -> Pose:
    """The pose of the tool of a robot."""
    vehicle = config.vehicle
    return Pose(
        robot.position + robot.rotation @ vehicle.tool_position, robot.rotation @ vehicle.tool_rotation
    )


def _names(bits: int) -> Iterator[str]:
    """Names of the faults in the bits of a log. A fault that this version does not know has its number."""
    for number in range(bits.bit_length()):
        if bits >> number & 1:
            yield FAULTS[number].name if number < len(FAULTS) else f"fault {number}"


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)


def _target(target: Target) -> Pose:
    return Pose(target["position"], target["rotation"])
