"""Compares the estimator with the same filter in NumPy and in filterpy: accuracy and time of one run.

python -m benchmarks.ukf
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import tilthex
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from ukf_reference import FilterpyUkf, Noise, NumpyUkf, recording, run

Array = NDArray[np.float64]


def noise_of(config: tilthex.Config) -> Noise:
    """The noises of a configuration."""
    keys = {}
    for line in config.to_toml().split("[estimator]")[1].splitlines():
        name, _, value = line.partition(" = ")
        if name.endswith(("_noise", "_walk", "_noise_deg")):
            keys[name] = float(value)
    return Noise(
        gyro=keys["gyro_noise"],
        accelerometer=keys["accelerometer_noise"],
        gyro_bias=keys["gyro_bias_walk"],
        accelerometer_bias=keys["accelerometer_bias_walk"],
        position=keys["position_noise"],
        rotation=np.radians(keys["rotation_noise_deg"]),
    )


def compare(
    config: tilthex.Config,
    fed: tuple[tuple[Array, Array, Array], Array, Array, Array],
    truth: tuple[Array, Array],
) -> None:
    """Prints one row per filter.

    Args:
        config: The configuration; its gate is opened and its initial deviations are the default ones.
        fed: Samples (time, gyro, specific force); the indices of the samples with a pose, its position
        and rotation.
        truth: The indices of the samples with a known position, and these positions.
    """
    imu, places, position, rotation = fed
    noise = noise_of(config)
    config = config.replace(estimator={"gate_probability": 1.0, "initial_velocity": 0.1})
    measured = dict(zip(places.tolist(), zip(position, rotation, strict=True), strict=True))
    first = measured.pop(0)
    spent, positions = {}, {}
    begin = time.process_time()
    found = tilthex.Ukf(config).run(*imu, imu[0][places], position, rotation, covariance=False)
    spent["tilthex"], positions["tilthex"] = time.process_time() - begin, found.position
    for name, peer in [("NumPy", NumpyUkf.start(*first, noise)), ("filterpy", FilterpyUkf(*first, noise))]:
        begin = time.process_time()
        positions[name] = np.array([peer.state.position for _ in run(peer, imu, measured)])
        spent[name] = time.process_time() - begin
    print("| filter | us of processor a sample | ratio | position error, mm rms | farthest from tilthex, m |")
    print("|---|---|---|---|---|")
    settled = truth[0] > len(imu[0]) // 10
    for name, estimate in positions.items():
        off = estimate[truth[0][settled]] - truth[1][settled]
        error = 1e3 * np.sqrt(np.mean(np.sum(off**2, axis=1)))
        apart = np.abs(estimate - positions["tilthex"]).max()
        each = 1e6 * spent[name] / len(imu[0])
        ratio = spent[name] / spent["tilthex"]
        print(f"| {name} | {each:.2f} | {ratio:.0f} | {error:.4f} | {apart:.1e} |")


def main() -> None:
    """Four simulated seconds of 500 Hz and 100 Hz."""
    vehicle = {"imu_position": [0, 0, 0]}
    config = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex")).replace(vehicle=vehicle)
    t, gyro, force, taken, measured, turned, position = recording(1, 2000)
    compare(config, ((t, gyro, force), taken, measured, turned), (np.arange(len(t)), position))


if __name__ == "__main__":
    main()
