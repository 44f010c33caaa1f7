"""The error of the observed force under a pull, after the calibration flight, and its causes.

    python -m benchmarks.pull --truth measured --truth cad --seeds 24

Flies drawn vehicles in the experiment `shaping`: the calibration, a hover, then a pull of 1.4 N along x at
the tool. The error is the mean observed force along x minus the pull. What the learnt model and the true one
make of it in a hover that is perfectly still and measured without noise has three parts:

- *level*: the error without the pull;
- *scale*: mass and thrust are wrong by the same factor, so all forces are. No flight without contact shows
  it;
- *pattern*: the force of the rotors that carry the torque of the pull, 0.56 N m about the centre of mass.
  They carry no torque in a hover, so hovers show little of their errors.

Prints the root of the mean square of each over the vehicles, mN. The vehicles of the rows *weighed* have a
mass that is known to 0.1 %, and the calibration is told so (`[mission] mass_deviation`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import tilthex
from numpy.typing import NDArray
from tilthex.experiments import spec
from tilthex.experiments.flight import calibration, step, world_at
from tilthex.experiments.plan import make
from tilthex.experiments.world import PERIOD

from benchmarks.drawn import drawn

Array = NDArray[np.float64]
PULL = np.array([1.4, 0.0, 0.0])
"""N, at the tool, W."""
HELD = 8.0
"""Time with and without the pull, s."""
COUNTED = 5.0
"""The end of that time, over which the observed force is averaged, s."""

WEIGHED = 0.001
"""Standard deviation of the mass of a vehicle that was weighed, as a part of it."""


def still_error(true: tilthex.Vehicle, model: tilthex.Vehicle, pull: Array) -> Array:
    """Observed force minus the pull, N, (3,), of a still, level vehicle that is observed with a model."""
    specific = np.array([0.0, 0.0, tilthex.GRAVITY])
    needed = np.concatenate([true.mass * specific - pull, -np.cross(true.tool_position, pull)])
    inputs = np.linalg.solve(true.allocation, needed)
    return np.asarray(model.mass * specific - model.allocation[:3] @ inputs - pull)


def flown(run: spec.Run) -> tuple[Array, tilthex.Vehicle]:
    """Errors of the observed force along x without and with the pull, N, (2,), and the learnt model."""
    loop = tilthex.Loop(tilthex.Config.default(run.model()).replace(**run.config))
    truth = run.drawn()
    start = make(run).setpoints[0]
    hovers, way_down = calibration(run, start)
    world = world_at(run, truth, hovers[0])
    loop.initialize(0.0, world.captured_position, world.rotation)
    held = [start] * round(HELD / PERIOD)
    still = np.zeros(3)
    command = truth.vehicle.hover_speeds(world.rotation)
    for learn, setpoints, push in (
        (True, hovers, still),
        (False, way_down, still),
        (False, held, still),
        (False, held, PULL),
    ):
        world.push = push
        for setpoint in setpoints:
            world.step(command)
            command = step(loop, world, setpoint, learn_model=learn)
    if loop.model_refused is not None:
        raise SystemExit(f"seed {run.seed}: calibration refused: {loop.model_refused}")
    counted = round(COUNTED / PERIOD)
    along_x = loop.record()["wrench_tool"][:, 0]
    pulled = along_x[-counted:].mean() - PULL[0]
    free = along_x[-len(held) - counted : -len(held)].mean()
    return np.array([free, pulled]), loop.model


def parts(run: spec.Run) -> Array:
    """Flown errors without and with the pull, and level, scale, pattern and their sum along x, N, (6,)."""
    found, model = flown(run)
    true = run.drawn().vehicle
    level = still_error(true, model, np.zeros(3))[0]
    both = still_error(true, model, PULL)[0]
    scale = (model.mass / true.mass - 1.0) * PULL[0]
    return np.concatenate([found, [level, scale, both - level - scale, both]])


def main() -> None:
    """Prints the table."""
    asked = drawn(__doc__)
    shaping = replace(spec.load("shaping").runs[0], calibration="tilts")
    weighed = shaping.config | {"mission": {"mass_deviation": WEIGHED}}
    print("| truth | flown: without pull | with pull | still: level | scale | pattern | sum |")
    print("|---|---|---|---|---|---|---|")
    for level in asked.truths:
        known = {"level": level, "error": {"mass": {"std": WEIGHED}}}
        for name, truth, config in (
            (level, level, shaping.config),
            (f"{level}, weighed", known, weighed),
        ):
            runs = [replace(shaping, seed=seed, truth=truth, config=config) for seed in asked.seeds]
            errors = np.array([parts(run) for run in runs])
            cells = [f"{1e3 * rms:.1f}" for rms in np.sqrt(np.mean(errors**2, axis=0))]
            print(f"| {' | '.join([name, *cells])} |", flush=True)


if __name__ == "__main__":
    main()
