"""Figures of the estimator's run over a recording: innovations, NIS, and errors at measured poses."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex import _core
from tilthex.recording import Recording

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PoseErrors:
    """Distances between measured and estimated poses of the captured body: m and rad, (m,)."""

    position: Array
    rotation: Array

    def figures(self) -> dict[str, dict[str, float]]:
        """Root mean square, 95th percentile and largest of both, m and rad."""
        return {
            name: {
                "rms": float(np.sqrt(np.mean(values**2))),
                "percentile_95": float(np.percentile(values, 95)),
                "largest": float(values.max()),
            }
            for name, values in (("position", self.position), ("rotation", self.rotation))
        }

    def __str__(self) -> str:
        """The same, in mm and degrees."""
        found = self.figures()

        def text(name: str, scale: float, unit: str) -> str:
            rms, most, largest = (scale * value for value in found[name].values())
            return f"{rms:.3f} rms, {most:.3f} 95 %, {largest:.3f} max {unit}"

        return f"{text('position', 1e3, 'mm')}; {text('rotation', math.degrees(1.0), 'deg')}"


def pose_errors(recording: Recording, run: _core.UkfRun, config: _core.Config) -> PoseErrors:
    """Compares the states of a run, with linear interpolation, with all poses of a recording.

    Poses before the start, after the end, or with a value that is not finite are left out.
    """
    from scipy.spatial.transform import Rotation

    started = np.isfinite(run.position[:, 0])
    time = recording.imu_time[started]
    taken = recording.pose_time - config.pose_latency
    inside = (taken >= time[0]) & (taken <= time[-1])
    inside &= np.isfinite(recording.position).all(axis=1) & np.isfinite(recording.rotation).all(axis=(1, 2))
    at = taken[inside]
    k = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    part = (at - time[k]) / (time[k + 1] - time[k])
    position, rotation = run.position[started], Rotation.from_matrix(run.rotation[started])
    turned = rotation[k] * Rotation.from_rotvec(
        part[:, None] * (rotation[k].inv() * rotation[k + 1]).as_rotvec()
    )
    placed = position[k] + part[:, None] * (position[k + 1] - position[k])
    offset, turn = config.captured_body
    captured = Rotation.from_matrix(recording.rotation[inside])
    return PoseErrors(
        np.linalg.norm(placed + turned.apply(offset) - recording.position[inside], axis=1),
        ((turned * Rotation.from_matrix(turn)).inv() * captured).magnitude(),
    )


def figures(recording: Recording, run: _core.UkfRun) -> dict[str, Any]:
    """Figures of a run by name, in s, m, rad, rad/s and m/s^2; innovations and NIS if a pose was applied."""
    applied = np.isfinite(run.nis)
    latency = recording.pose_arrival_time - recording.pose_time
    found: dict[str, Any] = {
        "samples": len(recording.imu_time),
        "duration": float(np.ptp(recording.imu_time)),
        "poses": len(recording.pose_time),
        "outcomes": dict(Counter(run.outcome).most_common()),
        "latency": {"mean": float(latency.mean()), "largest": float(latency.max())},
    }
    if applied.any():
        innovation = run.innovation[applied]
        position, rotation = np.hsplit(np.square(innovation), 2)
        found["innovation_rms"] = {
            "position": float(np.sqrt(position.sum(axis=1).mean())),
            "rotation": float(np.sqrt(rotation.sum(axis=1).mean())),
        }
        nis = run.nis[applied]
        found["nis"] = {"mean": float(nis.mean()), "median": float(np.median(nis))}
        found["gyro_bias"] = run.gyro_bias[-1]
        found["accelerometer_bias"] = run.accelerometer_bias[-1]
    return found


def summary(recording: Recording, run: _core.UkfRun) -> str:
    """The `figures` of a run in a few lines."""
    found = figures(recording, run)
    outcomes = ", ".join(f"{count} {name}" for name, count in found["outcomes"].items())
    latency = found["latency"]
    lines = [
        f"{found['samples']} inertial samples over {found['duration']:.2f} s",
        f"{found['poses']} poses: {outcomes}",
        f"latency of the poses: {1e3 * latency['mean']:.1f} ms mean, "
        f"{1e3 * latency['largest']:.1f} ms largest",
    ]
    if "nis" in found:
        innovation, nis = found["innovation_rms"], found["nis"]
        gyro, accelerometer = found["gyro_bias"], found["accelerometer_bias"]
        lines += [
            f"innovations: {1e3 * innovation['position']:.3f} mm and "
            f"{np.degrees(innovation['rotation']):.3f} deg rms",
            f"NIS: {nis['mean']:.2f} mean, {nis['median']:.2f} median (6 and 5.35 expected)",
            f"gyro bias, at the end: {np.array2string(gyro, precision=5)} rad/s",
            f"accelerometer bias: {np.array2string(accelerometer, precision=4)} m/s^2",
        ]
    return "\n".join(lines)
