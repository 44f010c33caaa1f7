"""Property shaping: the response to a pull, compared with the ideal response."""

from __future__ import annotations

import math

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

from tilthex.experiments.judge import Figures, Flights, Judge, Vector, admittance
from tilthex.experiments.record import Check, Record, below
from tilthex.experiments.report import overview
from tilthex.experiments.spec import Run


def ideal_response(run: Run, time: Vector) -> tuple[Vector, Vector]:
    """Deviation and velocity along x of a mass-spring-damper under the pull minus the dead zone."""
    mass, damping, stiffness = (admittance(run, key)[0] for key in ("mass", "damping", "stiffness"))
    push = run.push["force"][0] - run.judge["dead_zone"]
    begin, end = run.push["start"], run.push["end"]

    def rates(t: float, y: Vector, force: float) -> list[float]:
        return [y[1], (force - damping * y[1] - stiffness * y[0]) / mass]

    x, v, state = np.zeros_like(time), np.zeros_like(time), np.zeros(2)
    for a, b, force in ((begin, end, push), (end, time[-1] + 1.0, 0.0)):
        rows = (time >= a) & (time < b)
        wanted = np.r_[time[rows], b]
        y = solve_ivp(rates, (a, b), state, t_eval=wanted, args=(force,), rtol=1e-9, atol=1e-12).y
        x[rows], v[rows], state = y[0, :-1], y[1, :-1], y[:, -1]
    return x, v


PAPER_DEVIATION = {4.0: "0.29 m", 6.0: "0.19 m", 8.0: "0.14 m"}


def checks(run: Run, record: Record) -> list[Check]:
    """The steady state, and the distance from the ideal response."""
    stiffness = float(admittance(run, "stiffness")[0])
    panels = run.judge["panels"]
    expected = (run.push["force"][0] - run.judge["dead_zone"]) / stiffness
    off = (record.reference_position - record.setpoint_position)[:, 0]
    end = run.push["end"]
    steady = float(np.mean(off[(record.time > end - run.judge["steady"]) & (record.time < end)]))
    ideal, _ = ideal_response(run, record.time)
    distance = float(np.max(np.abs(off - ideal)))
    table = [
        Check(
            f"{run.name}: steady state",
            f"{expected:.4f} m within 2 mm",
            PAPER_DEVIATION.get(stiffness, "") if "K" in panels else "",
            f"{steady:.4f} m",
            abs(steady - expected) <= 2e-3 if _settles(run) else None,
        )
    ]
    if len(panels) > 1:
        what = f"{run.name}: reference from the ideal response"
        table.append(below(what, distance, 5e-3, "mm", paper="20 mm", scale=1e3))
    else:
        what = f"{run.name}: reference from the ideal response"
        table.append(Check(what, "", "", f"{1e3 * distance:.3g} mm", None))
    return table


def _settles(run: Run) -> bool:
    """Whether the ideal response is within a thousandth of its end when the steady state is measured."""
    mass, damping, stiffness = (admittance(run, key)[0] for key in ("mass", "damping", "stiffness"))
    slowest = float(np.max(np.roots([mass, damping, stiffness]).real))
    return bool(slowest * (run.push["end"] - run.judge["steady"] - run.push["start"]) < math.log(1e-3))


def figures(flights: Flights) -> Figures:
    """The six panels of figure 7."""
    figure, grid = plt.subplots(2, 3, figsize=(15, 8.5), layout="constrained")
    for axes, letter, label in zip(
        grid[0],
        "KDM",
        ("x of the reference (m)", "velocity along x (m/s)", "x of the reference (m)"),
        strict=True,
    ):
        for run, record in flights:
            if letter not in run.judge["panels"]:
                continue
            x, v = ideal_response(run, record.time)
            measured = record.reference_position[:, 0] - record.setpoint_position[:, 0]
            if letter == "D":
                x, measured = v, record.reference_velocity[:, 0]
            line = axes.plot(record.time, measured, lw=1.2, label=_shaped(run, letter))[0]
            axes.plot(record.time, x, ":", color=line.get_color(), lw=1.2)
        axes.set_title(f"{label}; ideal dotted", fontsize=10, loc="left")
        axes.legend(fontsize=9)
    panels = (
        ("position error along x (mm)", "position_error", 1e3),
        ("tool velocity along x (m/s)", "tool_velocity", 1.0),
        ("estimated force along x (N)", "wrench_tool", 1.0),
    )
    for axes, (label, column, scale) in zip(grid[1], panels, strict=True):
        for run, record in flights:
            if "K" in run.judge["panels"]:
                axes.plot(record.time, scale * record.columns[column][:, 0], lw=0.9, label=run.name)
        axes.set_title(label, fontsize=10, loc="left")
        axes.legend(fontsize=9)
        axes.set_xlabel("time (s)")
    return {"shaping": figure} | {
        f"overview {run.name}": overview(r) for run, r in flights if len(run.judge["panels"]) > 1
    }


def _shaped(run: Run, letter: str) -> str:
    key = {"K": "stiffness", "D": "damping", "M": "mass"}[letter]
    return f"{letter} = {admittance(run, key)[0]:g}"


JUDGE = Judge(checks, figures)
