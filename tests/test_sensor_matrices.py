"""Scale and misalignment of the inertial sensors, found by `tilthex calibrate`."""

from dataclasses import replace

import numpy as np
import pytest
import tilthex
from numpy.testing import assert_array_equal
from scipy.spatial.transform import Rotation
from tilthex.calibration import MATRICES, calibrate
from tilthex.estimate_figures import pose_errors
from tilthex.recording import Recording

from benchmarks import eskf, ungated

SECONDS = 16.0


def cell(name):
    return next(each for each in ungated.CELLS if each.name == name)


def withheld(recording, config):
    """Root mean squares of the errors at every second pose, which the filter does not get: m and rad."""
    fed = np.arange(len(recording.pose_time)) % 2 == 0
    run = recording.select(fed).estimate(tilthex.Ukf(config))
    errors = pose_errors(recording.select(~fed), run, config)
    return np.array([np.sqrt(np.mean(each**2)) for each in (errors.position, errors.rotation)])


@pytest.mark.parametrize("seed", [11, 12])
def test_a_gyro_with_scale_misalignment_and_lag_is_found(seed):
    """Within four standard deviations; with the keys, the errors are those with the true ones."""
    wrong = cell("gyro 3.5 % off, 1.2 deg, 5 ms late")
    recording, _ = ungated.recording(wrong, seed, eskf.Noise(), SECONDS)
    # An accelerometer with a scale of its own, whose z axis gravity shows.
    force = recording.specific_force / [1.0, 1.0, 0.97]
    recording = replace(recording, specific_force=force)
    config = ungated.config()
    found = calibrate(recording, config)
    rate, _ = ungated.Motion(seed + 1, wrong, SECONDS).inertial(recording.imu_time - wrong.lag)
    readings = np.column_stack([recording.gyro, np.ones(len(rate))])
    true = np.linalg.lstsq(readings, rate, rcond=None)[0][:3].T
    assert abs(found.gyro_matrix - true).max() < 4 * found.gyro_deviation.max()
    assert (abs(found.gyro_matrix - true) < 4 * found.gyro_deviation).all()
    off = found.accelerometer_scale - [1.0, 1.0, 0.97]
    assert (abs(off) < 4 * found.accelerometer_deviation).all()
    assert abs(found.latency + wrong.lag) < 4 * found.deviation[6] < 2e-3
    assert found.written == MATRICES
    known = found.config(config)
    assert tilthex.Config.from_text(known.to_toml()) == known
    matrices = {"gyro_matrix": true.tolist(), "accelerometer_matrix": [1.0, 1.0, 0.97]}
    exact = known.replace(estimator=matrices | {"latency": -wrong.lag, "body_position": [0.0] * 3})
    assert (withheld(recording, known) < 1.1 * withheld(recording, exact)).all()
    assert (withheld(recording, known) < 0.6 * withheld(recording, config))[1]


def test_the_matrices_of_good_sensors_stay_as_they_are_configured():
    recording, _ = ungated.recording(cell("matched noises, 20 Hz"), 13, eskf.Noise(), SECONDS)
    config = ungated.config()
    found = calibrate(recording, config)
    assert found.written == ()
    before, after = (tilthex.Config.from_text(c.to_toml()) for c in (config, found.config(config)))
    assert "gyro_matrix = [1.0, 1.0, 1.0]" in before.to_toml()
    assert "gyro_matrix = [1.0, 1.0, 1.0]" in after.to_toml()
    assert str(found).count("# gyro_matrix = ") == 1
    assert found.gyro_deviation.max() < 0.01
    assert_array_equal(found.deviation > 0, True)


def test_a_lever_arm_is_not_made_longer_than_it_is():
    """Slow motion hardly shows it, and a longer one predicts larger innovations."""
    rng = np.random.default_rng(404)
    time = np.arange(0, 12, 0.005)
    swing = rng.uniform(0.2, 0.9, (6, 6)), rng.uniform(0, 2 * np.pi, (6, 6))
    size = rng.uniform(0.3, 1, (6, 6)) * np.repeat([0.15, 0.2], 3)[:, None]

    def pose(at):
        waves = np.sin(2 * np.pi * np.multiply.outer(at, swing[0]) + swing[1])
        where = (waves * size).sum(axis=2) * (np.clip((at - 1.0) / 2, 0, 1) ** 3)[:, None]
        return where[:, :3], Rotation.from_euler("ZYX", where[:, 3:])

    step = 1e-3
    before, here, after = (pose(time + shift) for shift in (-step, 0.0, step))
    gyro = (before[1].inv() * after[1]).as_rotvec() / (2 * step) + rng.normal(0, 7e-3, (len(time), 3))
    lift = (before[0] - 2 * here[0] + after[0]) / step**2 + [0, 0, tilthex.GRAVITY]
    force = here[1].inv().apply(lift) + rng.normal(0, 0.14, (len(time), 3))
    arm = np.array([0.03, -0.02, 0.05])
    stamp = time[::5]
    place = here[0][::5] + here[1][::5].apply(arm) + rng.normal(0, 2e-3, (len(stamp), 3))
    turned = Rotation.from_rotvec(rng.normal(0, 6e-3, (len(stamp), 3))) * here[1][::5]
    recording = Recording(time, gyro, force, stamp, place, turned.as_matrix(), stamp)
    default = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
    found = calibrate(recording, default.replace(vehicle={"imu_position": [0, 0, 0]}))
    assert np.linalg.norm(found.body_position - arm) < 0.02
    assert (abs(found.body_position - arm) < 4 * found.deviation[:3]).all()
