"""Flies a controller in Python over the wire: against `tilthex-sim`, through its protocol, in real time.

`fly` starts the motors, takes off and lands with the laws of the package. In between, a controller of your
own flies: a `tilthex.chain.Chain` with blocks of your own, or any object whose `step` is that of
`tilthex.Controller`. It gets what `tilthex.Ukf` estimates from inertial samples and captured poses.

A flight in Python has none of the reactions to faults of `tilthex-rt`. `fly` therefore refuses every port
that cannot be that of `tilthex-sim`.
"""

from __future__ import annotations

import os
import select
import socket
import tempfile
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from subprocess import PIPE
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tilthex import _core
from tilthex._programs import Program, free_port

__all__ = ["Flown", "SimulatedVehicle", "Stepped", "fly", "simulated"]

Vector = NDArray[np.float64]

PATIENCE = 15.0
"""Longest time until the vehicle is ready, and until its motors spin or stand, s."""
SILENT = 0.5
"""After this time without a byte the vehicle is gone, s."""
RAMP = 0.5
"""Time in which the rotors speed up on the ground, and slow down after the landing, s."""
TAKE_OFF = 0.5
"""Height of the first hover above the start, m."""
BELOW = 0.05
"""The landing's set-point ends this far below the start, so that the vehicle stands firmly, m."""
SETTLE = 0.5
"""Time of the hovers before and after the controller, and of the rest on the ground, s."""
SLOW = {"velocity": 0.5, "acceleration": 1.0, "angular_velocity": 0.5, "angular_acceleration": 1.0}
"""Limits of take-off, landing and the ways between them and the trajectory."""


class Stepped(Protocol):
    """A controller that `fly` takes."""

    @property
    def step(self) -> Callable[..., _core.Output]:
        """One step, with the arguments of `tilthex.Controller.step`."""


class SimulatedVehicle(NamedTuple):
    """Where a simulated vehicle is found."""

    port: str
    """Its port."""
    poses: str
    """The address of its poses."""


@dataclass(frozen=True, repr=False)
class Flown:
    """What the controller did, one row per step."""

    time: Vector
    """Time since the controller's first step, s, (N,)."""
    position: Vector
    """Estimated position of the tool, m, world, (N, 3)."""
    setpoint: Vector
    """Position of the set-point, (N, 3)."""
    reference: Vector
    """Position of the reference: the set-point after the admittance, (N, 3)."""
    wrench: Vector
    """Observed wrench at the tool, N and N m, world, (N, 6)."""
    rotor_speeds: Vector
    """Measured rotor speeds, Hz, (N, n)."""
    command: Vector
    """Commanded rotor speeds, Hz, (N, n)."""
    samples: NDArray[np.int64]
    """Inertial samples of each step, (N,): 1 if Python is as fast as the stream, more where it was late."""

    def __repr__(self) -> str:
        """The duration, and how many steps were late."""
        late, end = int(np.sum(self.samples > 1)), float(self.time[-1]) if len(self.time) else 0.0
        return f"Flown({len(self.time)} steps in {end:.2f} s, {late} of them late)"


