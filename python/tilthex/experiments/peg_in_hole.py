"""Peg in hole: judges attempts, and makes random cases."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import matplotlib.pyplot as plt
import numpy as np

from tilthex.experiments import stability
from tilthex.experiments.judge import Figures, Flights, Judge, Vector
from tilthex.experiments.record import Check, Record
from tilthex.experiments.report import overview, shade
from tilthex.experiments.scenes import Funnel
from tilthex.experiments.spec import Run
from tilthex.experiments.world import PERIOD


@dataclass(frozen=True)
class Insertion:
    """The result of one attempt."""

    depth: float
    """Largest depth of the tip in the tube, m."""
    inserted_at: float | None
    """Time at which it first was at the bottom, s."""
    withdrawn: bool
    largest_force: float
    """Largest norm of the sum of the contact forces in any step of 1 ms, N."""
    largest_contact: float
    """Largest single contact force in the last step of any period, N."""
    shaking: float
    """Largest rms angular rate over any two seconds with the tip in the tube, rad/s."""
    saturated: float
    """Part of the time with a rotor at its limit."""

    @property
    def succeeded(self) -> bool:
        """Whether it was inserted to the bottom and withdrawn, gently and without shaking."""
        return (
            self.inserted_at is not None
            and self.withdrawn
            and self.largest_force < FORCE
            and self.shaking < SHAKING
        )


FORCE = 40.0
"""Largest allowed contact force, N."""

SHAKING = 0.25
"""Largest rms angular rate, rad/s: a tip on a lever of 0.4 m then moves at 0.1 m/s, which no insertion
needs for two seconds."""


def insertion(run: Run, record: Record) -> Insertion:
    """Judges an attempt by the true values only."""
    scene = run.scene()
    tip = scene.along(record.tool_position)
    depth = run.judge["tip_radius"] - tip[:, 2]
    # A tip that is deep but beside the axis is outside of the funnel.
    inside = (np.hypot(tip[:, 0], tip[:, 1]) < 0.006) & (depth > 0.0)
    deep = np.where(inside, depth, 0.0)
    at_bottom = np.flatnonzero(deep > run.judge["depth"] - 2e-4)
    thrown = bool(np.any((depth > 0.02) & ~inside)) or bool(record.ended)
    rate = np.sum(record.angular_velocity**2, axis=1)
    window = round(2.0 / PERIOD)
    sums = np.cumsum(np.r_[0.0, np.where(inside, rate, 0.0)])
    mean = (sums[window:] - sums[:-window]) / window if len(sums) > window else np.zeros(1)
    return Insertion(
        depth=float(deep.max()),
        inserted_at=float(record.time[at_bottom[0]]) if len(at_bottom) else None,
        withdrawn=not thrown and bool(depth[-1] < -0.012),
        largest_force=float(record.peak_force.max()),
        largest_contact=float(record.largest_contact.max()),
        shaking=float(np.sqrt(max(mean.max(), 0.0))),
        saturated=float(record.saturated.mean()),
    )


def draw(run: Run, seed: int, index: int) -> Run:
    """Makes the random case `index` of a campaign: tilt, direction, start, friction and noise.

    The same seed and index give the same case, whichever other cases are flown.
    """
    draws = np.random.default_rng([seed, index])
    ranges = run.random
    tilt = float(draws.uniform(*ranges["tilt_deg"]))
    direction = float(draws.uniform(-180.0, 180.0))
    friction = float(draws.uniform(*ranges["friction"]))
    distance, bearing = ranges["offset"] * math.sqrt(draws.uniform()), draws.uniform(-math.pi, math.pi)
    # The funnel is moved, not the tool: the middle of its mouth is beside the tool's vertical path.
    across = math.sin(math.radians(tilt)) * Funnel().cone
    turn = math.radians(direction)
    entrance = [
        distance * math.cos(bearing) - across * math.sin(turn),
        distance * math.sin(bearing) + across * math.cos(turn),
        float(run.world["entrance"][2]),
    ]
    world = run.world | {
        "entrance": entrance,
        "tilt_deg": tilt,
        "direction_deg": direction,
        "friction": friction,
    }
    name = f"case {index} of seed {seed}"
    return replace(run, name=name, world=world, seed=int(draws.integers(1 << 31)))


def axis_angle(run: Run, record: Record) -> Vector:
    """Angle between the axes of tool and hole, deg."""
    cosine = record.tool_rotation[:, :, 2] @ run.scene().rotation[:, 2]
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def checks(run: Run, record: Record) -> list[Check]:
    """Depth, withdrawal, forces. The runs of Table 2 have no requirement."""
    found = insertion(run, record)
    required = run.judge["required"]
    tilt = run.world["tilt_deg"]
    turned = tilt - float(axis_angle(run, record)[record.during("hold")].min())
    head = f"{run.name}, tilt {tilt:g} deg"

    def verdict(good: bool) -> bool | None:
        return good if required else None

    return [
        Check(
            f"{head}: depth",
            "48 mm",
            "48 mm",
            f"{1e3 * found.depth:.1f} mm",
            verdict(found.inserted_at is not None),
        ),
        Check(f"{head}: tool turned by", "", f"{15} deg" if tilt == 15.0 else "", f"{turned:.1f} deg", None),
        Check(
            f"{head}: withdrawn", "yes", "yes", "yes" if found.withdrawn else "no", verdict(found.withdrawn)
        ),
        Check(
            f"{head}: largest contact force",
            "below 40 N",
            "",
            f"{found.largest_force:.1f} N (one contact: {found.largest_contact:.1f} N)",
            verdict(found.largest_force < 40.0),
        ),
        Check(
            f"{head}: angular rate in the tube, rms over 2 s",
            f"below {SHAKING} rad/s",
            "",
            f"{found.shaking:.3f} rad/s",
            verdict(found.shaking < SHAKING),
        ),
        Check(f"{head}: time with a rotor at its limit", "", "", f"{100 * found.saturated:.2g} %", None),
    ]


def figures(flights: Flights) -> Figures:
    """Depth, angle and contact force; figure 12; the stability chart."""
    figure, grid = plt.subplots(3, 1, figsize=(11, 8), sharex=True, layout="constrained")
    for run, record in flights:
        tip = run.scene().along(record.tool_position)
        grid[0].plot(
            record.time, 1e3 * np.maximum(run.judge["tip_radius"] - tip[:, 2], -10e-3), label=run.name
        )
        grid[1].plot(record.time, axis_angle(run, record), label=run.name)
        grid[2].plot(record.time, record.largest_contact, lw=0.6, label=run.name)
    labels = (
        "depth of the tip in the tube (mm)",
        "angle of tool and hole (deg)",
        "largest contact force (N)",
    )
    for axes, label in zip(grid, labels, strict=True):
        axes.set_title(label, fontsize=10, loc="left")
        shade(axes, flights[0][1])
    grid[0].legend()
    grid[2].set_xlabel("time (s)")
    chart = stability.chart(stability.Chain())
    return {"insertion": figure} | {run.name: overview(r) for run, r in flights} | {"stability": chart}


JUDGE = Judge(checks, figures, draw)
