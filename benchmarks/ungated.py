"""Compares the estimator with an error-state filter without a gate (`benchmarks/eskf.py`) under wrong
noises.

    python -m benchmarks.ungated

The recordings are synthetic and follow those of a hexarotor (EuRoC): an IMU at 200 Hz on a vibrating
frame, and poses at 20 or 10 Hz, some of them late or with gaps. The IMU may have a scale error, be
misaligned or late, or be tapped. Both filters get the same noises, which are the default ones. Seeds
below 100 tuned the estimator; seeds from 1000 on give the reported values.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
import tilthex
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation
from tilthex.estimate_figures import PoseErrors, pose_errors
from tilthex.recording import Recording

from benchmarks import eskf

Array = NDArray[np.float64]
# Errors of the estimator, and of the ungated filter.
Pair = tuple[PoseErrors, PoseErrors]


@dataclass(frozen=True)
class Cell:
    """A synthetic recording: the poses, the disturbances, and the ratios of true to assumed noises."""

    name: str
    pose_every: int = 10
    late: float = 0.0
    gaps: float = 0.0
    pose_noise: float = 1.0
    imu_noise: float = 1.0
    scale: float = 0.0
    misalignment_deg: float = 0.0
    lag: float = 0.0
    taps: float = 0.0
    tap_length: tuple[float, float] = (0.006, 0.02)
    vibration: float = 0.0
    pace: float = 1.0
    rate: float = 200.0


CELLS = (
    Cell("matched noises, 20 Hz"),
    Cell("matched noises, 10 Hz, 30 ms late, gaps of 1 s", pose_every=20, late=0.03, gaps=1.0),
    Cell("vibration", vibration=1.0),
    Cell("vibration, 10 Hz, 30 ms late, gaps of 1 s", pose_every=20, late=0.03, gaps=1.0, vibration=1.0),
    Cell("poses 3 times as noisy", pose_noise=3.0),
    Cell("poses 10 times as noisy", pose_noise=10.0),
    Cell("poses a third as noisy", pose_noise=1 / 3),
    Cell("IMU 3 times as noisy", imu_noise=3.0),
    Cell("IMU 10 times as noisy", imu_noise=10.0),
    Cell("IMU 10 times as noisy, 10 Hz, gaps", pose_every=20, late=0.03, gaps=1.0, imu_noise=10.0),
    Cell("IMU a tenth as noisy", imu_noise=0.1),
    Cell("gyro 3.5 % off, 1.2 deg, 5 ms late", scale=0.035, misalignment_deg=1.2, lag=5e-3),
    Cell("the same, fast", scale=0.035, misalignment_deg=1.2, lag=5e-3, pace=3.0),
    Cell("the same, 10 Hz, 30 ms late, gaps", 20, 0.03, 1.0, scale=0.035, misalignment_deg=1.2, lag=5e-3),
    Cell("taps", taps=0.5),
    Cell("taps, 286 Hz", 14, taps=0.5, rate=2000 / 7),
    Cell("hard taps, 286 Hz", 14, taps=0.5, rate=2000 / 7, tap_length=(0.002, 0.006)),
)


class Motion:
    """A sum of sines in position and rotation that starts at rest, and taps."""

    def __init__(self, seed: int, cell: Cell, seconds: float) -> None:
        random = np.random.default_rng(seed)

        def waves(size: tuple[float, float], slow: float) -> tuple[Array, Array, Array]:
            rate = cell.pace * slow * np.array([0.5, 1.7]) * random.uniform(0.6, 1.4, (3, 2))
            amplitude = np.array(size) * random.uniform(0.5, 1.5, (3, 2))
            return rate, amplitude, random.uniform(0, 2 * np.pi, (3, 2))

        self.place, self.turn = waves((0.8, 0.15), 1.0), waves((0.35, 0.12), 1.5)
        count = int(cell.taps * seconds)
        self.begin = random.uniform(6, seconds - 1, count)
        self.length = random.uniform(*cell.tap_length, count)
        harder = 0.012 / self.length[:, None]
        self.jolt = harder * random.normal(0, 60, (count, 3)), harder * random.normal(0, 100, (count, 3))

    def taps(self, time: Array, jolt: Array) -> tuple[Array, Array]:
        """Displacement by half sines of acceleration and back, and its second derivative."""
        k = 5.0
        moved, pushed = np.zeros((len(time), 3)), np.zeros((len(time), 3))
        for begin, length, size in zip(self.begin, self.length, jolt, strict=True):
            t = (time - begin)[:, None]
            inside, after = (t >= 0) & (t < length), t >= length
            wave = np.pi / length
            end, speed = size * length**2 / np.pi, 2 * size * length / np.pi
            drive = speed + k * end
            fade = np.exp(-k * np.where(after, t - length, 0))
            moved += np.where(inside, size / wave * (t - np.sin(wave * t) / wave), 0)
            moved += np.where(after, (end + drive * (t - length)) * fade, 0)
            pushed += np.where(inside, size * np.sin(wave * t), 0)
            pushed += np.where(after, (k * k * end - 2 * k * drive + k * k * drive * (t - length)) * fade, 0)
        return moved, pushed

    def smooth(self, time: Array, waves: tuple[Array, Array, Array]) -> Array:
        rate, amplitude, phase = waves
        ramp = np.clip((time - 2.0) / 3.0, 0, 1)[:, None]
        ramp = ramp**4 * (35 - 84 * ramp + 70 * ramp**2 - 20 * ramp**3)
        return ramp * np.sum(amplitude * np.sin(rate * time[:, None, None] + phase), axis=2)

    def pose(self, time: Array) -> tuple[Array, Rotation]:
        turn = Rotation.from_rotvec(self.taps(time, self.jolt[1])[0])
        position = self.smooth(time, self.place) + self.taps(time, self.jolt[0])[0]
        return position, turn * Rotation.from_rotvec(self.smooth(time, self.turn))

    def inertial(self, time: Array) -> tuple[Array, Array]:
        """Rate (body) and acceleration (world)."""
        h = 1e-4
        a, b, c = (self.smooth(time + dt, self.place) for dt in (-h, 0.0, h))
        before, after = self.pose(time - 0.1 * h)[1], self.pose(time + 0.1 * h)[1]
        acceleration = (a - 2 * b + c) / h**2 + self.taps(time, self.jolt[0])[1]
        return (before.inv() * after).as_rotvec() / (0.2 * h), acceleration


def blurred(moving: Motion, time: Array) -> tuple[Array, Array]:
    """Rate and specific force of sensors with a lag of 1 ms, so that no tap falls between two samples."""
    fine = 8
    at = np.arange(len(time) * fine) * (time[1] - time[0]) / fine
    rate, acceleration = moving.inertial(at)
    force = moving.pose(at)[1].inv().apply(acceleration + eskf.GRAVITY)
    share = 1 - np.exp(-(at[1] - at[0]) / 1e-3)
    low = lfilter([share], [1, share - 1], np.hstack([rate, force]), axis=0)
    return low[::fine, :3], low[::fine, 3:]


def recording(cell: Cell, seed: int, noise: eskf.Noise, seconds: float = 40.0) -> tuple[Recording, Recording]:
    """The inputs of the filters, and the true values at every inertial sample."""
    random = np.random.default_rng(seed)
    time = np.arange(0, seconds, 1 / cell.rate)
    n = len(time)
    moving = Motion(seed + 1, cell, seconds)
    position, rotation = moving.pose(time)
    rate, acceleration = moving.inertial(time - cell.lag)
    for tone in (71.0, 88.0, 143.0) if cell.vibration else ():
        wobble = np.cumsum(random.normal(0, 2.0, n)) / cell.rate
        size = random.normal(0, 0.6 * cell.vibration, 3)
        acceleration = acceleration + size * np.sin(2 * np.pi * (tone * time + wobble))[:, None]
    force = moving.pose(time - cell.lag)[1].inv().apply(acceleration + eskf.GRAVITY)
    if cell.taps:
        rate, force = blurred(moving, time)
    turn = Rotation.from_rotvec(np.radians(cell.misalignment_deg) * random.normal(0, 1, 3) / np.sqrt(3))
    gyro = turn.apply(rate) * (1 + cell.scale * random.choice([-1, 1], 3))
    density = np.sqrt(cell.rate) * cell.imu_noise
    gyro = gyro + random.normal(0, 0.01, 3) + density * noise.gyro * random.standard_normal((n, 3))
    force = force + random.normal(0, 0.1, 3) + density * noise.accelerometer * random.standard_normal((n, 3))
    taken = np.arange(0, n, cell.pose_every)
    if cell.gaps:
        taken = taken[(time[taken] % 5.0 >= cell.gaps) | (time[taken] < 5.0)]
    m = len(taken)
    off = cell.pose_noise * noise.position * random.standard_normal((m, 3))
    turned = Rotation.from_rotvec(cell.pose_noise * noise.rotation * random.standard_normal((m, 3)))
    stamp = time[taken]
    poses = position[taken] + off, (turned * rotation[taken]).as_matrix()
    fed = Recording(time, gyro, force, stamp, *poses, stamp + cell.late)
    truth = Recording(time, gyro, force, time, position, rotation.as_matrix(), time)
    return fed, truth


def config(keys: dict[str, float] | None = None) -> tilthex.Config:
    """A robot that consists only of its IMU."""
    default = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
    mounting = {"imu_position": [0, 0, 0], "imu_rotation_deg": [0, 0, 0]}
    return default.replace(vehicle=mounting, estimator=keys or {})


def compare(
    fed: Recording, truth: Recording, config: tilthex.Config, noise: eskf.Noise, latency: float = 0.0
):
    """Position and rotation errors of both filters, after the first 4 s."""
    later = truth.select(truth.pose_time > truth.imu_time[0] + 4.0)
    run = fed.estimate(tilthex.Ukf(config))
    peer = eskf.run(fed, noise, latency=latency)
    return pose_errors(later, run, config), pose_errors(later, peer, config), run


def figures(found: list[Pair], part: str) -> tuple[tuple[float, float], tuple[float, float]]:
    """Root mean square and largest of both filters, "position" in m or "rotation" in rad."""
    values = (np.concatenate([getattr(pair[side], part) for pair in found]) for side in (0, 1))
    ours, theirs = ((float(np.sqrt(np.mean(v**2))), float(v.max())) for v in values)
    return ours, theirs


def row(name: str, found: list[Pair]) -> str:
    """One line of the table: root mean square and largest, and the ratios."""
    columns, ratios = [], []
    for part, scale in (("position", 1e3), ("rotation", np.degrees(1.0))):
        both = figures(found, part)
        columns += [f"{scale * rms:.2f} / {scale * largest:.2f}" for rms, largest in both]
        ratios += [f"{a / b:.2f}" for a, b in zip(*both, strict=True)]
    return f"| {name} | {' | '.join(columns)} | {', '.join(ratios)} |"


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(
        description="compares the estimator with an error-state filter without a gate"
    )
    parser.add_argument("--seed", type=int, default=1000, help="seed of the first recording")
    parser.add_argument("--runs", type=int, default=2, help="number of recordings per row")
    parser.add_argument("--only", default="", help="only rows whose name contains this text")
    arguments = parser.parse_args()
    print("| recording | position, mm | ungated | rotation, deg | ungated | ratios |")
    print("|---|---|---|---|---|---|")
    noise = eskf.Noise()
    for cell in CELLS:
        if arguments.only in cell.name:
            found = []
            for seed in range(arguments.seed, arguments.seed + arguments.runs):
                fed, truth = recording(cell, 10 * seed, noise)
                found.append(compare(fed, truth, config(), noise))
            print(row(cell.name, found), flush=True)


if __name__ == "__main__":
    main()
