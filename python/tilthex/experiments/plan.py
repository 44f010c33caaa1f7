"""The set-points of a whole run, computed before it flies."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import tilthex
from tilthex.experiments.spec import Run, Waypoint
from tilthex.experiments.world import PERIOD

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Plan:
    """One set-point of the tool per control period, and its phase."""

    setpoints: list[tilthex.Setpoint]
    phase: NDArray[np.int64]
    phases: list[str]


def periods(run: Run) -> int:
    """The number of control periods of a run."""
    return _length(trajectory_of(run.waypoints, run.limits))


def make(run: Run) -> Plan:
    """Samples the trajectory of a run; if the run has a swing, adds it."""
    trajectory = trajectory_of(run.waypoints, run.limits)
    times = np.arange(_length(trajectory), dtype=np.float64) * PERIOD
    setpoints = [trajectory.sample(time) for time in times.tolist()]
    if run.swing:
        setpoints = _swing(run.swing, setpoints, times)
    names = list(dict.fromkeys(point.phase for point in run.waypoints))
    leg = np.searchsorted(np.r_[0.0, trajectory.begins], times, side="right") - 1
    owner = np.array([names.index(point.phase) for point in run.waypoints])
    return Plan(setpoints, owner[leg], names)


def trajectory_of(waypoints: Sequence[Waypoint], limits: Mapping[str, float]) -> tilthex.Trajectory:
    """The trajectory that begins at rest at the first way-point."""
    points = [
        {
            "position": point.position,
            "rotation": point.rotation,
            "wrench": point.wrench,
            "force_axes": list(point.force_axes),
            "duration": point.duration,
            "hold": point.hold,
        }
        for point in waypoints
    ]
    return tilthex.Trajectory(points, **limits)


def _length(trajectory: tilthex.Trajectory) -> int:
    return max(1, math.ceil(trajectory.duration / PERIOD))


def _swing(
    swing: Mapping[str, Any], setpoints: list[tilthex.Setpoint], times: Vector
) -> list[tilthex.Setpoint]:
    """A swing of the tool whose frequency rises linearly with time (figure 4).

    Only the pose swings. The pose controller answers a pose with a force of the same amplitude at every
    frequency; with a velocity and an acceleration the force would grow with the frequency.
    """
    length = swing["end"] - swing["start"]
    t = np.clip(times - swing["start"], 0.0, length)
    slope = (swing["highest_hz"] - swing["lowest_hz"]) / length
    angle = 2.0 * math.pi * (swing["lowest_hz"] * t + 0.5 * slope * t * t)
    wave = np.where((t > 0.0) & (t < length), np.sin(angle), 0.0)
    turns = Rotation.from_rotvec(np.radians(swing["rotation_deg"]) * wave[:, None]).as_matrix()
    translation = np.array(swing["translation"])
    return [
        tilthex.Setpoint(point.position + size * translation, turn @ point.rotation)
        for point, size, turn in zip(setpoints, wave, turns, strict=True)
    ]
