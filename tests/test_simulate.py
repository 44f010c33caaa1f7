"""Closed loops in Rust: the springs of the paper's first experiment, and what `simulate` promises."""

from __future__ import annotations

import pickle
import threading

import numpy as np
import pytest
import tilthex
from scipy.signal import lti, step

VEHICLE = tilthex.Vehicle.preset("tilt-hex")
CONFIG = tilthex.Config.default(VEHICLE)
HOME = tilthex.Setpoint([0, 0, 1], np.eye(3))
PUSH, DEAD_ZONE, BEGIN = 1.4, 0.2, 2.0


def shaped(mass: float, damping: float, stiffness: float) -> tilthex.Config:
    return CONFIG.replace(
        admittance={
            "mass": [mass] * 3 + [0.01, 0.01, 0.02],
            "damping": [damping] * 3 + [4] * 3,
            "stiffness": [stiffness] * 3 + [10, 10, 5],
        }
    )


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    ("mass", "damping", "stiffness"),
    [(1.5, 10, 6), (1.5, 10, 4), (1.5, 10, 8), (1.5, 5, 6), (1.5, 20, 6), (0.75, 10, 6), (3, 10, 6)],
)
def test_the_tool_is_the_spring_that_it_is_told_to_be(mass, damping, stiffness, seed):
    """With the experiments' noise and the estimator in the loop; released again at the end.

    The steady state is the mean of 40 s: over T seconds the accelerometer's
    noise alone leaves a mean force of 2.4 kg 0.15 m/s^2 / sqrt(500 T), 2.5 mN.
    """
    held = 8 * max(damping / stiffness, mass / damping) + 40
    push = {"at": BEGIN, "duration": held, "force": [PUSH, 0, 0]}
    run = tilthex.simulate(
        shaped(mass, damping, stiffness),
        duration=BEGIN + held + 4,
        setpoint=HOME,
        pushes=[push],
        seed=seed,
    )
    time, tool, reference = run["time"][:, 0], run["tool_position"], run["reference_position"][:, 0]
    steady = (time > BEGIN + held - 40) & (time < BEGIN + held)
    expected = (PUSH - DEAD_ZONE) / stiffness
    assert abs(tool[steady, 0].mean() - expected) < 2e-3
    np.testing.assert_allclose(tool[steady, 1:].mean(axis=0), [0, 1], atol=2e-3)
    # The ideal mass, spring and damper under the push less the dead zone, on and off.
    period = time[1]
    on = step(lti([1], [mass, damping, stiffness]), T=time)[1] * (PUSH - DEAD_ZONE)
    ideal = np.zeros_like(time)
    for at, sign in ((BEGIN, 1), (BEGIN + held, -1)):
        first = round(at / period)
        ideal[first:] += sign * on[: len(time) - first]
    assert abs(reference - ideal).max() < 10e-3
    assert not run["saturated"].any()


def test_biases_are_found_by_the_estimator():
    biases = {"gyro_bias": [0.01, -0.02, 0.015], "accelerometer_bias": [0.1, -0.05, 0.2]}
    run = tilthex.simulate(CONFIG, duration=20, setpoint=HOME, seed=5, **biases)
    settled = run["time"][:, 0] > 15
    np.testing.assert_allclose(run["tool_position"][settled].mean(axis=0), [0, 0, 1], atol=3e-3)
    # Until its bias is found an accelerometer's force is no force.
    assert abs(run["wrench_tool"][settled].mean(axis=0)).max() < 0.1


def test_a_seed_is_a_flight():
    runs = [tilthex.simulate(CONFIG, duration=0.4, setpoint=HOME, seed=s) for s in (7, 7, 8)]
    for name, array in runs[0].items():
        assert array.tobytes() == runs[1][name].tobytes()
        assert len(array) == 200
    assert runs[0]["position"].tobytes() != runs[2]["position"].tobytes()


def test_only_what_is_asked_for_is_recorded():
    whole = tilthex.simulate(CONFIG, duration=0.2, setpoint=HOME)
    part = tilthex.simulate(CONFIG, duration=0.2, setpoint=HOME, record=("tool_position", "phase"))
    assert part.keys() == {"tool_position", "phase"}
    assert all(part[name].tobytes() == whole[name].tobytes() for name in part)
    assert part.faults == whole.faults
    with pytest.raises(ValueError, match='record has "tool"; expected any of time, position'):
        tilthex.simulate(CONFIG, duration=0.2, setpoint=HOME, record=["tool"])


