"""Wind or contact: how well a touch is recognised in gusts, with and without `[contact] discrimination`.

    python -m benchmarks.contact --seeds 20

Flies drawn vehicles in wind with gusts. The tool of each is touched six times, for 2 s each, with 0.3 to
3 N from a random direction. Prints for each truth level which part of the touching time is recognised if
at most 1 % or 5 % of the time without a touch is taken for a touch (from 0.2 s after the start of a
touch), and the area under this curve. Without discrimination a touch is an observed force above a
threshold; with discrimination it is a likelihood above a threshold. Then prints how far the wind alone
moves the tool, and how far the largest touch moves it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import tilthex
from numpy.typing import NDArray

from benchmarks.drawn import drawn

Array = NDArray[np.float64]
DRAG: dict[str, object] = {"rotor_drag": 2.3e-4, "drag_area": [0.03, 0.03, 0.08]}
"""The model's drag: the mean values of the truth."""
AIR: dict[str, object] = {
    "rotor_drag": {"mean": 2.3e-4, "std": 0.2e-4},
    "drag_area": [0.03, 0.03, 0.08],
    "centre_of_pressure": {"mean": [0.0, 0.0, -0.02], "std": 0.01},
    "wind_speed": {"mean": 3.0, "std": 0.5},
    "wind_direction_deg": {"min": 0.0, "max": 360.0},
    "gust_deviation": 0.6,
}
TOUCHES, LASTS, GAP, FIRST = 6, 2.0, 4.0, 14.0
DURATION = FIRST + TOUCHES * (LASTS + GAP)
ONSET, AFTER = 0.2, 1.0
"""Times after the start and after the end of a touch that have no label, s: the estimate needs time."""


def touches(seed: int) -> list[dict[str, Any]]:
    """Six touches whose magnitudes are distributed uniformly in the logarithm."""
    random = np.random.default_rng(seed)
    found = []
    for k in range(TOUCHES):
        direction = random.normal(size=3)
        size = np.exp(random.uniform(np.log(0.3), np.log(3.0)))
        force = direction / np.linalg.norm(direction) * size
        found.append({"at": FIRST + k * (LASTS + GAP), "duration": LASTS, "force": force})
    return found


def fly(level: str, seed: int, *, told: bool, touched: bool, vehicle: tilthex.Vehicle) -> dict[str, Array]:
    """A hover in the air, in the wind."""
    config = tilthex.Config.default(vehicle).replace(contact={"discrimination": told, **DRAG})
    return tilthex.simulate(
        config,
        duration=DURATION,
        setpoint=tilthex.Setpoint([0.0, 0.0, 1.0], np.eye(3)),
        pushes=touches(seed) if touched else [],
        seed=seed,
        truth={"level": level, "aerodynamics": AIR},
    )


def labels(time: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """The times at which the tool is touched, and those at which it certainly is not."""
    begins = FIRST + (LASTS + GAP) * np.arange(TOUCHES)
    since = time[:, None] - begins
    touching = ((since > ONSET) & (since < LASTS)).any(axis=1)
    free = (time > FIRST - GAP) & ~((since > 0.0) & (since < LASTS + AFTER)).any(axis=1)
    return touching, free


def rates(touching: Array, free: Array) -> tuple[float, float, float]:
    """Part of the touching time above the thresholds that 1 % and 5 % of the free time exceed, and the
    area."""
    at = [float(np.mean(touching > np.quantile(free, 1.0 - part))) for part in (0.01, 0.05)]
    order = np.sort(free)
    below = np.searchsorted(order, touching, side="left"), np.searchsorted(order, touching, side="right")
    area = float(np.mean((below[0] + below[1]) / (2.0 * len(order))))
    return at[0], at[1], area


def main() -> None:
    """Prints the tables."""
    flown = drawn(__doc__)
    rows, moved = [], []
    for level in flown.truths:
        for told in (False, True):
            touching, free, by_wind, by_touch = [], [], [], []
            for seed in flown.seeds:
                run = fly(level, seed, told=told, touched=True, vehicle=flown.vehicle)
                force = np.linalg.norm(run["wrench_tool"][:, :3], axis=1)
                value = run["contact_likelihood"][:, 0] if told else force
                touches_now, free_now = labels(run["time"][:, 0])
                touching.append(value[touches_now])
                free.append(value[free_now])
                away = np.linalg.norm(run["reference_position"] - run["setpoint_position"], axis=1)
                by_touch.append(away[run["time"][:, 0] > FIRST].max())
                run = fly(level, seed, told=told, touched=False, vehicle=flown.vehicle)
                away = np.linalg.norm(run["reference_position"] - run["setpoint_position"], axis=1)
                by_wind.append(away[run["time"][:, 0] > FIRST - GAP].max())
            name = f"{level} | {'likelihood' if told else 'force'}"
            one, five, area = rates(np.concatenate(touching), np.concatenate(free))
            rows.append(f"| {name} | {100 * one:.1f} % | {100 * five:.1f} % | {area:.3f} |")
            wind, most, touch = 1e3 * np.median(by_wind), 1e3 * max(by_wind), 1e3 * np.median(by_touch)
            moved.append(f"| {name} | {wind:.0f}, {most:.0f} mm | {touch:.0f} mm |")
    print(
        "| truth | told by | recognised, 1 % false | recognised, 5 % false | area |",
        "|---|---|---|---|---|",
        sep="\n",
    )
    print(*rows, "", sep="\n")
    print(
        "| truth | told by | wind alone moves the tool: median, largest | largest touch |",
        "|---|---|---|---|",
        sep="\n",
    )
    print(*moved, sep="\n")


if __name__ == "__main__":
    main()