@contextmanager
def simulated(config: _core.Config, *options: str) -> Iterator[SimulatedVehicle]:
    """Runs `tilthex-sim` with its motion capture while the context lasts.

    Args:
        config: The configuration whose vehicle is simulated.
        *options: More options of `tilthex-sim`, such as "--truth", "cad".

    Raises:
        OSError: The program is missing or does not start; with its own sentence.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="tilthex-")))
        (folder / "config.toml").write_text(config.to_toml(), encoding="utf-8")
        poses = f"natnet://127.0.0.1:{free_port()}/TILTHEX"
        arguments = ["--config", str(folder / "config.toml"), "--socket", str(folder / "line")]
        Program(stack, "tilthex-sim", [*arguments, "--mocap", poses, *options], PIPE).ready()
        yield SimulatedVehicle(f"unix:{folder / 'line'}", poses)


def fly(
    controller: Stepped,
    config: _core.Config,
    *,
    port: str,
    poses: str,
    trajectory: _core.Trajectory | None = None,
    duration: float | None = None,
) -> Flown:
    """Flies a controller: takes off, goes to the begin of the trajectory, steps the controller, and lands.

    The controller is stepped when an inertial sample arrives. If a step takes longer than the period of the
    samples, the next one takes all samples that have arrived, and gets the longer `dt`. If a step raises an
    exception, the vehicle lands, and the exception is raised after the landing.

    Args:
        controller: A `tilthex.chain.Chain`, or any object with the `step` of `tilthex.Controller`.
        config: The configuration: vehicle, link, motion capture, estimator, and the laws of take-off and
            landing.
        port: The pseudo-terminal that `tilthex-sim` prints, or `unix:PATH` of its `--socket`.
        poses: The address of its `--mocap`.
        trajectory: The trajectory of the tool; without it, the tool stays above the start.
        duration: Time of the controller, s; without it, that of the trajectory.

    Raises:
        ValueError: The port is not that of a simulated vehicle, or neither trajectory nor duration is given.
        OSError: The vehicle does not answer, does not start, or has gone.
    """
    if duration is None:
        if trajectory is None:
            raise ValueError("neither trajectory nor duration is given; expected at least one of them")
        duration = trajectory.duration
    if not duration > 0.0:
        raise ValueError(f"duration is {duration:g} s; expected a time above 0")
    with ExitStack() as stack:
        line = _open(port)
        stack.callback(os.close, line)
        flight = _Flight(line, _core.PoseClient(config, poses), config)
        try:
            flight.begin()
            flight.take_off()
            at = trajectory.sample if trajectory is not None else lambda _: flight.above
            flight.go_to(at(0.0))
            return flight.own(controller, at, duration)
        finally:
            flight.end()


def _open(port: str) -> int:
    """The file descriptor of a simulated vehicle's line."""
    path = port.removeprefix("unix:")
    if path != port:
        with socket.socket(socket.AF_UNIX) as line:
            try:
                line.connect(path)
            except OSError as error:
                sentence = f"port {port} cannot be opened: {error.strerror}; expected that of a tilthex-sim"
                raise OSError(sentence) from error
            return line.detach()
    if Path(path).resolve().parent != Path("/dev/pts"):
        raise ValueError(
            f"port is {port!r}; expected the pseudo-terminal that tilthex-sim prints, or unix:PATH of its "
            "--socket. A controller in Python flies simulated vehicles only, because it has none of the "
            "reactions to faults of tilthex-rt"
        )
    descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        tty.setraw(descriptor)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


