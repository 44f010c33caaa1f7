"""Multi-contact: the estimate against the sensor, phase by phase."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np

from tilthex.experiments.judge import Figures, Flights, Judge
from tilthex.experiments.record import Check, Record, below, rms
from tilthex.experiments.report import overview, shade
from tilthex.experiments.spec import Run

CONTACT_PHASES = (
    "one contact",
    "hold against the ledge",
    "two contacts",
    "to the second ledge",
    "three contacts",
)


def checks(run: Run, record: Record) -> list[Check]:
    """Force and torque against the true values in every phase, and the time without contact."""
    table = []
    for phase in CONTACT_PHASES:
        rows = record.during(phase)
        force = rms(record.wrench_contact[rows, :3] - record.true_wrench[rows, :3])
        torque = rms(record.wrench_contact[rows, 3:] - record.true_wrench[rows, 3:])
        table.append(below(f"{phase}: force against truth, rms", force, 0.2, "N", paper="follows"))
        table.append(below(f"{phase}: torque against truth, rms", torque, 0.05, "N m", paper="follows"))
    for axis, since in enumerate(("three contacts", "two contacts", "one contact")):
        # From the phase on that begins in contact with the surface normal to this axis.
        rows = record.during(*CONTACT_PHASES[CONTACT_PHASES.index(since) :])
        lost = float(np.mean(record.pressure[rows, axis] == 0.0))
        what = f"time without contact while a force along {'xyz'[axis]} is commanded"
        table.append(below(what, lost, 0.0, "%", scale=100.0))
    return table


def figures(flights: Flights) -> Figures:
    """Figure 14."""
    drawn: Figures = {}
    for run, record in flights:
        figure, grid = plt.subplots(2, 1, figsize=(12, 7), sharex=True, layout="constrained")
        for axes, first, label in ((grid[0], 0, "tool force (N)"), (grid[1], 3, "tool torque (N m)")):
            for k, colour in enumerate(("tab:blue", "tab:red", "tab:orange")):
                true, estimated = record.true_wrench[:, first + k], record.wrench_contact[:, first + k]
                axes.plot(record.time, true, ":", color=colour, lw=1.0)
                axes.plot(record.time, estimated, color=colour, lw=0.8, label="xyz"[k])
            axes.set_title(f"{label}: estimated, sensor dotted", fontsize=10, loc="left")
            shade(axes, record)
        grid[0].legend()
        grid[1].set_xlabel("time (s)")
        drawn[f"{run.name} wrench"] = figure
        drawn[run.name] = overview(record)
    return drawn


JUDGE = Judge(checks, figures)
