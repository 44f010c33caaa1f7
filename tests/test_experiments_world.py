"""The simulated world: the exported vehicle, the true contact wrench, the sensors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("mujoco", reason="the experiments need MuJoCo: pip install 'tilthex[experiments]'")

import mujoco
import tilthex
from tilthex.experiments.scenes import Scene, clamp, free_air, funnel, plane, plate_with_ledges
from tilthex.experiments.world import PERIOD, Noise, World
from tilthex.mjcf import TIMESTEP, to_mjcf

QUIET = Noise(0.0, 0.0, 0.0, 0.0, 0.0)


def world_at(scene: Scene, tip: list[float], noise: Noise = QUIET, seed: int = 1) -> World:
    vehicle = tilthex.Vehicle.preset("tilt-hex")
    return World(
        vehicle,
        scene,
        noise,
        seed=seed,
        tool_position=np.array(tip),
        tool_rotation=np.eye(3),
    )


@pytest.mark.parametrize("name", tilthex.Vehicle.presets())
def test_the_exported_vehicle_accelerates_as_the_allocation_matrix_says(name: str) -> None:
    vehicle = tilthex.Vehicle.preset(name)
    model = mujoco.MjModel.from_xml_string(vehicle.to_mjcf())
    data = mujoco.MjData(model)
    assert model.body_subtreemass[0] == pytest.approx(vehicle.mass, rel=1e-12)
    draws = np.random.default_rng(3)
    for _ in range(5):
        rotation = Rotation.random(random_state=int(draws.integers(1 << 30))).as_matrix()
        mujoco.mju_mat2Quat(data.qpos[3:7], rotation.reshape(9))
        data.qvel[:] = draws.standard_normal(6)
        speeds = draws.uniform(*vehicle.rotor_speed_limits.T)
        data.ctrl[:] = speeds * np.abs(speeds)
        mujoco.mj_forward(model, data)
        wrench = vehicle.allocation @ data.ctrl
        omega, inertia = data.qvel[3:], vehicle.inertia
        linear = rotation @ wrench[:3] / vehicle.mass - [0.0, 0.0, 9.81]
        angular = np.linalg.solve(inertia, wrench[3:] - np.cross(omega, inertia @ omega))
        np.testing.assert_allclose(data.qacc, np.r_[linear, angular], rtol=1e-6, atol=1e-6)


SCENES = {
    "plane": (lambda: plane(point=[0.0, 0.0, 0.457], tilt_deg=[10.0, -10.0]), [0.0, 0.0, 0.461]),
    "funnel": (lambda: funnel(entrance=[0.0, 0.0, 0.5], tilt_deg=12.0), [0.002, 0.003, 0.506]),
    "ledges": (lambda: plate_with_ledges(point=[0, 0, 0.497], ledge_x=0.1, ledge_y=0.1), [0.1, 0.1, 0.501]),
    "clamp": (clamp, [0.0, 0.0, 1.0]),
}


@pytest.mark.parametrize("name", SCENES)
def test_the_true_wrench_closes_the_balances_of_momentum(name: str) -> None:
    build, tip = SCENES[name]
    world = world_at(build(), tip)
    vehicle, data = world.vehicle, world.data
    mass, inertia = vehicle.mass, vehicle.inertia
    lift, touched = np.linalg.norm([0.0, 0.0, mass * 9.81]), 0
    for k in range(300):
        # Light thrust and a small moment: the tool rests, slips and rolls.
        data.ctrl[:] = 0.97 * vehicle.hover_speeds() ** 2
        data.xfrc_applied[world._robot, 3:] = 0.02 * np.array([np.sin(0.05 * k), np.cos(0.03 * k), 0.0])
        before = data.qvel.copy()
        mujoco.mju_quat2Mat(world.rotation.reshape(9), data.qpos[3:7])
        rotation, tool = world.rotation.copy(), world.tool_position
        mujoco.mj_step(world.model, data)
        wrench = world.constraint_wrench() if name == "clamp" else world.contact_wrench()[0]
        thrust = vehicle.allocation @ data.ctrl
        force = mass * (data.qvel[:3] - before[:3]) / TIMESTEP - rotation @ thrust[:3]
        force[2] += mass * 9.81
        np.testing.assert_allclose(wrench[:3], force, atol=1e-6 * lift + 1e-4 * np.linalg.norm(force))
        # The angular balance about the centre of mass. The integrator takes the gyroscopic term
        # implicitly, which is second order in the step.
        omega = 0.5 * (before[3:] + data.qvel[3:])
        moment = inertia @ (data.qvel[3:] - before[3:]) / TIMESTEP + np.cross(omega, inertia @ omega)
        moment -= thrust[3:] + rotation.T @ data.xfrc_applied[world._robot, 3:]
        arm = rotation @ vehicle.tool_position
        assert np.linalg.norm(tool - (data.qpos[:3] + arm)) < 1e-2
        about_centre = rotation.T @ (wrench[3:] + np.cross(arm, wrench[:3]))
        np.testing.assert_allclose(about_centre, moment, atol=2e-3 + 0.02 * np.linalg.norm(moment))
        touched += np.linalg.norm(wrench[:3]) > 0.01
    assert touched > 30


def test_a_resting_tip_bears_the_missing_lift_and_sinks_less_than_its_tolerance() -> None:
    world = world_at(plane(point=[0.12, 0.0, 0.5], tilt_deg=[0.0, 0.0], friction=0.3), [0.0, 0.0, 0.5035])
    vehicle = world.vehicle
    # The tip is beside the centre of mass: the lacking lift acts there, with its moment.
    lacking = np.array([0.0, 0.0, 5.0])
    moment = np.cross(vehicle.tool_position, lacking)
    body = np.r_[0.0, 0.0, vehicle.mass * 9.81 - 5.0, -moment]
    speeds = np.sqrt(np.linalg.solve(vehicle.allocation, body))
    for _ in range(250):
        # A light damper stands in for the controller.
        world.data.qvel[:] *= 0.97
        world.step(speeds)
    wrench, _, pressure = world.contact_wrench()
    np.testing.assert_allclose(pressure, [0.0, 0.0, wrench[2]], atol=1e-9)
    assert wrench[2] == pytest.approx(5.0, abs=0.5)
    assert 0.5 + 0.003 - world.tool_position[2] < 0.3e-3


def test_sensors_at_rest_say_gravity_and_their_noise_has_the_stated_size() -> None:
    noise = Noise(pose_delay=0.012, pose_jitter=0.004)
    world = world_at(clamp(), [0.0, 0.0, 1.0], noise)
    speeds = world.vehicle.hover_speeds()
    gyro, specific, rotors, poses = [], [], [], []
    for _ in range(3000):
        world.step(speeds)
        gyro.append(world.gyro())
        specific.append(world.specific_force())
        rotors.append(world.measured_rotor_speeds() - world.rotor_speeds)
        poses += [(pose, world.time) for pose in world.arrived_poses()]
    np.testing.assert_allclose(np.mean(specific, axis=0), [0.0, 0.0, 9.81], atol=0.02)
    for values, size in ((gyro, noise.gyro), (specific, noise.accelerometer), (rotors, noise.rotor_speed)):
        np.testing.assert_allclose(np.std(values, axis=0), size, rtol=0.1)
    assert len(poses) == pytest.approx(600, abs=4)
    late = np.array([now - pose.time for pose, now in poses])
    assert late.min() >= 0.008 - 1e-9
    assert late.max() <= 0.016 + PERIOD + 1e-9
    off = np.array([pose.position - world.position for pose, _ in poses])
    np.testing.assert_allclose(np.std(off, axis=0), noise.position, rtol=0.15)
    turns = Rotation.from_matrix([world.rotation.T @ pose.rotation for pose, _ in poses]).as_rotvec()
    np.testing.assert_allclose(np.std(turns, axis=0), noise.orientation, rtol=0.15)


def test_the_same_seed_gives_the_same_flight_and_another_seed_another() -> None:
    def fly(seed: int) -> np.ndarray:
        world = world_at(free_air(), [0.0, 0.0, 1.0], Noise(), seed)
        for _ in range(20):
            world.step(world.measured_rotor_speeds() if world.time else world.vehicle.hover_speeds())
        return np.r_[world.position, world.gyro()]

    np.testing.assert_array_equal(fly(4), fly(4))
    assert np.any(fly(4) != fly(5))


def test_rotors_lag_with_their_time_constant() -> None:
    world = world_at(free_air(), [0.0, 0.0, 1.0])
    start = world.rotor_speeds.copy()
    for _ in range(15):
        world.step(start + 10.0)
    expected = 10.0 * (1.0 - np.exp(-15 * PERIOD / world.vehicle.rotor_time_constant))
    np.testing.assert_allclose(world.rotor_speeds - start, expected, rtol=1e-9)


@pytest.mark.parametrize("tilt", [0.0, 7.0, 20.0])
def test_a_straight_rod_falls_into_a_funnel_of_its_own_tilt(tilt: float) -> None:
    """The tube is open to a rod along its axis, and shut to one that is moved aside."""
    scene = funnel(entrance=[0.0, 0.0, 0.5], tilt_deg=tilt, direction_deg=35.0)
    vehicle = tilthex.Vehicle.preset("tilt-hex")
    model = mujoco.MjModel.from_xml_string(to_mjcf(vehicle, scene.elements))
    data = mujoco.MjData(model)

    def touches(depth: float, aside: float) -> bool:
        tip = scene.origin + scene.rotation @ [aside, 0.0, -depth]
        data.qpos[:3] = tip - scene.rotation @ vehicle.tool_position
        mujoco.mju_mat2Quat(data.qpos[3:7], scene.rotation.reshape(9))
        mujoco.mj_forward(model, data)
        return data.ncon > 0

    assert not any(touches(depth, 0.0014) for depth in np.linspace(-0.03, 0.0449, 20))
    assert touches(0.0455, 0.0)  # the bottom, a tip radius below the tool's origin
    assert all(touches(depth, 0.0017) for depth in np.linspace(0.005, 0.044, 10))
