"""Observer chirp: the estimate against the sensor over frequency."""

from __future__ import annotations

import numpy as np

from tilthex.experiments.judge import Figures, Flights, Judge, Vector
from tilthex.experiments.record import Check, Record, below, rms
from tilthex.experiments.spec import Run
from tilthex.experiments.world import PERIOD
from tilthex.wrenches import norms, without_phase


def chirp_frequency(run: Run, time: Vector) -> Vector:
    """Frequency of the swing, Hz."""
    swing = run.swing
    part = np.clip((time - swing["start"]) / (swing["end"] - swing["start"]), 0.0, 1.0)
    return np.asarray(swing["lowest_hz"] + (swing["highest_hz"] - swing["lowest_hz"]) * part)


def checks(run: Run, record: Record) -> list[Check]:
    """Amplitude of the error divided by that of the signal, over the last half second, at 2.5 Hz."""
    table = []
    last = (record.time > run.swing["end"] - 1.0) & (record.time < run.swing["end"])
    for name, part, unit in (("force", slice(0, 3), "N"), ("torque", slice(3, 6), "N m")):
        estimate, sensor = (
            without_phase(record.wrench_tool[:, part], 1.0 / PERIOD),
            without_phase(record.true_wrench[:, part], 1.0 / PERIOD),
        )
        error = rms((estimate - sensor)[last])
        amplitude = rms((sensor - sensor[last].mean(axis=0))[last])
        at = f"{run.swing['highest_hz']:g} Hz"
        what = f"{name}: error at {at} by amplitude ({np.sqrt(2) * amplitude:.2g} {unit})"
        table.append(below(what, error / amplitude, 0.10, "%", paper="follows", scale=100.0))
    return table


def figures(flights: Flights) -> Figures:
    """Figure 4."""
    return {
        run.name: norms(
            record.time,
            *(without_phase(wrench, 1.0 / PERIOD) for wrench in (record.wrench_tool, record.true_wrench)),
        )
        for run, record in flights
    }


JUDGE = Judge(checks, figures)
