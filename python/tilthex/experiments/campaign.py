"""Random campaigns: many cases in parallel, and a table of the failed ones."""

from __future__ import annotations

import csv
import html
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt

from tilthex.experiments import peg_in_hole
from tilthex.experiments.executors import Executor
from tilthex.experiments.flight import fly
from tilthex.experiments.record import Check
from tilthex.experiments.spec import Run

RESULTS = tuple(field.name for field in fields(peg_in_hole.Insertion))


@dataclass(frozen=True)
class Attempt:
    """One case and its result."""

    index: int
    tilt_deg: float
    direction_deg: float
    friction: float
    result: peg_in_hole.Insertion
    ended: str


def attempt(run: Run, seed: int, index: int, exact: bool) -> Attempt:
    """Flies one case."""
    case = peg_in_hole.draw(run, seed, index)
    record = fly(case, exact=exact)
    world = case.world
    found = peg_in_hole.insertion(case, record)
    return Attempt(index, world["tilt_deg"], world["direction_deg"], world["friction"], found, record.ended)


def fly_all(run: Run, seed: int, count: int, *, exact: bool, executor: Executor) -> Iterator[Attempt]:
    """Flies `count` cases with an executor, and yields each as it ends."""
    yield from executor(attempt, [(run, seed, index, exact) for index in range(count)])


def reason(found: Attempt) -> str:
    """Why an attempt failed, in a few words; empty if it did not fail."""
    result = found.result
    if result.inserted_at is None:
        return f"reached {1e3 * result.depth:.1f} mm"
    if not result.withdrawn:
        return found.ended or "not withdrawn"
    if result.largest_force >= peg_in_hole.FORCE:
        return f"force {result.largest_force:.0f} N"
    if result.shaking >= peg_in_hole.SHAKING:
        return f"shook at {result.shaking:.2f} rad/s"
    return ""


def checks(attempts: Sequence[Attempt], run: Run) -> list[Check]:
    """The lines of the campaign in the table of results."""
    good = sum(found.result.succeeded for found in attempts)
    ranges = run.random
    (lowest, highest), (smooth, rough) = ranges["tilt_deg"], ranges["friction"]
    what = f"inserted and withdrawn, tilt {lowest:g} to {highest:g} deg, friction {smooth:g} to {rough:g}"
    required = highest <= 28.0 and rough <= 0.45
    force = max(found.result.largest_force for found in attempts)
    shaking = max(found.result.shaking for found in attempts)
    return [
        Check(
            what,
            "at least 95 of 100" if required else "as it is",
            "one, at 15 deg",
            f"{good} of {len(attempts)}",
            good >= 0.95 * len(attempts) if required else None,
        ),
        Check(
            "largest contact force of all cases",
            "below 40 N",
            "",
            f"{force:.1f} N",
            force < 40.0 if required else None,
        ),
        Check("largest angular rate in the tube, rms over 2 s", "", "", f"{shaking:.3f} rad/s", None),
    ]


def figure(attempts: Sequence[Attempt]) -> Any:
    """Cases over tilt and friction, over the direction, and their forces."""
    drawn, (left, middle, right) = plt.subplots(1, 3, figsize=(15, 4.5), layout="constrained")
    for good, colour, mark, label in (
        (True, "tab:green", "o", "succeeded"),
        (False, "tab:red", "X", "failed"),
    ):
        some = [found for found in attempts if found.result.succeeded == good]
        tilt = [found.tilt_deg for found in some]
        left.scatter(tilt, [found.friction for found in some], c=colour, marker=mark, label=label)
        middle.scatter([found.direction_deg for found in some], tilt, c=colour, marker=mark)
        right.scatter(tilt, [found.result.largest_force for found in some], c=colour, marker=mark)
    left.set(xlabel="tilt (deg)", ylabel="friction")
    middle.set(xlabel="direction of the tilt's axis (deg)", ylabel="tilt (deg)")
    right.set(xlabel="tilt (deg)", ylabel="largest contact force (N)")
    left.legend()
    return drawn


def failures(attempts: Sequence[Attempt], command: str) -> str:
    """The failed cases as an HTML table, each with the command that flies it again."""
    failed = [found for found in attempts if not found.result.succeeded]
    if not failed:
        return "No case failed."
    rows = ["<tr><th>case<th>tilt<th>direction<th>friction<th>why<th>fly it again"]
    for found in failed:
        again = html.escape(f"{command} --case {found.index}")
        rows.append(
            f"<tr><td>{found.index}<td>{found.tilt_deg:.1f}<td>{found.direction_deg:.0f}"
            f"<td>{found.friction:.2f}<td>{html.escape(reason(found))}<td><code>{again}</code>"
        )
    return f"{len(failed)} failed:<table>" + "\n".join(rows) + "</table>"


def write_table(path: Path, attempts: Sequence[Attempt]) -> None:
    """Every case as a line of a CSV file."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("case", "tilt_deg", "direction_deg", "friction", "succeeded", "why", *RESULTS))
        for found in attempts:
            values = [getattr(found.result, name) for name in RESULTS]
            numbers = ["" if value is None else f"{value:.5g}" for value in values]
            case = [f"{value:.4g}" for value in (found.tilt_deg, found.direction_deg, found.friction)]
            writer.writerow((found.index, *case, found.result.succeeded, reason(found), *numbers))
