"""The controller and its blocks: invariance, convergence, closed forms, round trips."""

from __future__ import annotations

import numpy as np
import pytest
import tilthex
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from strategies import forces, numbers, periods, rotations, torques, vehicles

TILT_HEX = tilthex.Vehicle.preset("tilt-hex")


def random_step(rng, vehicle):
    """Arguments of a tick that are any numbers, in the frames' order."""
    return {
        "position": rng.normal(size=3),
        "velocity": rng.normal(size=3),
        "rotation": Rotation.random(rng=rng).as_matrix(),
        "angular_velocity": rng.normal(size=3),
        "specific_force": rng.normal(size=3, scale=10),
        "rotor_speeds": rng.uniform(20, 100, vehicle.rotor_count),
        "dt": rng.uniform(1e-3, 4e-3),
    }


def random_setpoint(rng):
    values = [rng.normal(size=3) for _ in range(5)]
    return {
        "position": values[0],
        "rotation": Rotation.random(rng=rng).as_matrix(),
        "velocity": values[1],
        "angular_velocity": values[2],
        "acceleration": values[3],
        "angular_acceleration": values[4],
        "wrench": rng.normal(size=6),
    }


def turned(vectors, turn):
    """World vectors turned with the world; rotations likewise; wrenches by halves."""

    def one(value):
        value = np.asarray(value)
        if value.shape == (6,):
            return np.r_[turn @ value[:3], turn @ value[3:]]
        return turn @ value

    return {key: one(value) for key, value in vectors.items()}


@given(vehicles(), st.integers(0, 2**32), st.floats(-np.pi, np.pi))
def test_turning_the_world_turns_every_output(vehicle, seed, yaw):
    rng = np.random.default_rng(seed)
    turn = Rotation.from_euler("z", yaw).as_matrix()
    config = tilthex.Config.default(vehicle)
    plain, other = tilthex.Controller(vehicle, config), tilthex.Controller(vehicle, config)
    for _ in range(20):
        step, setpoint = random_step(rng, vehicle), random_setpoint(rng)
        world = {key: step[key] for key in ("position", "velocity", "rotation")}
        a = plain.step(**step, setpoint=tilthex.Setpoint(**setpoint))
        b = other.step(**(step | turned(world, turn)), setpoint=tilthex.Setpoint(**turned(setpoint, turn)))

        def near(found, expected):
            scale = max(1.0, abs(expected).max())
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * scale)

        near(b.rotor_speeds * abs(b.rotor_speeds), a.rotor_speeds * abs(a.rotor_speeds))
        near(b.wrench_robot, np.r_[turn @ a.wrench_robot[:3], a.wrench_robot[3:]])
        for name in ("wrench_tool", "wrench_admittance"):
            near(getattr(b, name), turned({"w": getattr(a, name)}, turn)["w"])
        for name in ("position", "rotation", "velocity", "angular_velocity", "acceleration"):
            near(getattr(b.reference, name), turn @ getattr(a.reference, name))
        for name in ("position", "rotation", "velocity", "acceleration"):
            near(getattr(b.robot_reference, name), turn @ getattr(a.robot_reference, name))
        near(b.robot_reference.angular_velocity, a.robot_reference.angular_velocity)
        near(b.position_error, turn @ a.position_error)
        near(b.velocity_error, turn @ a.velocity_error)
        for name in ("rotation_error", "angular_velocity_error", "wanted_wrench", "allocated_wrench"):
            near(getattr(b, name), getattr(a, name))
        assert a.saturated == b.saturated


@settings(max_examples=15)
@given(
    vehicles(rotor_time_constant=0.0),
    rotations(max_angle=np.radians(89)),
    rotations(),
    numbers(-1, 1, 3),
    numbers(-0.5, 0.5, 3),
)
def test_any_attitude_error_below_90_degrees_dies_out_exponentially(vehicle, error, hold, position, velocity):
    """Exact state, exact model: by at least exp(-6 t), against poles at 10 and 15 1/s.

    Where the attitude yields to a distance, it turns about the tool: the centre of mass follows with a double
    pole at w = `sqrt(g / |r|) / 2`, which may be slower. (1 + w t) exp(-w t) stays below 2.2 exp(-0.8 w t).
    """
    pole = 0.5 * np.sqrt(9.81 / max(0.02, float(np.linalg.norm(vehicle.tool_position))))
    rate = min(6.0, 0.8 * pole)
    config = tilthex.Config.default(vehicle)
    controller = tilthex.Controller(vehicle, config)
    tool = hold @ vehicle.tool_rotation
    setpoint = tilthex.Setpoint(hold @ vehicle.tool_position, tool)
    plant = tilthex.Plant(vehicle)
    plant.set_state(position=position, velocity=velocity, rotation=hold @ error)

    def distance():
        angle = np.linalg.norm(tilthex.so3.log(hold.T @ plant.rotation))
        return np.linalg.norm(plant.position) + angle + 0.1 * np.linalg.norm(plant.angular_velocity)

    start = distance() + np.linalg.norm(velocity)
    for k in range(1250):
        out = controller.step(
            **plant.measured,
            setpoint=setpoint,
            compliant=False,
        )
        plant.step(out.rotor_speeds, dt=0.002)
        bound = 4.0 * start * np.exp(-rate * max(0.0, 0.002 * k - 0.3))
        assert distance() <= max(bound, 1e-6)


