"""tilthex.Ukf against the same filter written in NumPy, and its face."""

import time

import numpy as np
import pytest
import tilthex
from hypothesis import given, settings
from hypothesis import strategies as st
from ukf_reference import Noise, NumpyUkf, recording, run


@pytest.fixture(scope="module")
def config():
    return tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))


def ukf(config, **keys):
    # A vehicle whose IMU sits in the centre of mass, without a gate.
    keys = {"gate_probability": 1.0, **keys}
    return tilthex.Ukf(config.replace(vehicle={"imu_position": [0, 0, 0]}, estimator=keys))


@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_equals_the_filter_in_numpy(seed):
    config = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
    t, gyro, force, taken, measured, turned, _ = recording(seed, 400)
    reference = NumpyUkf.start(measured[0], turned[0], Noise())
    poses = {int(k): (measured[i], turned[i]) for i, k in enumerate(taken) if i > 0}
    found = ukf(config).run(t, gyro, force, t[taken], measured, turned)
    for k in run(reference, (t, gyro, force), poses):
        state = reference.state
        np.testing.assert_allclose(found.position[k], state.position, atol=1e-8)
        np.testing.assert_allclose(found.velocity[k], state.velocity, atol=1e-8)
        np.testing.assert_allclose(found.rotation[k], state.rotation, atol=1e-8)
        np.testing.assert_allclose(found.gyro_bias[k], state.gyro_bias, atol=1e-8)
        np.testing.assert_allclose(found.accelerometer_bias[k], state.accelerometer_bias, atol=1e-8)
        scale = np.sqrt(np.diag(reference.covariance))
        difference = (found.covariance[k] - reference.covariance) / np.outer(scale, scale)
        assert np.abs(difference).max() < 1e-8


def test_stepwise_equals_run(config):
    t, gyro, force, taken, measured, turned, _ = recording(1)
    whole = ukf(config).run(t, gyro, force, t[taken], measured, turned)
    single = ukf(config)
    poses = dict(zip(taken.tolist(), zip(measured, turned, strict=True), strict=True))
    for k in range(len(t)):
        single.predict(t[k], gyro[k], force[k])
        if k == 0:
            single.initialize(t[0], *poses[0])
        elif k in poses:
            assert single.update_pose(t[k], *poses[k]) == "accepted"
    np.testing.assert_array_equal(single.position, whole.position[-1])
    np.testing.assert_array_equal(single.velocity, whole.velocity[-1])
    np.testing.assert_array_equal(single.rotation, whole.rotation[-1])
    np.testing.assert_array_equal(single.covariance, whole.covariance[-1])
    assert single.health["accepted"] == len(taken) - 1
    assert single.health["status"] == "tracking"


def test_late_poses_are_applied_at_their_time(config):
    t, gyro, force, taken, measured, turned, _ = recording(2)
    keep = t[taken] < 1.1
    pose = t[taken][keep], measured[keep], turned[keep]
    arrival = pose[0] + np.random.default_rng(3).uniform(0.005, 0.06, keep.sum())
    arrival[0] = 0.0
    prompt = ukf(config).run(t, gyro, force, *pose)
    late = ukf(config).run(t, gyro, force, *pose, arrival)
    assert late.outcome == prompt.outcome
    np.testing.assert_allclose(late.position[-1], prompt.position[-1], atol=1e-10)
    np.testing.assert_allclose(late.covariance[-1], prompt.covariance[-1], rtol=1e-8, atol=1e-14)


def test_innovations_are_white_and_as_large_as_predicted(config):
    t, gyro, force, taken, measured, turned, position = recording(4, 5000)
    found = ukf(config, initial_velocity=3.0).run(
        t, gyro, force, t[taken], measured, turned, covariance=False
    )
    assert found.covariance is None
    settled = found.innovation[100:] / found.innovation_deviation[100:]
    assert np.all(np.abs(settled.mean(axis=0)) < 0.3)
    assert np.all(settled.std(axis=0) < 1.2)
    assert np.sqrt(np.mean((found.position - position)[1000:] ** 2)) < 0.5e-3


def test_refuses_what_can_not_be(config):
    filter = ukf(config)
    with pytest.raises(ValueError, match=r"gyro has shape \(2,\); expected \(3,\)"):
        filter.predict(0.0, [0, 0], [0, 0, 9.81])
    with pytest.raises(ValueError, match=r"rotation is .* away from a rotation"):
        filter.initialize(0.0, [0, 0, 0], np.ones((3, 3)))
    with pytest.raises(ValueError, match="the IMU was watched for"):
        filter.initialize_at_rest(0.0, [0, 0, 0], np.eye(3))
    with pytest.raises(ValueError, match=r"gyro has shape \(3, 2\); expected \(4, 3\)"):
        filter.run(np.arange(4.0), np.zeros((3, 2)), np.zeros((4, 3)), [0.0], np.zeros((1, 3)), [np.eye(3)])
    with pytest.raises(ValueError, match=r"imu_time\[2\] is 0.5 after 1; expected times that increase"):
        filter.run([0, 1, 0.5], np.zeros((3, 3)), np.zeros((3, 3)), [0.0], np.zeros((1, 3)), [np.eye(3)])
    assert filter.update_pose(0.0, [0, 0, 0], np.eye(3)) == "uninitialized"


def test_rounded_rotations_are_rotations(config):
    t, gyro, force, taken, measured, turned, position = recording(6)
    rounded = np.round(turned, 5)
    assert np.abs(rounded - turned).max() > 1e-6
    found = ukf(config).run(t, gyro, force, t[taken], measured, rounded)
    assert np.abs(found.position - position)[200:].max() < 2e-3
    far = turned.copy()
    far[7] *= 1.1
    with pytest.raises(ValueError, match=r"rotation\[7\] is 3.3e-1 away from a rotation"):
        ukf(config).run(t, gyro, force, t[taken], measured, far)


@pytest.mark.parametrize(
    ("scales", "question"),
    [
        ((1e9, 1, 1), "is it in nanoseconds\\? expected seconds"),
        ((1, 57.3, 1), "is it in degrees per second\\? expected rad/s"),
        ((1, 1, 1 / 9.81), "is it in g\\? expected m/s"),
    ],
)
def test_other_units_are_questioned(config, scales, question):
    t, gyro, force, taken, measured, turned, _ = recording(7)
    t, gyro, force = scales[0] * t, scales[1] * gyro, scales[2] * force
    with pytest.raises(ValueError, match=question):
        ukf(config).run(t, gyro, force, t[taken], measured, turned)


def test_run_releases_the_interpreter(config):
    import threading

    t, gyro, force, taken, measured, turned, _ = recording(5, 3000)
    t = np.concatenate([t + 6.0 * k for k in range(40)])
    gyro, force = np.tile(gyro, (40, 1)), np.tile(force, (40, 1))
    filter = ukf(config)
    worker = threading.Thread(
        target=lambda: filter.run(t, gyro, force, t[taken], measured, turned, covariance=False)
    )
    worker.start()
    ticks = 0
    while worker.is_alive():
        ticks += 1
        time.sleep(0)
    worker.join()
    assert ticks > 10
