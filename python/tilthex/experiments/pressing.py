"""Pressing: the force along the normal of the board, compared with the commanded force."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np

from tilthex.experiments.judge import Figures, Flights, Judge, Vector
from tilthex.experiments.record import Check, Record, below, rms
from tilthex.experiments.report import overview, shade
from tilthex.experiments.spec import Run


def along_normal(run: Run, record: Record) -> tuple[Vector, float]:
    """True force of the tool on the board along its normal, one per row, and the commanded one, N."""
    inward = -run.scene().rotation[:, 2]
    commanded = next(point.wrench for point in run.waypoints if point.phase == "rest")
    return -record.true_wrench[:, :3] @ inward, float(np.array(commanded[:3]) @ inward)


def checks(run: Run, record: Record) -> list[Check]:
    """Steady force, force while sliding, and position of the tool along the board."""
    pressed, commanded = along_normal(run, record)
    rest = np.flatnonzero(record.during("rest"))
    settled = rest[record.time[rest] > record.time[rest[0]] + run.judge["settled"]]
    steady = abs(float(np.mean(pressed[settled])) - commanded)
    slide = record.during("slide", "rest")
    lost = float(np.mean(record.pressure[slide, 2] == 0.0))
    table = [
        below(f"{run.name}: steady error of the force", steady, run.judge["steady"], "N"),
        Check(
            f"{run.name}: force while sliding, rms",
            "",
            "",
            f"{rms(pressed[slide] - commanded):.2f} N",
            None,
        ),
        Check(f"{run.name}: time without contact", "0 %", "", f"{100 * lost:.2g} %", lost == 0.0),
    ]
    if run.world["friction"] == 0.0:
        normal = run.scene().rotation[:, 2]
        off = (record.reference_position - record.setpoint_position)[settled].mean(axis=0)
        across = float(np.linalg.norm(off - normal * (normal @ off)))
        table.append(below(f"{run.name}: deviation along the board", across, 5e-3, "mm", scale=1e3))
    return table


def figures(flights: Flights) -> Figures:
    """Force along the normal and the commanded force, and figure 8 for every run."""
    figure, axes = plt.subplots(figsize=(9, 5), layout="constrained")
    for run, record in flights:
        pressed, commanded = along_normal(run, record)
        axes.plot(record.time, pressed, label=run.name)
    axes.axhline(commanded, color="k", linestyle="--", label="commanded")
    shade(axes, flights[0][1])
    axes.set(xlabel="time (s)", ylabel="force along the normal (N)")
    axes.legend()
    return {"force": figure} | {run.name: overview(record) for run, record in flights}


JUDGE = Judge(checks, figures)
