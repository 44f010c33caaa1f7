"""False contact in motion and the turn of a soft wrist, in free air, of vehicles that are not their model.

    python -m benchmarks.free_air --truth measured --truth cad --seeds 20

Every drawn vehicle takes off, flies the calibration and then, without noise, to and fro, tilted by 15
degrees, at 1 m/s at most. *Force* and *torque* are the rms of the contact wrench at the tool above 0.8 m/s.
In a second flight it hovers for 30 s with noise and with the soft wrist of the peg in hole, without its
torque to where the rotors have room: *turn* is the largest angle between reference and set-point. Prints
median, 90th percentile and largest of the vehicles, and how many did not fly any more. The row *wind* is
*cad* in the wind of benchmarks/cad-wind.toml, which rises after the calibration; its configuration knows the
mean drag.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import tilthex
from numpy.typing import NDArray
from tilthex._toml import tomllib
from tilthex.experiments import spec

from benchmarks import wind
from benchmarks.drawn import drawn
from benchmarks.false_contact import BEFORE, FLYING, tilted

Array = NDArray[np.float64]
BEGIN = BEFORE["tilts"]
"""Time at which the calibration is over, s."""
SETTLED = 10.0
"""Time after it in which a wind rises and is learnt, s."""
FAST = 0.8
"""The wrench counts above this speed, m/s."""
HELD = 30.0
"""Duration of the hover with the soft wrist, s."""


def known(truth: str) -> tuple[Any, dict[str, Any]]:
    """The truth of a row, and the keys of its configuration."""
    config: dict[str, Any] = {"mission": {"calibration": "tilts"}}
    if truth != "wind":
        return truth, config
    keys = tomllib.loads(wind.FILE.read_text())["truth"]
    keys["aerodynamics"]["wind_begin"] = BEGIN
    return keys, config | {"contact": wind.CONTACT}


def to_and_fro(seed: int) -> tilthex.Trajectory:
    """A flight to and fro along x, tilted, from the end of the calibration on."""
    rotation = tilted(seed, 15.0)
    ways = [{"position": [x, 0.0, 1.0], "rotation": rotation} for x in (1.5, -1.5, 1.5, -1.5)]
    first = {"position": [-1.5, 0.0, 1.0], "rotation": rotation, "hold": SETTLED}
    return tilthex.Trajectory([first, *ways], velocity=1.0, acceleration=2.0)


def moving(vehicle: tilthex.Vehicle, truth: str, seed: int) -> Array:
    """Rms of the false force and torque at the tool, N and N m, (2,); NaN if it does not fly any more."""
    drawn_from, keys = known(truth)
    keys["mission"]["max_velocity"] = 1.0
    config = tilthex.Config.default(vehicle).replace(**keys)
    way = to_and_fro(seed)
    run = tilthex.simulate(
        config,
        duration=BEGIN + SETTLED + way.duration,
        trajectory=way,
        noise=0.0,
        seed=seed,
        truth=drawn_from,
        start="ground",
    )
    speed = np.linalg.norm(run["velocity"], axis=1)
    fast = (run["time"][:, 0] > BEGIN + SETTLED) & (speed > FAST)
    if not fast.any() or np.any(run["phase"][fast] != FLYING):
        return np.full(2, np.nan)
    wrench = run["wrench_contact"][fast]
    return np.array([np.sqrt(np.mean(np.sum(part**2, axis=1))) for part in np.hsplit(wrench, 2)])


def turned(vehicle: tilthex.Vehicle, truth: str, seed: int) -> Array:
    """Largest turn of the soft wrist, deg, (1,); NaN if it does not fly any more."""
    drawn_from, keys = known(truth)
    wrist = dict(spec.load("peg-in-hole").runs[0].config)
    wrist["admittance"] = wrist["admittance"] | {"room_torque": 0.0}
    config = tilthex.Config.default(vehicle).replace(**(wrist | keys))
    duration = BEGIN + SETTLED + HELD
    setpoint = tilthex.Setpoint([0.0, 0.0, 1.0], np.eye(3))
    run = tilthex.simulate(
        config, duration=duration, setpoint=setpoint, seed=seed, truth=drawn_from, start="ground"
    )
    counted = run["time"][:, 0] > duration - HELD
    if np.any(run["phase"][counted] != FLYING):
        return np.full(1, np.nan)
    rotation = run["reference_rotation"][counted].reshape(-1, 3, 3)
    cosine = 0.5 * (np.trace(rotation, axis1=1, axis2=2) - 1.0)
    return np.array([np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).max()])


def main() -> None:
    """Prints the table."""
    flown = drawn(__doc__)
    print("| truth | force [N]: median, 90 %, largest | torque [N m]: same | turn [deg]: same | not flying |")
    print("|---|---|---|---|---|")
    for truth in [*flown.truths, "wind"]:
        found = np.array(
            [
                np.concatenate([moving(flown.vehicle, truth, seed), turned(flown.vehicle, truth, seed)])
                for seed in flown.seeds
            ]
        )
        quantiles = np.nanquantile(found, [0.5, 0.9, 1.0], axis=0).T
        cells = [", ".join(f"{x:.3g}" for x in row) for row in quantiles]
        lost = np.count_nonzero(np.isnan(found).any(axis=1))
        print(f"| {' | '.join([truth, *cells, str(lost)])} |", flush=True)


if __name__ == "__main__":
    main()
