"""The world of an experiment as a process.

`tilthex-sim --world` advances it by one board cycle at a time.

It exchanges the records of `crates/tilthex-rt/src/sim/world/record.rs` over its standard input and
output, in little-endian order: a greeting and a first state, then for each request (time, ns; speed to
which each motor drives its rotor, Hz) the state at that time. It ends when its input ends, and then
writes the true values.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import os
import signal
import struct
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from tilthex.experiments import stand
from tilthex.experiments.record import shapes
from tilthex.experiments.spec import Run, load
from tilthex.experiments.world import World
from tilthex.mjcf import TIMESTEP

Vector = NDArray[np.float64]

MAX_ROTORS = 12
MAGIC = b"tilthex2"
REQUEST = struct.Struct(f"<Q{MAX_ROTORS}d")
GREETING = struct.Struct("<8s27d")
STATE = struct.Struct(f"<Q{33 + MAX_ROTORS}d")
CHUNK = 8192
"""Number of rows by which the arrays of the true values grow."""


class Truth:
    """The true values at the end of every cycle: the columns of a record, and the monotonic time, ns."""

    def __init__(self, world: World) -> None:
        self._shapes = shapes(world.vehicle.rotor_count, len(world.scene_joints))
        self._chunks: list[dict[str, Vector]] = []
        self._times: list[int] = []

    def add(self, at: int, world: World, wrench: Vector, largest: float, pressure: Vector) -> None:
        """Adds the present state of the world, with the wrench on its tool."""
        row = len(self._times) % CHUNK
        if row == 0:
            self._chunks.append({name: np.zeros((CHUNK, *shape)) for name, shape in self._shapes.items()})
        self._times.append(at)
        rows = self._chunks[-1]
        rows["time"][row] = 1e-9 * at
        rows["tool_position"][row] = world.tool_position
        rows["tool_velocity"][row] = world.tool_velocity
        rows["robot_position"][row] = world.position
        rows["robot_rotation"][row] = world.rotation
        rows["angular_velocity"][row] = world.angular_velocity
        rows["true_wrench"][row] = wrench
        rows["peak_force"][row] = world.peak_force
        rows["largest_contact"][row] = largest
        rows["pressure"][row] = pressure
        rows["rotor_speeds"][row] = world.rotor_speeds
        rows["scene_joints"][row] = world.scene_joints

    def save(self, path: Path) -> None:
        """Writes a NumPy archive."""
        length = len(self._times)
        columns: dict[str, Any] = {
            name: np.concatenate([np.zeros((0, *shape)), *(chunk[name] for chunk in self._chunks)])[:length]
            for name, shape in self._shapes.items()
        }
        np.savez(path, at=np.array(self._times, dtype=np.int64), **columns)


class Stepper:
    """An experiment's world with the vehicle at rest on its stand, and the records about it."""

    def __init__(self, run: Run) -> None:
        self._model = run.model()
        drawn = run.drawn()
        vehicle = drawn.vehicle
        place = stand.start(vehicle)
        self.world = World(
            vehicle,
            stand.beside(run.scene(), vehicle),
            run.noise,
            seed=run.seed,
            tool_position=place + vehicle.tool_position,
            tool_rotation=vehicle.tool_rotation,
            feet=stand.feet(),
            drawn=drawn,
        )
        self._errors = drawn.sensor_errors().constants
        # Motors that stand still are below the limits of the controller, and are no command of it.
        self.world.model.actuator_ctrllimited[:] = 0
        self.world.rotor_speeds[:] = 0.0
        self._last = np.zeros(3)
        self.truth: Truth | None = None
        for _ in range(1000):
            self.step(0, np.zeros(MAX_ROTORS))

    def greeting(self) -> bytes:
        """The bytes of [`GREETING`]."""
        world, noise = self.world, self.world.noise
        return GREETING.pack(
            MAGIC,
            world.vehicle.rotor_count,
            self._model.mass,
            noise.position,
            noise.orientation,
            noise.gyro,
            noise.accelerometer,
            noise.rotor_speed,
            *(world.gyro_bias + self._errors[:3]),
            *(world.accelerometer_bias + self._errors[3:6]),
            *self._errors[6:],
            noise.pose_period,
            noise.pose_delay - noise.pose_jitter,
            2.0 * noise.pose_jitter,
        )

    def step(self, at: int, commands: Vector) -> bytes:
        """Advances by a cycle that ends `at` (ns) under speeds in Hz; returns the bytes of [`STATE`]."""
        world = self.world
        rotors = world.vehicle.rotor_count
        world.step(commands[:rotors], TIMESTEP)
        # Over two cycles: the mean over a control period, as in all experiments.
        felt = world.perfect_accelerometer()
        force, self._last = 0.5 * (felt + self._last), felt
        wrench, largest, pressure = world.true_wrench()
        if self.truth is not None:
            self.truth.add(at, world, wrench, largest, pressure)
        return STATE.pack(
            at,
            *world.position,
            *world.velocity,
            *world.rotation.flat,
            *world.angular_velocity,
            *world.rotor_speeds,
            *(0.0,) * (MAX_ROTORS - rotors),
            *force,
            *wrench,
            *world.data.qfrc_constraint[:6],
        )


def serve(stepper: Stepper, requests: BinaryIO, answers: BinaryIO) -> None:
    """Sends the greeting, then answers until the requests end."""
    answers.write(stepper.greeting() + stepper.step(0, np.zeros(MAX_ROTORS)))
    answers.flush()
    while len(request := requests.read(REQUEST.size)) == REQUEST.size:
        at, *commands = REQUEST.unpack(request)
        answers.write(stepper.step(at, np.array(commands)))
        answers.flush()


def choose(experiment: str, name: str | None) -> Run:
    """The run of an experiment with this name; the first run if no name is given.

    Raises:
        ValueError: There is no such experiment or run.
    """
    runs = load(experiment).runs
    if name is None:
        return runs[0]
    for run in runs:
        if run.name == name:
            return run
    raise ValueError(f"{experiment} has no run {name!r}; expected one of {', '.join(r.name for r in runs)}")


def main() -> int:
    """Serves the world that the command line names; exit status 2 if there is none."""
    parser = argparse.ArgumentParser(prog="python -m tilthex.experiments.world_process", description=__doc__)
    parser.add_argument("experiment", help="the experiment's name or its TOML file")
    parser.add_argument("--run", metavar="NAME", help="name of the run (default: the first)")
    parser.add_argument("--level", help="how the vehicle differs from its model: a level or a TOML file")
    parser.add_argument("--seed", type=int, default=1, help="with --level: seed of the vehicle")
    parser.add_argument(
        "--truth", type=Path, metavar="FILE.npz", help="file for the true values of every cycle"
    )
    arguments = parser.parse_args()
    # An interrupt is for tilthex-sim, which then closes this input.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Output of a library must not get between the records.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    try:
        run = choose(arguments.experiment, arguments.run)
        if arguments.level is not None:
            run = replace(run, truth=arguments.level, seed=arguments.seed)
        stepper = Stepper(run)
    except (ValueError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    if arguments.truth is not None:
        stepper.truth = Truth(stepper.world)
    # A garbage collection would make a cycle late; this program makes no reference cycles.
    gc.disable()
    with contextlib.suppress(OSError):
        highest = os.sched_get_priority_max(os.SCHED_FIFO)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(highest // 2 - 1))
    try:
        with contextlib.suppress(BrokenPipeError):
            serve(stepper, sys.stdin.buffer, answers)
        if stepper.truth is not None:
            stepper.truth.save(arguments.truth)
    except OSError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
