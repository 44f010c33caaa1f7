"""Observer chirp: the estimate against the sensor over frequency."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import butter, filtfilt

from tilthex.experiments.judge import Figures, Flights, Judge, Vector
from tilthex.experiments.record import Check, Record, below, rms
from tilthex.experiments.spec import Run
from tilthex.experiments.world import PERIOD


def without_phase(values: Vector) -> Vector:
    """A 6 Hz low-pass forwards and backwards."""
    b, a = butter(2, 6.0, fs=1.0 / PERIOD)
    return np.asarray(filtfilt(b, a, values, axis=0))


def chirp_frequency(run: Run, time: Vector) -> Vector:
    """Frequency of the swing, Hz."""
    swing = run.swing
    part = np.clip((time - swing["start"]) / (swing["end"] - swing["start"]), 0.0, 1.0)
    return np.asarray(swing["lowest_hz"] + (swing["highest_hz"] - swing["lowest_hz"]) * part)


def checks(run: Run, record: Record) -> list[Check]:
    """Error norm by amplitude over the last half second, at 2.5 Hz."""
    table = []
    last = (record.time > run.swing["end"] - 1.0) & (record.time < run.swing["end"])
    for name, part, unit in (("force", slice(0, 3), "N"), ("torque", slice(3, 6), "N m")):
        estimate, sensor = (
            without_phase(record.wrench_tool[:, part]),
            without_phase(record.true_wrench[:, part]),
        )
        error = rms((estimate - sensor)[last])
        amplitude = rms((sensor - sensor[last].mean(axis=0))[last])
        at = f"{run.swing['highest_hz']:g} Hz"
        what = f"{name}: error at {at} by amplitude ({np.sqrt(2) * amplitude:.2g} {unit})"
        table.append(below(what, error / amplitude, 0.10, "%", paper="follows", scale=100.0))
    return table


def figures(flights: Flights) -> Figures:
    """Figure 4."""
    drawn: Figures = {}
    for run, record in flights:
        figure, grid = plt.subplots(2, 2, figsize=(14, 8), sharex=True, layout="constrained")
        for row, name, first in ((grid[0], "force (N)", 0), (grid[1], "torque (N m)", 3)):
            estimate = without_phase(record.wrench_tool[:, first : first + 3])
            sensor = without_phase(record.true_wrench[:, first : first + 3])
            for k, colour in enumerate(("tab:blue", "tab:red", "tab:orange")):
                row[0].plot(record.time, sensor[:, k], "--", color=colour, lw=1.0)
                row[0].plot(record.time, estimate[:, k], color=colour, lw=0.8, label="xyz"[k])
            norm = np.linalg.norm(estimate - sensor, axis=1)
            row[1].plot(record.time, norm, lw=0.8)
            row[1].plot(record.time, np.polyval(np.polyfit(record.time, norm, 1), record.time), "r", lw=1.0)
            row[0].set_title(f"{name}: estimated, sensor dashed", fontsize=10, loc="left")
            row[1].set_title("norm of the difference, and a line through it", fontsize=10, loc="left")
            row[0].legend()
        for axes in grid[1]:
            axes.set_xlabel("time (s)")
        drawn[run.name] = figure
    return drawn


JUDGE = Judge(checks, figures)
