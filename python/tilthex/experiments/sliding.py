"""Sliding: the deviation in closed form, and the checks."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np

from tilthex.experiments.judge import Figures, Flights, Judge, Vector, admittance
from tilthex.experiments.record import Check, Record, below, rms
from tilthex.experiments.report import overview, shade
from tilthex.experiments.spec import Run


def closed_form(run: Run, position: Vector) -> tuple[Vector, float]:
    """Deviation (m) of the reference at rest, and normal force (N), without friction."""
    scene = run.scene()
    normal = scene.rotation[:, 2]
    depth = float(normal @ (scene.origin - position)) + run.judge["tip_radius"]
    compliance = normal / admittance(run, "stiffness")[:3]
    softness = float(normal @ compliance)
    return compliance * depth / softness, depth / softness + run.judge["dead_zone"]


def checks(run: Run, record: Record) -> list[Check]:
    """Position error, force against the true force, and the deviation against the closed form."""
    error = float(np.max(np.linalg.norm(record.position_error, axis=1)))
    slide = record.during("slide", "rest")
    difference = record.wrench_contact[slide, :3] - record.true_wrench[slide, :3]
    table = [
        below(f"{run.name}: position error", error, 0.010, "mm", paper="20 mm", scale=1e3),
        below(f"{run.name}: force against truth, rms", rms(difference), 0.15, "N"),
    ]
    at_rest = np.flatnonzero(record.during("rest"))[-500:]
    off = (record.reference_position - record.setpoint_position)[at_rest].mean(axis=0)
    expected, normal_force = closed_form(run, record.setpoint_position[at_rest[-1]])
    paper = "0.1 m" if admittance(run, "stiffness")[1] < 5.0 else "almost none"
    if run.world["friction"] == 0.0:
        required = f"{1e3 * expected[1]:.1f} mm within 5 mm"
        passed = bool(abs(off[1] - expected[1]) <= 5e-3)
        force = record.true_wrench[at_rest, :3].mean(axis=0) @ run.scene().rotation[:, 2]
        table += [
            Check(f"{run.name}: sideways deviation", required, "", f"{1e3 * off[1]:.1f} mm", passed),
            Check(f"{run.name}: normal force at rest", f"{normal_force:.2f} N", "", f"{force:.2f} N", None),
        ]
    else:
        table.append(Check(f"{run.name}: sideways deviation", "", paper, f"{1e3 * off[1]:.1f} mm", None))
    lost = float(np.mean(record.pressure[record.during("slide", "rest"), 2] == 0.0))
    table.append(Check(f"{run.name}: time without contact", "", "", f"{100 * lost:.2g} %", None))
    return table


def figures(flights: Flights) -> Figures:
    """Figure 10, and figure 8 for every run."""
    figure, axes = plt.subplots(figsize=(9, 5), layout="constrained")
    for run, record in flights:
        off = record.reference_position - record.setpoint_position
        axes.plot(record.time, off[:, 1], label=run.name)
    shade(axes, flights[0][1])
    axes.set(xlabel="time (s)", ylabel="y of reference - desired (m)")
    axes.legend()
    return {"sideways": figure} | {run.name: overview(record) for run, record in flights}


JUDGE = Judge(checks, figures)
