"""The identities that every wrench observer must satisfy, over random vehicles,
attitudes, gains, periods and wrenches. Nothing here uses the project's own plant:
motions are built from their closed forms, or integrated with SciPy.
"""

from __future__ import annotations

import numpy as np
import tilthex
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from strategies import forces, gains, inertias, numbers, periods, rotations, speeds_for, torques, vehicles

GRAVITY = np.array([0, 0, tilthex.GRAVITY])
STEPS = 60
TOLERANCE = 1e-9


def observer(vehicle, force_gain, torque_gain) -> tilthex.WrenchObserver:
    config = tilthex.Config.default(vehicle)
    changes = {"force_gain": force_gain, "torque_gain": torque_gain}
    return tilthex.WrenchObserver(vehicle, config.replace(wrench_observer=changes))


def near(found, expected):
    """Within 1e-9 N or N m, whatever the vehicle weighs."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=TOLERANCE)


def body_wrench(vehicle, speeds):
    return vehicle.allocation @ (speeds * abs(speeds))


def specific_force(vehicle, rotation, speeds, force):
    """What an ideal accelerometer in the centre of mass reads, robot coordinates."""
    return (body_wrench(vehicle, speeds)[:3] + rotation.T @ force) / vehicle.mass


@given(vehicles(), rotations(), gains, gains, periods)
def test_a_hover_of_any_attitude_gives_nothing(vehicle, rotation, force_gain, torque_gain, dt):
    block = observer(vehicle, force_gain, torque_gain)
    speeds = speeds_for(vehicle, np.r_[rotation.T @ GRAVITY * vehicle.mass, 0, 0, 0])
    for _ in range(STEPS):
        found = block.step(
            rotation=rotation,
            angular_velocity=np.zeros(3),
            specific_force=rotation.T @ GRAVITY,
            rotor_speeds=speeds,
            dt=dt,
        )
    near(found, 0)


@given(inertias(), rotations(), numbers(-8, 8, 3), gains, gains, periods, st.data())
def test_a_torque_free_tumbling_body_gives_nothing(
    inertia, rotation, omega, force_gain, torque_gain, dt, data
):
    """In free fall, with every rotor still, whatever the inertia."""
    vehicle = data.draw(vehicles(inertia=inertia.tolist()))
    block = observer(vehicle, force_gain, torque_gain)
    momentum_w = rotation @ inertia @ omega
    inverse = np.linalg.inv(inertia)

    def kinematics(_, q):
        w = inverse @ (Rotation.from_quat(q).as_matrix().T @ momentum_w)
        x, y, z, s = q
        return 0.5 * np.array(
            [
                s * w[0] + y * w[2] - z * w[1],
                s * w[1] + z * w[0] - x * w[2],
                s * w[2] + x * w[1] - y * w[0],
                -x * w[0] - y * w[1] - z * w[2],
            ]
        )

    times = dt * np.arange(STEPS)
    start = Rotation.from_matrix(rotation).as_quat()
    way = solve_ivp(kinematics, (0, times[-1]), start, method="DOP853", t_eval=times, rtol=1e-12, atol=1e-13)
    for q in way.y.T:
        attitude = Rotation.from_quat(q).as_matrix()
        found = block.step(
            rotation=attitude,
            angular_velocity=inverse @ (attitude.T @ momentum_w),
            specific_force=np.zeros(3),
            rotor_speeds=np.zeros(6),
            dt=dt,
        )
        near(found, 0)


@given(
    vehicles(), forces, numbers(0.1, 500, 3), gains, st.lists(periods, min_size=2, max_size=STEPS), st.data()
)
def test_a_constant_force_is_recovered_along_its_exponential(
    vehicle, force, force_gain, torque_gain, dts, data
):
    """Axis by axis, while attitude, rotor speeds and period change from sample to sample."""
    block = observer(vehicle, force_gain, torque_gain)
    attitudes = Rotation.random(len(dts), rng=data.draw(st.integers(0, 2**32))).as_matrix()
    speeds = data.draw(numbers(-80, 80, 6))
    elapsed = 0.0
    for k, (dt, rotation) in enumerate(zip(dts, attitudes, strict=True)):
        speeds = np.roll(-speeds, 1)
        found = block.step(
            rotation=rotation,
            angular_velocity=np.zeros(3),
            specific_force=specific_force(vehicle, rotation, speeds, force),
            rotor_speeds=speeds,
            dt=dt,
        )
        # The first sample only marks the beginning.
        elapsed += dt if k else 0.0
        near(found[:3], force * -np.expm1(-force_gain * elapsed))


@given(
    vehicles(),
    st.integers(0, 2),
    st.floats(-2, 2),
    st.floats(-6, 6),
    gains,
    st.lists(periods, min_size=2, max_size=STEPS),
    rotations(),
)
def test_a_constant_torque_is_recovered_along_its_exponential(
    vehicle, axis, torque, rate, torque_gain, dts, start
):
    """About a principal axis, where the motion has a closed form."""
    moments, axes = np.linalg.eigh(vehicle.inertia)
    moment, direction = moments[axis], axes[:, axis]
    block = observer(vehicle, 30, torque_gain)
    elapsed = 0.0
    for k, dt in enumerate(dts):
        elapsed += dt if k else 0.0
        turn = rate * elapsed + 0.5 * torque / moment * elapsed**2
        omega = rate + torque / moment * elapsed
        found = block.step(
            rotation=start @ Rotation.from_rotvec(turn * direction).as_matrix(),
            angular_velocity=omega * direction,
            specific_force=np.zeros(3),
            rotor_speeds=np.zeros(6),
            dt=dt,
        )
        expected = torque * direction * -np.expm1(-torque_gain * elapsed)
        near(found[3:], expected)


@given(vehicles(), rotations(), forces, torques, gains, gains, periods)
def test_a_held_body_shows_the_whole_wrench(vehicle, rotation, force, torque, force_gain, torque_gain, dt):
    """Rotors that balance gravity and a contact: both halves along their own exponential."""
    block = observer(vehicle, force_gain, torque_gain)
    wanted = np.r_[rotation.T @ (vehicle.mass * GRAVITY - force), -torque]
    speeds = speeds_for(vehicle, wanted)
    for k in range(STEPS):
        found = block.step(
            rotation=rotation,
            angular_velocity=np.zeros(3),
            specific_force=rotation.T @ GRAVITY,
            rotor_speeds=speeds,
            dt=dt,
        )
        part = -np.expm1(-np.repeat([force_gain, torque_gain], 3) * k * dt)
        near(found, part * np.r_[force, torque])


@given(vehicles(), rotations(), forces, gains, periods)
def test_a_force_through_the_centre_of_mass_gives_no_torque(vehicle, rotation, force, gain, dt):
    block = observer(vehicle, gain, gain)
    for _ in range(STEPS):
        found = block.step(
            rotation=rotation,
            angular_velocity=np.zeros(3),
            specific_force=rotation.T @ force / vehicle.mass,
            rotor_speeds=np.zeros(6),
            dt=dt,
        )
    near(found[3:], 0)


@given(vehicles(), rotations(), forces, gains, periods)
def test_a_push_at_the_tool_gives_no_tool_torque(vehicle, rotation, force, gain, dt):
    """Held by the rotors, pushed at the tip: the tool feels a force, and at no time a torque."""
    block = observer(vehicle, gain, gain)
    lever_w = rotation @ vehicle.tool_position
    torque = rotation.T @ np.cross(lever_w, force)
    near(vehicle.robot_wrench(np.r_[force, 0, 0, 0], rotation), np.r_[force, torque])
    wanted = np.r_[rotation.T @ (vehicle.mass * GRAVITY - force), -torque]
    speeds = speeds_for(vehicle, wanted)
    for k in range(STEPS):
        found = block.step(
            rotation=rotation,
            angular_velocity=np.zeros(3),
            specific_force=rotation.T @ GRAVITY,
            rotor_speeds=speeds,
            dt=dt,
        )
        part = -np.expm1(-gain * k * dt)
        near(vehicle.tool_wrench(found, rotation), np.r_[part * force, 0, 0, 0])


@given(vehicles(), rotations(), numbers(-5, 5, 3), torques, gains, st.floats(0.5e-3, 4e-3))
def test_torque_on_a_tumbling_body_is_recovered_to_second_order(
    vehicle, rotation, omega, torque, torque_gain, dt
):
    """No closed form here: Euler's equations by SciPy, and an error that the period squared bounds."""
    inertia = vehicle.inertia
    torque = torque * 0.02
    inverse = np.linalg.inv(inertia)

    def euler(_, state):
        w = state[:3]
        wd = inverse @ (torque - np.cross(w, inertia @ w))
        return np.r_[wd, (state[3:].reshape(3, 3) @ tilthex.so3.hat(w)).ravel()]

    times = dt * np.arange(STEPS)
    way = solve_ivp(
        euler,
        (0, times[-1]),
        np.r_[omega, rotation.ravel()],
        method="DOP853",
        t_eval=times,
        rtol=1e-12,
        atol=1e-13,
    )
    block = observer(vehicle, 30, torque_gain)
    fastest = np.linalg.norm(way.y[:3], axis=0).max()
    wildest = max(np.linalg.norm(euler(0, state)[:3]) for state in way.y.T)
    for k, state in enumerate(way.y.T):
        found = block.step(
            rotation=tilthex.so3.project(state[3:].reshape(3, 3)),
            angular_velocity=state[:3],
            specific_force=np.zeros(3),
            rotor_speeds=np.zeros(6),
            dt=dt,
        )
        expected = torque * -np.expm1(-torque_gain * k * dt)
        # Over one period the body turns about an axis that itself turns.
        bound = np.linalg.norm(torque) * dt**2 * (fastest**2 + wildest)
        assert np.linalg.norm(found[3:] - expected) <= bound + TOLERANCE


@given(vehicles(), gains, gains, st.integers(0, 2**32), st.floats(-np.pi, np.pi))
def test_turning_the_world_turns_the_force_and_leaves_the_torque(vehicle, force_gain, torque_gain, seed, yaw):
    rng = np.random.default_rng(seed)
    turn = Rotation.from_euler("z", yaw).as_matrix()
    plain, turned = (observer(vehicle, force_gain, torque_gain) for _ in range(2))
    for _ in range(STEPS):
        rotation = Rotation.random(rng=rng).as_matrix()
        sample = {
            "angular_velocity": rng.normal(size=3),
            "specific_force": rng.normal(size=3),
            "rotor_speeds": rng.normal(size=6),
            "dt": rng.uniform(0.5e-3, 10e-3),
        }
        a = plain.step(rotation=rotation, **sample)
        b = turned.step(rotation=turn @ rotation, **sample)
        near(b[:3], turn @ a[:3])
        near(b[3:], a[3:])