def spring(matrices) -> tilthex.AdmittanceFilter:
    changes = dict(zip(("mass", "damping", "stiffness"), matrices, strict=True))
    changes |= {"max_translation": 100.0, "max_rotation_deg": 170.0}
    return tilthex.AdmittanceFilter(tilthex.Config.default(TILT_HEX).replace(admittance=changes))


@st.composite
def couplings(draw, low: float, high: float) -> np.ndarray:
    """Positive definite 3x3 matrices with eigenvalues in a range, along any axes."""
    axes = draw(rotations())
    return axes @ np.diag(draw(numbers(low, high, 3))) @ axes.T


def block(translation: np.ndarray, rotation: float) -> list:
    m = np.zeros((6, 6))
    m[:3, :3] = 0.5 * (translation + translation.T)
    m[3:, 3:] = rotation * np.eye(3)
    return m.tolist()


# A light, coupled mass behind strong damping: all of its speed is the fastest mode.
COUPLED = np.array([[0.58658909, 0, 0.18920062], [0, 1, 0], [0.18920062, 0, 0.91341091]])


@given(
    couplings(0.5, 4), couplings(2, 20), couplings(0, 15), forces, st.lists(periods, min_size=5, max_size=80)
)
@example(COUPLED, np.diag([10.0, 2, 20]), np.zeros((3, 3)), np.array([-18.0, 0, 12]), [1 / 128] * 5)
def test_translation_is_the_closed_form_mass_spring_damper(mass, damping, stiffness, force, dts):
    """Coupled axes, changing periods: within 1e-6 m of the matrix exponential."""
    block_filter = spring((block(mass, 0.1), block(damping, 1.0), block(stiffness, 1.0)))
    home = tilthex.Setpoint([0.3, -0.2, 1.0], np.eye(3))
    inverse = np.linalg.inv(mass)
    system = np.zeros((7, 7))
    system[:3, 3:6] = np.eye(3)
    system[3:6, :3], system[3:6, 3:6] = -inverse @ stiffness, -inverse @ damping
    system[3:6, 6] = inverse @ force
    start = np.r_[np.zeros(6), 1.0]
    for k, dt in enumerate(dts):
        found = block_filter.step(home, np.r_[force, 0, 0, 0], dt)
        exact = expm(system * sum(dts[: k + 1])) @ start
        np.testing.assert_allclose(found.position - home.position, exact[:3], rtol=0, atol=1e-6)
        np.testing.assert_allclose(found.velocity, exact[3:6], rtol=0, atol=1e-5)


@given(st.floats(0.01, 0.1), st.floats(0.5, 4), st.floats(0, 10), rotations(), torques)
def test_rotation_about_one_axis_is_the_mass_spring_damper_in_the_sine(
    mass, damping, stiffness, rotation, torque
):
    """(28) takes the rotation's sine; SciPy integrates that to 1e-10."""
    block_filter = spring(tuple(block(np.eye(3), x) for x in (mass, damping, stiffness)))
    torque = torque * 0.2
    home = tilthex.Setpoint(np.zeros(3), rotation)
    size = np.linalg.norm(torque)

    def equation(_, y):
        return [y[1], (size - damping * y[1] - stiffness * np.sin(y[0])) / mass]

    times = 0.002 * np.arange(1, 101)
    way = solve_ivp(equation, (0, times[-1]), [0, 0], t_eval=times, method="DOP853", rtol=1e-11, atol=1e-12)
    for angle in way.y[0]:
        if angle > 2.5:
            break
        found = block_filter.step(home, np.r_[0, 0, 0, torque])
        turn = tilthex.so3.log(found.rotation @ rotation.T)
        expected = angle * torque / size if size else np.zeros(3)
        np.testing.assert_allclose(turn, expected, rtol=0, atol=1e-6)


@given(rotations(1.4), numbers(-1, 1, 3), numbers(-1, 1, 3), rotations(1.4))
def test_a_filter_that_is_switched_on_does_not_jump(rotation, position, velocity, home_rotation):
    block_filter = spring(([1.5] * 6, [10.0] * 6, [6.0] * 6))
    reference = tilthex.Setpoint(position, rotation, velocity=velocity)
    home = tilthex.Setpoint(np.zeros(3), home_rotation)
    block_filter.reset(reference, home)
    found = block_filter.step(home, np.zeros(6), 1e-9)
    np.testing.assert_allclose(found.position, position, atol=1e-7)
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-7)
    np.testing.assert_allclose(found.velocity, velocity, atol=1e-6)


@given(vehicles(), forces, torques)
def test_allocation_round_trip(vehicle, force, torque):
    wrench = np.r_[force, torque]
    found = tilthex.Allocator(vehicle).allocate(wrench)
    assert not found.saturated
    assert found.given_up is None
    w = found.rotor_speeds
    np.testing.assert_allclose(vehicle.allocation @ (w * abs(w)), wrench, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        found.inputs, np.linalg.solve(vehicle.allocation, wrench), rtol=1e-6, atol=1e-6
    )


