"""Recorded inertial samples and poses: logs of tilthex-rt, and of other programs (docs/recordings.md)."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex import _core, readers
from tilthex._quaternions import rotations_from_quaternions
from tilthex.log import Log, NotALog
from tilthex.readers.columns import QUANTITIES, Stream

Array = NDArray[np.float64]

NEAR = 0.01
"""Quaternions and matrices this close to a rotation are corrected to one; others are refused."""


@dataclass(frozen=True)
class Recording:
    """The inputs of `Ukf.run`.

    Times in s; gyro in rad/s and specific force in m/s^2, (n, 3), IMU axes; poses of the captured body:
    position in m, (m, 3), rotation (m, 3, 3), and the time at which each arrived.
    """

    imu_time: Array
    gyro: Array
    specific_force: Array
    pose_time: Array
    position: Array
    rotation: Array
    pose_arrival_time: Array

    @staticmethod
    def from_file(
        path: Path | str | Log, config: _core.Config, *, imu: str | None = None, poses: str | None = None
    ) -> Recording:
        """Reads a log of tilthex-rt, or a recording of another program: docs/recordings.md.

        Args:
            path: The file: .mcap, .csv, .mat, .ulg, or the folder of a ROS 2 bag; or a log that is open.
            config: The configuration; its link decodes a log of tilthex-rt.
            imu: The topic of the inertial samples, if more than one topic has some.
            poses: The topic of the poses, or another file that holds them.

        Raises:
            ValueError: The file lacks data; the message says what it has.
        """
        log = path if isinstance(path, Log) else own_log(Path(path))
        path = Path(path.path if isinstance(path, Log) else path)
        recording = _read_log(log, config) if log else _read_streams(path, imu, poses)
        if len(recording.imu_time) < 2 or len(recording.pose_time) < 2:
            found = f"{len(recording.imu_time)} inertial samples and {len(recording.pose_time)} poses"
            raise ValueError(f"{path} holds {found}; expected at least 2 of each")
        return recording

    def tracked(self) -> Recording:
        """The recording without poses that are not numbers."""
        numbers = np.isfinite(self.position).all(axis=1) & np.isfinite(self.rotation).all(axis=(1, 2))
        return self.select(np.flatnonzero(numbers))

    def select(self, poses: NDArray[Any]) -> Recording:
        """A recording with some of the poses only."""
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
        """Runs the estimator over the recording."""
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


def own_log(path: Path) -> Log | None:
    """A log of tilthex-rt; None for a recording of another program."""
    if path.suffix.lower() == ".mcap" and path.is_file():
        with contextlib.suppress(NotALog):
            return Log(path)
    return None


def _read_log(log: Log, config: _core.Config) -> Recording:
    """Reads a log of tilthex-rt."""
    times, chunks = [], []
    poses: list[list[float]] = []
    for _, tick in log.messages("/input"):
        times.append(tick.time)
        chunks.append(bytes(tick.link))
        for pose in tick.poses:
            if pose.tracking_valid:
                p = pose.position_w
                poses.append([pose.time, pose.arrival, p.x, p.y, p.z, *pose.rotation])
    imu = _core.read_imu(config, times, chunks)
    pose = np.asarray(poses, dtype=float).reshape(-1, 14)
    return _assemble(imu, pose[:, 0], pose[:, 1], pose[:, 2:5], pose[:, 5:].reshape(-1, 3, 3))


def _read_streams(path: Path, imu_name: str | None, poses_name: str | None) -> Recording:
    """Reads a recording of another program."""
    streams = readers.read(path)
    others = readers.read(Path(poses_name)) if poses_name and Path(poses_name).exists() else None
    inertial = _chosen(path, streams, "inertial samples", "--imu", imu_name, ("gyro", "force"))
    name = None if others else poses_name
    pose = _chosen(
        path,
        others or streams,
        "poses",
        "--poses",
        name,
        ("position", "quaternion"),
        ("position", "rotation"),
    )
    samples = _rows(inertial, ("gyro", "force"))
    imu = np.column_stack([samples[1]["time"], *samples[1]["gyro"].T, *samples[1]["force"].T])
    try:
        _core.question_units(imu[:, 0], imu[:, 1:4], imu[:, 4:7])
    except ValueError as error:
        raise ValueError(
            f"{inertial.place}: {error}: say the unit in the column's name, "
            "such as 'time [ns]' or 'gyro_x [deg/s]'"
        ) from None
    turning = "quaternion" if len(pose.find("quaternion")) == 4 else "rotation"
    kept, found = _rows(pose, ("position", turning), seldom=True)
    turn = found[turning]
    rotation = (
        _from_quaternions(pose, kept, turn) if turning == "quaternion" else _from_matrices(pose, kept, turn)
    )
    time = found["time"]
    arrival = pose.find("arrival").get("", np.full(len(pose.find("time")[""]), np.nan))[kept]
    recording = _assemble(
        imu, time, np.where(np.isfinite(arrival), arrival, time), found["position"], rotation
    )
    try:
        _core.question_poses(
            recording.imu_time, recording.gyro, recording.pose_time, recording.position, recording.rotation
        )
    except ValueError as error:
        raise ValueError(
            f"{path}: {error}: say the unit in the column's name, such as 'x [mm]' or 'gyro_x [deg/s]'"
        ) from None
    return recording


def _chosen(
    path: Path, streams: list[Stream], what: str, option: str, name: str | None, *needed: tuple[str, ...]
) -> Stream:
    """The stream that has all columns: the one with the given name, or the only one."""
    if name is not None:
        named = [stream for stream in streams if stream.place.endswith(name)]
        if not named:
            raise ValueError(f"{path} has no '{name}'; it has {_places(streams)}")
        streams = named
    lacks = [(min((_missing(stream, kind) for kind in needed), key=len), stream) for stream in streams]
    whole = [stream for missing, stream in lacks if not missing]
    if len(whole) > 1:
        raise ValueError(f"{path} holds {what} in {_places(whole)}: name one with {option}")
    if whole:
        return whole[0]
    if len(streams) == 1 and streams[0].rows[0] == "line":
        kinds = " or ".join(", ".join(_names(kind)) for kind in needed)
        raise ValueError(f"{streams[0].place} has no column '{lacks[0][0][0]}'; expected {kinds}")
    no_log = "is not a log of tilthex-rt, and " if path.suffix == ".mcap" else ""
    raise ValueError(f"{path} {no_log}holds no {what} with their usual names; it has {_places(streams)}")


def _places(streams: list[Stream]) -> str:
    return ", ".join(stream.place.rpartition(", ")[2] for stream in streams) or "nothing"


def _names(kind: tuple[str, ...]) -> list[str]:
    return ["time", *(f"{quantity}_{axis}" for quantity in kind for axis in QUANTITIES[quantity].axes)]


def _missing(stream: Stream, kind: tuple[str, ...]) -> list[str]:
    """The columns that a stream lacks."""
    found = {f"{quantity}_{axis}" for quantity in kind for axis in stream.find(quantity)}
    return [name for name in _names(kind) if name not in found | ({"time"} if stream.find("time") else set())]


def _rows(
    stream: Stream, kind: tuple[str, ...], *, seldom: bool = False
) -> tuple[NDArray[np.int64], dict[str, Array]]:
    """The rows that hold numbers, and the quantities there: time (n,), others (n, axes).

    With `seldom`, a row may lack one whole quantity, as a pose of a body that was not seen.
    """
    time = stream.find("time")[""]
    columns = {}
    for quantity in kind:
        found = stream.find(quantity)
        columns[quantity] = np.column_stack([found[axis] for axis in QUANTITIES[quantity].axes])
    there = [np.isfinite(values) for values in columns.values()]
    given = np.column_stack(there)
    kept = np.flatnonzero(given.any(axis=1))
    whole = np.asarray(given.all(axis=1))
    if seldom:
        parts = [each.all(axis=1) | ~each.any(axis=1) for each in there]
        whole = np.asarray(np.stack(parts).all(axis=0))
    for row in kept[~whole[kept] | ~np.isfinite(time[kept])]:
        known = np.concatenate([each[row] | (seldom and not each[row].any()) for each in there])
        names = zip(_names(kind)[1:], known, strict=True)
        empty = [name for name, has in names if not has]
        raise ValueError(f"{stream.place}, {stream.row(row)} has no number for {(empty or ['time'])[0]}")
    return kept, {"time": time[kept], **{name: values[kept] for name, values in columns.items()}}


def _from_quaternions(stream: Stream, rows: NDArray[np.int64], xyzw: Array) -> Array:
    """Rotations; a quaternion of zeros, or a missing one, stands for a body that was not seen."""
    norm = np.linalg.norm(xyzw, axis=1)
    for row in np.flatnonzero((norm > 0) & (abs(norm - 1) > NEAR))[:1]:
        place = f"{stream.place}, {stream.row(rows[row])}"
        raise ValueError(f"{place}: the quaternion {np.round(xyzw[row], 6).tolist()} is not of unit length")
    return rotations_from_quaternions(xyzw)


def _from_matrices(stream: Stream, rows: NDArray[np.int64], flat: Array) -> Array:
    """The nearest rotations of matrices that are rotations except for rounding; NaN where one is missing."""
    seen = np.asarray(np.isfinite(flat).all(axis=1))[:, None, None]
    matrices = np.where(seen, flat.reshape(-1, 3, 3), np.eye(3))
    u, stretch, v = np.linalg.svd(matrices)
    off = np.max(abs(stretch - 1), axis=1, initial=0.0)
    wrong = (off > NEAR) | (np.linalg.det(matrices) < 0)
    for row in np.flatnonzero(wrong)[:1]:
        raise ValueError(
            f"{stream.place}, {stream.row(rows[row])}: the matrix is not a rotation ({off[row]:.1e} away, "
            f"determinant {np.linalg.det(matrices[row]):.3g}); expected an orthonormal one of determinant +1"
        )
    rotation: Array = np.where(seen, u @ v, np.nan)
    return rotation


def _assemble(imu: Array, taken: Array, arrival: Array, position: Array, rotation: Array) -> Recording:
    """A recording in the order of time, without duplicate samples."""
    imu = imu[np.unique(imu[:, 0], return_index=True)[1]]
    return Recording(imu[:, 0], imu[:, 1:4], imu[:, 4:7], taken, position, rotation, arrival)