class _Flight:
    """The flight around the controller."""

    def __init__(self, line: int, poses: _core.PoseClient, config: _core.Config) -> None:
        os.set_blocking(line, False)
        self._line, self._poses, self._vehicle = line, poses, config.vehicle
        self._link, self._filter = _core.VehicleLink(config), _core.Ukf(config)
        self._laws = _core.Controller(config.vehicle, config)
        self._slowest: Vector = config.vehicle.rotor_speed_limits[:, 0].copy()
        self._command: Vector | None = None
        self._started = False
        self._refused = "no pose of its body has arrived"
        self._samples = 0
        self._above: _core.Setpoint | None = None

    def begin(self) -> None:
        """Waits until the streams run and the estimator has started."""
        self._until(lambda: self._link.ready and self._started, partial(self._write, None), self._missing)
        self._above = self._moved(self._tool(), TAKE_OFF)

    def take_off(self) -> None:
        """Starts the motors, and hovers above the start."""
        start = partial(self._write, self._slowest, start=True)
        self._until(lambda: all(self._link.spinning), start, lambda: "its motors do not start")
        # The rotors carry most of the weight before the laws begin.
        self._ramp(0.8 * self._vehicle.hover_speeds(self._filter.rotation))
        self.go_to(self.above)

    @property
    def above(self) -> _core.Setpoint:
        """The first hover."""
        assert self._above is not None
        return self._above

    def go_to(self, goal: _core.Setpoint) -> None:
        """Brings the tool from where it is to a set-point with the laws of the package, and stays there."""
        ways = [
            {"position": at.position, "rotation": at.rotation, "hold": hold}
            for at, hold in ((self._tool(), 0.0), (goal, SETTLE))
        ]
        way = _core.Trajectory(ways, **SLOW)
        self._laws.reset()
        for now, dt in self._steps(way.duration):
            self._step(partial(self._laws.step, compliant=False), way.sample(now), dt)

    def own(self, controller: Stepped, at: Callable[[float], _core.Setpoint], duration: float) -> Flown:
        """Steps the controller."""
        rows: list[tuple[float | Vector, ...]] = []
        for now, dt in self._steps(duration):
            setpoint, samples, speeds = at(now), self._samples, self._link.rotor_speeds
            output = self._step(controller.step, setpoint, dt)
            row = self._tool().position, setpoint.position, output.reference.position, output.wrench_tool
            rows.append((now, *row, speeds, output.rotor_speeds, samples))
        time, position, setpoints, reference, wrench, measured, command, taken = map(
            np.array, zip(*rows, strict=True)
        )
        return Flown(time, position, setpoints, reference, wrench, measured, command, taken)

    def end(self) -> None:
        """Lands if the vehicle flies, and stops the motors. Whatever happens, they are stopped."""
        try:
            if self._command is not None:
                self.go_to(self.above)
                self.go_to(self._moved(self.above, -TAKE_OFF - BELOW))
                self._ramp(self._slowest)
        finally:
            stop = partial(self._write, None)
            self._until(lambda: not any(self._link.spinning), stop, lambda: "its motors do not stop")
            self._send(self._link.part())

    def _step(self, law: Callable[..., _core.Output], setpoint: _core.Setpoint, dt: float) -> _core.Output:
        found = self._filter
        output = law(
            position=found.position,
            velocity=found.velocity,
            rotation=found.rotation,
            angular_velocity=found.angular_velocity,
            specific_force=found.specific_force,
            rotor_speeds=self._link.rotor_speeds,
            setpoint=setpoint,
            dt=dt,
        )
        self._write(output.rotor_speeds)
        return output

    def _steps(self, duration: float) -> Iterator[tuple[float, float]]:
        """The time since the begin and the time since the last step, s, whenever samples have arrived."""
        begin = last = self._filter.time
        while last - begin < duration:
            self._hear()
            if self._samples and self._filter.time > last:
                dt, last = self._filter.time - last, self._filter.time
                yield last - begin, dt
                self._samples = 0

    def _ramp(self, goal: Vector) -> None:
        """Brings the rotors from their speeds to others."""
        begin = self._slowest if self._command is None else self._command
        for now, _ in self._steps(RAMP):
            self._write(begin + min(now / RAMP, 1.0) * (goal - begin))

    def _until(self, done: Callable[[], bool], talk: Callable[[], None], why: Callable[[], str]) -> None:
        end = time.monotonic() + PATIENCE
        while not done():
            if time.monotonic() > end:
                raise OSError(f"the simulated vehicle is not ready after {PATIENCE:g} s: {why()}")
            self._hear()
            talk()

    def _missing(self) -> str:
        return self._refused if self._link.ready else "its streams do not run"

    def _hear(self) -> None:
        """Waits for bytes, and takes them and the poses that have arrived."""
        select.select([self._line], [], [], 0.02)
        try:
            data = os.read(self._line, 65536)
        except BlockingIOError:
            data = None
        if data == b"":
            raise OSError("the simulated vehicle has closed its line")
        samples = self._link.receive(time.monotonic(), data or b"")
        if self._link.refused:
            raise OSError("no vehicle that the configuration's `[link]` knows answers at the port")
        if self._link.ready and self._link.silence > SILENT:
            raise OSError(f"the simulated vehicle is silent for {self._link.silence:.1f} s")
        for taken, gyro, force in samples:
            self._filter.predict(taken, gyro, force)
        self._samples += len(samples)
        for arrival, taken, position, rotation in self._poses.receive():
            if self._started:
                self._filter.update_pose(taken, position, rotation, arrival=arrival)
            else:
                self._start(taken, position, rotation)

    def _start(self, taken: float, position: Vector, rotation: Vector) -> None:
        try:
            self._filter.initialize_at_rest(taken, position, rotation)
            self._started = True
        except ValueError as error:
            self._refused = str(error)

    def _write(self, speeds: Vector | None, *, start: bool = False) -> None:
        """Sends a command to the motors; None stops them."""
        data = self._link.command(time.monotonic(), speeds, start=start)
        if not start:
            self._command = speeds
        if data:
            self._send(data)

    def _send(self, data: bytes) -> None:
        """Writes all bytes; a vehicle that takes none for `SILENT` is gone."""
        while data:
            if not select.select([], [self._line], [], SILENT)[1]:
                raise OSError(f"the vehicle has taken no byte for {SILENT} s; is tilthex-sim still running?")
            data = data[os.write(self._line, data) :]

    def _tool(self) -> _core.Setpoint:
        """Where the tool is, at rest."""
        vehicle, turn = self._vehicle, self._filter.rotation
        return _core.Setpoint(
            self._filter.position + turn @ vehicle.tool_position, turn @ vehicle.tool_rotation
        )

    @staticmethod
    def _moved(from_: _core.Setpoint, up: float) -> _core.Setpoint:
        return _core.Setpoint(from_.position + np.array([0.0, 0.0, up]), from_.rotation)