@given(forces.map(lambda f: 10 * f), torques.map(lambda t: 10 * t))
def test_commanded_speeds_stay_within_the_limits(force, torque):
    found = tilthex.Allocator(TILT_HEX).allocate(np.r_[force, torque])
    low, high = TILT_HEX.rotor_speed_limits.T
    assert (found.rotor_speeds >= low - 1e-9).all()
    assert (found.rotor_speeds <= high + 1e-9).all()
    produced = TILT_HEX.allocation @ found.inputs
    np.testing.assert_allclose(found.wrench, produced, atol=1e-8)
    missed = np.linalg.norm(produced - np.r_[force, torque])
    assert found.saturated or missed < 1e-6


@given(
    rotations(max_angle=1.5), numbers(-2, 2, 3), numbers(-1, 1, 3), numbers(-3, 3, 3), st.integers(0, 2**32)
)
def test_pose_control_against_numpy(rotation, position, velocity, omega, seed):
    rng = np.random.default_rng(seed)
    p, v, a, w, alpha = rng.normal(size=(5, 3))
    r = Rotation.random(rng=rng).as_matrix()
    reference = tilthex.Reference(p, r, v, w, a, alpha)
    found = tilthex.PoseController(tilthex.Config.default(TILT_HEX)).step(
        position=position, velocity=velocity, rotation=rotation, angular_velocity=omega, reference=reference
    )
    skew = r.T @ rotation - rotation.T @ r
    e_r = 0.5 * np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    carried = rotation.T @ r @ w
    e_w = omega - carried
    np.testing.assert_allclose(found.rotation_error, e_r, atol=1e-12)
    np.testing.assert_allclose(found.angular_velocity_error, e_w, atol=1e-12)
    np.testing.assert_allclose(found.acceleration, a + 20 * (v - velocity) + 100 * (p - position), atol=1e-10)
    expected = rotation.T @ r @ alpha - np.cross(omega, carried) - 30 * e_w - 225 * e_r
    np.testing.assert_allclose(found.angular_acceleration, expected, atol=1e-10)


def test_the_bias_of_a_hover_is_learnt_and_removed():
    """A vehicle heavier than its model says: the wrench that this looks like is no contact."""
    heavier = tilthex.Vehicle.from_dict({"preset": "tilt-hex", "mass": 2.5})
    controller = tilthex.Controller(TILT_HEX, tilthex.Config.default(TILT_HEX))
    plant = tilthex.Plant(heavier)
    setpoint = tilthex.Setpoint(plant.tool_position, np.eye(3))
    for k in range(3000):
        out = controller.step(
            **plant.measured,
            setpoint=setpoint,
            compliant=k >= 2000,
            learn_bias=1000 <= k < 2000,
        )
        plant.step(out.rotor_speeds, dt=0.002)
    assert out.wrench_robot[2] == pytest.approx(-0.1 * tilthex.GRAVITY, abs=1e-3)
    assert controller.bias[2] == pytest.approx(-0.1 * tilthex.GRAVITY, abs=1e-3)
    np.testing.assert_allclose(out.wrench_tool, 0, atol=1e-3)
    np.testing.assert_allclose(plant.position, 0, atol=1e-3)


@given(turn=st.tuples(*[st.floats(-1.0, 1.0)] * 3), force=st.floats(0.5, 6.0), depth=st.floats(-0.02, 0.2))
@settings(max_examples=20, deadline=None)
def test_force_axes_press_with_the_commanded_force(
    turn: tuple[float, float, float], force: float, depth: float
) -> None:
    """Along the normal of a surface the filter balances the wall's force, however deep the set-point lies."""
    surface = tilthex.so3.exp(np.array(turn))
    normal = surface[:, 2]
    soft = {"damping": [60.0, 60.0, 60.0, 4.0, 4.0, 4.0]}
    config = tilthex.Config.default(TILT_HEX).replace(admittance=soft)
    admittance = tilthex.AdmittanceFilter(config)
    setpoint = tilthex.Setpoint(
        -depth * normal,
        np.eye(3),
        wrench=np.r_[-force * normal, 0.0, 0.0, 0.0],
        force_axes=["z"],
        surface=surface,
    )
    assert setpoint.force_axes == ["z"]
    np.testing.assert_allclose(setpoint.surface, surface)
    pressed = 0.0
    for _ in range(6000):
        felt = np.r_[pressed * normal, 0.0, 0.0, 0.0]
        reference = admittance.step(setpoint, felt + setpoint.wrench)
        pressed = max(0.0, -300.0 * float(normal @ reference.position))
    assert abs(pressed - force) < 1e-3 * force


def test_an_unknown_force_axis_is_named() -> None:
    with pytest.raises(ValueError, match=r'force_axes: found "w", expected any of x, y, z, rx, ry, rz'):
        tilthex.Setpoint(np.zeros(3), np.eye(3), force_axes=["w"])
