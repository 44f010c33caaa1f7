"""Scale and misalignment of the inertial sensors, found by `tilthex calibrate`."""

from dataclasses import replace

import numpy as np
import pytest
import tilthex
from numpy.testing import assert_array_equal
from tilthex.calibration import MATRICES, calibrate
from tilthex.estimate_figures import pose_errors

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
