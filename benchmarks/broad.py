"""The estimator on real recordings: errors at withheld poses, compared with filterpy.

    python -m benchmarks.broad

The recordings (BROAD, Laidig et al. 2021) have a raw hand-held IMU at 285.7 Hz, which is tapped in one of
them, and OptiTrack poses. They are read from ../shared/data/broad, or from the folder `broad` of
$TILTHEX_DATA.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import tilthex
from numpy.typing import NDArray
from tilthex.estimate import calibrate
from tilthex.estimate_figures import pose_errors
from tilthex.noises import find_noises
from tilthex.recording import Recording

from benchmarks.ukf import compare

Array = NDArray[np.float64]
NAME = "10_undisturbed_slow_translation_A.mat"
TAPPED = "24_disturbed_tapping_A.mat"
# Noises of this IMU (twice the values of its datasheet) and of this capture system.
KEYS = {
    "gyro_noise": 2e-4,
    "accelerometer_noise": 4e-3,
    "gyro_bias_walk": 2e-5,
    "accelerometer_bias_walk": 5e-4,
    "position_noise": 3e-4,
    "rotation_noise_deg": 0.1,
    "initial_velocity": 0.5,
}


def path(name: str = NAME) -> Path:
    """Path of a recording, whether it exists or not."""
    root = os.environ.get("TILTHEX_DATA")
    folder = Path(root) if root else Path(__file__).parents[1] / ".." / "shared" / "data"
    return folder / "broad" / name


def load(name: str = NAME) -> Recording:
    """A whole recording; poses with hidden markers are left out."""
    return Recording.from_file(path(name), config()).tracked()


def config() -> tilthex.Config:
    """A robot that consists only of this IMU."""
    default = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
    mounting = {"imu_position": [0, 0, 0], "imu_rotation_deg": [0, 0, 0]}
    return default.replace(vehicle=mounting, estimator=KEYS)


def minute(recording: Recording) -> Recording:
    """The minute of motion that calibrates, with a third of its poses."""
    begin, end = 60.0, 120.0
    inside = (recording.imu_time >= begin) & (recording.imu_time < end)
    part = Recording(
        recording.imu_time[inside],
        recording.gyro[inside],
        recording.specific_force[inside],
        recording.pose_time,
        recording.position,
        recording.rotation,
        recording.pose_arrival_time,
    ).select((recording.pose_time >= begin) & (recording.pose_time < end))
    return part.select(np.arange(len(part.pose_time)) % 3 == 0)


def with_gaps(recording: Recording, every: float, length: float) -> Array:
    """Which poses lie outside gaps of `length` seconds that begin every `every` seconds."""
    return (recording.pose_time % every >= length) | (recording.pose_time < every)


def errors(recording: Recording) -> None:
    """Prints what calibrate finds, and a table of errors at withheld poses without and with its noises."""
    part = minute(recording)
    offset = calibrate(part, config())
    known = offset.config(config())
    print(f"{offset}\n")
    table(recording, known)
    noises = find_noises(part, known)
    print(f"\nWith the noises that calibrate finds:\n\n{noises}\n")
    table(recording, noises.config(known))


def table(recording: Recording, known: tilthex.Config) -> None:
    """Prints the errors at withheld poses."""
    number = np.arange(len(recording.pose_time))
    print("| poses fed | withheld | position rms, 95 %, max (mm) | rotation rms, 95 %, max (deg) | NIS |")
    print("|---|---|---|---|---|")
    for name, fed in [
        ("95 Hz", number % 3 == 0),
        ("20 Hz", number % 14 == 0),
        ("95 Hz, gaps of 1 s every 10 s", (number % 3 == 0) & with_gaps(recording, 10.0, 1.0)),
        ("20 Hz, gaps of 1 s every 10 s", (number % 14 == 0) & with_gaps(recording, 10.0, 1.0)),
    ]:
        run = recording.select(fed).estimate(tilthex.Ukf(known))
        found = pose_errors(recording.select(~fed), run, known)
        columns = [
            f"{np.sqrt(np.mean(v**2)):.3f}, {np.percentile(v, 95):.3f}, {v.max():.2f}"
            for v in (1e3 * found.position, np.degrees(found.rotation))
        ]
        print(f"| {name} | {(~fed).sum()} | {columns[0]} | {columns[1]} | {np.nanmean(run.nis):.2f} |")


def beside(recording: Recording, seconds: float = 20.0) -> None:
    """Compares the filters on some seconds of a recording."""
    inside = (recording.imu_time >= 60.0) & (recording.imu_time < 60.0 + seconds)
    imu = (recording.imu_time[inside], recording.gyro[inside], recording.specific_force[inside])
    poses = recording.select((recording.pose_time >= imu[0][0]) & (recording.pose_time <= imu[0][-1]))
    fed = np.arange(len(poses.pose_time)) % 3 == 0
    given, held = poses.select(fed), poses.select(~fed)
    compare(
        config(),
        (imu, np.searchsorted(imu[0], given.pose_time), given.position, given.rotation),
        (np.searchsorted(imu[0], held.pose_time), held.position),
    )


def main() -> None:
    """Runs everything. Without the recording, prints a sentence and ends with status 2."""
    if not path().exists():
        print(
            f"{path()} is not there: the BROAD data set (Laidig, Caruso, Cereatti and Seel 2021) has it, in "
            "data_mat of https://github.com/dlaidig/broad; TILTHEX_DATA names the folder above `broad`",
            file=sys.stderr,
        )
        sys.exit(2)
    recording = load()
    print(f"{NAME}\n")
    errors(recording)
    print()
    beside(recording)
    print(f"\n{TAPPED}\n")
    errors(load(TAPPED))


if __name__ == "__main__":
    main()
