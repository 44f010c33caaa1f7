"""The wrench that the observer reports without contact, for vehicles that differ from their model.

    python -m benchmarks.false_contact --seeds 40

Hovers drawn vehicles, with the estimator in the loop and the noise of the experiments: level, tilted,
tilted after a first level hover whose mean wrench was taken as the bias (`[mission] bias_time`), and
tilted after the calibration flight (`[mission] calibration`). Prints a table of the mean wrench at the
tool over the last seconds of each hover: median, 90th percentile and largest of all, and how many vehicles
did not fly any more.
"""

from __future__ import annotations

import numpy as np
import tilthex
from numpy.typing import NDArray
from tilthex import so3

from benchmarks.drawn import drawn

Array = NDArray[np.float64]
HELD = 14.0
"""Duration of a hover, s: the estimator's biases settle in the first half."""
COUNTED = 4.0
"""Duration of the end of a hover that is used, s."""
FLYING = 3.0
"""The phase *flying*, as `simulate` returns it."""
BEFORE = {"air": 0.0, "none": 14.0, "hover": 24.0, "tilts": 46.0}
"""Time at which take-off and calibration are over, s; "air" has neither."""


def tilted(seed: int, degrees: float) -> Array:
    """A tilt about a horizontal axis whose direction depends on the seed."""
    direction = np.random.default_rng(seed).uniform(-np.pi, np.pi)
    rotation: Array = so3.exp(np.radians(degrees) * np.array([np.cos(direction), np.sin(direction), 0.0]))
    return rotation


def false_contact(
    vehicle: tilthex.Vehicle, truth: str | dict[str, object], seed: int, degrees: float, calibration: str
) -> Array:
    """Mean observed wrench at the tool, (6,), of the end of a hover; `calibration` is a key of `BEFORE`.

    NaN if the vehicle does not fly any more.
    """
    config = tilthex.Config.default(vehicle)
    start = "air" if calibration == "air" else "ground"
    if start == "ground":
        config = config.replace(mission={"calibration": calibration})
    setpoint = tilthex.Setpoint([0.0, 0.0, 1.0], tilted(seed, degrees))
    duration = HELD + BEFORE[calibration]
    run = tilthex.simulate(config, duration=duration, setpoint=setpoint, seed=seed, truth=truth, start=start)
    counted = run["time"][:, 0] > duration - COUNTED
    flies = bool(np.all(run["phase"][counted] == FLYING))
    return np.asarray(run["wrench_tool"][counted].mean(axis=0)) if flies else np.full(6, np.nan)


def main() -> None:
    """Prints the table."""
    flown = drawn(__doc__)
    print("| truth | hover | force at the tool [N]: median, 90 %, largest | torque [N m]: same | landed |")
    print("|---|---|---|---|---|")
    for truth in flown.truths:
        for name, degrees, calibration in (
            ("level", 0.0, "air"),
            ("15 deg", 15.0, "air"),
            ("15 deg after a level hover", 15.0, "none"),
            ('15 deg after calibration = "hover"', 15.0, "hover"),
            ('15 deg after calibration = "tilts"', 15.0, "tilts"),
        ):
            found = np.array(
                [false_contact(flown.vehicle, truth, seed, degrees, calibration) for seed in flown.seeds]
            )
            cells = [truth, name]
            flown_on = ~np.isnan(found[:, 0])
            for part in (found[flown_on, :3], found[flown_on, 3:]):
                sizes = np.linalg.norm(part, axis=1)
                cells.append(", ".join(f"{x:.3f}" for x in np.quantile(sizes, [0.5, 0.9, 1.0])))
            cells.append(str(np.count_nonzero(~flown_on)))
            print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
