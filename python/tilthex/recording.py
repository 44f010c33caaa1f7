"""Recorded inertial samples and poses, from logs of tilthex-rt (MCAP) and from CSV."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex import _core
from tilthex.log import Log

Array = NDArray[np.float64]

_IMU = ("gyro_x", "gyro_y", "gyro_z", "force_x", "force_y", "force_z")
_POSITION = ("position_x", "position_y", "position_z")
_QUATERNION = ("quaternion_x", "quaternion_y", "quaternion_z", "quaternion_w")


@dataclass(frozen=True)
class Recording:
    """What `Ukf.run` takes.

    Times in s; gyro in rad/s and specific force in m/s^2, (n, 3), IMU axes; poses of the
    captured body: position in m, (m, 3), rotation (m, 3, 3), and when each arrived.
    """

    imu_time: Array
    gyro: Array
    specific_force: Array
    pose_time: Array
    position: Array
    rotation: Array
    pose_arrival_time: Array

    @staticmethod
    def from_file(path: Path | str, config: _core.Config) -> Recording:
        """Reads an MCAP log of tilthex-rt or a CSV file, as the name's ending says.

        Raises:
            ValueError: The file is neither, or lacks what is needed.
        """
        path = Path(path)
        readers = {".mcap": _read_mcap, ".csv": _read_csv}
        reader = readers.get(path.suffix.lower())
        if reader is None:
            raise ValueError(f"{path} ends in '{path.suffix}'; expected a log (.mcap) or a table (.csv)")
        recording = reader(path, config)
        if len(recording.imu_time) < 2 or len(recording.pose_time) < 2:
            found = f"{len(recording.imu_time)} inertial samples and {len(recording.pose_time)} poses"
            raise ValueError(f"{path} holds {found}; expected at least 2 of each")
        return recording

    def select(self, poses: NDArray[Any]) -> Recording:
        """The same with some of the poses only."""
        return Recording(
            self.imu_time,
            self.gyro,
            self.specific_force,
            self.pose_time[poses],
            self.position[poses],
            self.rotation[poses],
            self.pose_arrival_time[poses],
        )

    def estimate(self, ukf: _core.Ukf, *, covariance: bool = False) -> _core.UkfRun:
        """Runs the estimator over it."""
        return ukf.run(
            self.imu_time,
            self.gyro,
            self.specific_force,
            self.pose_time,
            self.position,
            self.rotation,
            self.pose_arrival_time,
            covariance=covariance,
        )


def rotations_from_quaternions(xyzw: Array) -> Array:
    """Rotation matrices (m, 3, 3) of quaternions (m, 4) in the order x, y, z, w; NaN stays NaN."""
    with np.errstate(invalid="ignore"):
        x, y, z, w = (xyzw / np.linalg.norm(xyzw, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _read_csv(path: Path, _: _core.Config) -> Recording:
    """One row an event: `time` and the columns of a sample, of a pose, or of both; the others stay empty.

    A column `arrival` says when the pose came; without it poses are there when they are taken.
    """
    with path.open(newline="") as file:
        reader = csv.DictReader(file)
        columns = reader.fieldnames or []
        needed = ("time", *_IMU, *_POSITION, *_QUATERNION)
        missing = [name for name in needed if name not in columns]
        if missing:
            raise ValueError(f"{path} has no column '{missing[0]}'; expected {', '.join(needed)}")
        samples: list[list[float]] = []
        poses: list[list[float]] = []
        for line, row in enumerate(reader, start=2):
            _read_row(f"{path}, line {line}", row, samples, poses)
    return _assemble(samples, poses)


def _read_row(place: str, row: dict[str, str], samples: list[list[float]], poses: list[list[float]]) -> None:
    try:
        time = float(row["time"])
        if row["gyro_x"]:
            samples.append([time, *(float(row[name]) for name in _IMU)])
        if row["position_x"]:
            arrival = float(row.get("arrival") or time)
            poses.append([time, arrival, *(float(row[name]) for name in (*_POSITION, *_QUATERNION))])
    except (TypeError, ValueError) as error:
        raise ValueError(f"{place}: {error}") from None


def _read_mcap(path: Path, config: _core.Config) -> Recording:
    times, chunks, poses = [], [], []
    for _, tick in Log(path).messages("/input"):
        times.append(tick.time)
        chunks.append(bytes(tick.link))
        for pose in tick.poses:
            if pose.tracking_valid:
                p = pose.position_w
                poses.append([pose.time, pose.arrival, p.x, p.y, p.z, *pose.rotation])
    samples = _core.read_imu(config, times, chunks)
    return _assemble(samples, poses)


def _assemble(samples: Iterable[Iterable[float]] | Array, poses: list[list[float]]) -> Recording:
    imu = np.asarray(samples, dtype=float).reshape(-1, 7)
    imu = imu[np.unique(imu[:, 0], return_index=True)[1]]
    width = len(poses[0]) if poses else 14
    pose = np.asarray(poses, dtype=float).reshape(-1, width)
    turns = pose[:, 5:]
    rotation = turns.reshape(-1, 3, 3) if width == 14 else rotations_from_quaternions(turns)
    return Recording(imu[:, 0], imu[:, 1:4], imu[:, 4:7], pose[:, 0], pose[:, 2:5], rotation, pose[:, 1])