def test_the_whole_run_is_the_blocks_one_by_one():
    """The loop in Rust and a loop in Python over Controller and Plant are the same numbers."""
    push = {"at": 0.1, "duration": 5.0, "force": [1.0, -0.5, 2.0], "torque": [0.1, 0.3, -0.2]}
    run = tilthex.simulate(CONFIG, duration=1, setpoint=HOME, pushes=[push], noise=0, estimator=False)
    controller = tilthex.Controller(VEHICLE, CONFIG)
    plant = tilthex.Plant(VEHICLE, HOME.position - VEHICLE.tool_position)
    for k in range(500):
        wrench = np.r_[push["force"], push["torque"]] if 0.002 * k >= 0.1 else np.zeros(6)
        at_centre = VEHICLE.robot_wrench(wrench, plant.rotation)
        np.testing.assert_allclose(plant.position, run["position"][k], atol=1e-12)
        np.testing.assert_allclose(plant.rotation.ravel(), run["rotation"][k], atol=1e-12)
        w = plant.rotor_speeds
        actuation = VEHICLE.allocation[:3] @ (w * abs(w))
        out = controller.step(
            position=plant.position,
            velocity=plant.velocity,
            rotation=plant.rotation,
            angular_velocity=plant.angular_velocity,
            specific_force=(actuation + plant.rotation.T @ at_centre[:3]) / VEHICLE.mass,
            rotor_speeds=w,
            setpoint=HOME,
        )
        np.testing.assert_allclose(out.rotor_speeds, run["rotor_command"][k], atol=1e-8)
        np.testing.assert_allclose(out.wrench_tool, run["wrench_tool"][k], atol=1e-8)
        plant.step(out.rotor_speeds, tool_wrench=wrench, dt=0.002)


def test_a_trajectory_is_followed():
    turn = tilthex.so3.exp([0, 0.2, 0.5])
    way = tilthex.Trajectory(
        [{"position": [0, 0, 1]}, {"position": [0.4, 0.2, 1.3], "rotation": turn, "hold": 2}], velocity=0.3
    )
    run = tilthex.simulate(CONFIG, duration=way.duration, trajectory=way, seed=1)
    apart = np.linalg.norm(run["tool_position"] - run["setpoint_position"], axis=1)
    assert apart.max() < 0.03
    np.testing.assert_allclose(run["setpoint_position"][-1], [0.4, 0.2, 1.3])
    np.testing.assert_allclose(run["tool_rotation"][-1], turn.ravel(), atol=0.01)


def test_other_threads_run_meanwhile():
    turns = 0
    stop = threading.Event()

    def count():
        nonlocal turns
        while not stop.is_set():
            turns += 1

    thread = threading.Thread(target=count)
    thread.start()
    before = turns
    tilthex.simulate(CONFIG, duration=60, setpoint=HOME)
    during = turns - before
    stop.set()
    thread.join()
    assert during > 1000


def test_to_dataframe():
    pandas = pytest.importorskip("pandas")
    run = tilthex.simulate(CONFIG, duration=0.1, setpoint=HOME)
    frame = run.to_dataframe()
    assert isinstance(frame, pandas.DataFrame)
    assert frame.index.name == "time"
    np.testing.assert_array_equal(frame["wrench_tool_2"], run["wrench_tool"][:, 2])
    assert "saturated" in frame


def test_faults_are_those_that_the_phases_answer():
    sound = tilthex.simulate(CONFIG, duration=1.0, setpoint=HOME, noise=0.0)
    assert sound.faults == []
    # More than the rotors can hold against.
    push = {"at": 0.5, "duration": 9.0, "force": [40.0, 0.0, 0.0]}
    run = tilthex.simulate(CONFIG, duration=3.0, setpoint=HOME, pushes=[push])
    begun = {change.name: change.time for change in run.faults if change.begins}
    assert {"external wrench", "landing fails"} <= begun.keys() and min(begun.values()) > 0.5
    left = run["time"][run["phase"] != 3.0].min()
    assert min(begun.values()) <= left, "a fault begins before the phase changes"
    copy = pickle.loads(pickle.dumps(run))
    assert copy.faults == run.faults
    # A fault begins before it ends, and alternates.
    for name in begun:
        changes = [change.begins for change in run.faults if change.name == name]
        assert changes == [k % 2 == 0 for k in range(len(changes))], name
