"""Blocks of your own: the chain in Python flies as the compiled controller, and takes any of them."""

import numpy as np
import pytest
import tilthex
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import forces, numbers, rotations, torques
from tilthex import chain

VEHICLE = tilthex.Vehicle.preset("tilt-hex")
PLAIN = {"low_pass_hz": 0.0, "force_dead_zone": 0.0, "torque_dead_zone": 0.0}
CONFIG = tilthex.Config.default(VEHICLE).replace(admittance=PLAIN)
HOME = tilthex.Setpoint([0.0, 0.0, 1.0], np.eye(3))
DT = 0.002


def flown(controller, seconds, push=0.0):
    """Positions of the tool, m, (N, 3), under a push along x from 0.2 s on."""
    plant = tilthex.Plant(VEHICLE, HOME.position - VEHICLE.tool_position)
    rows = []
    for k in range(round(seconds / DT)):
        out = controller.step(
            **plant.measured,
            setpoint=HOME,
            dt=DT,
        )
        plant.step(out.rotor_speeds, tool_wrench=[push if k > 100 else 0.0, 0, 0, 0, 0, 0], dt=DT)
        rows.append(plant.tool_position)
    return np.array(rows)


@settings(max_examples=20)
@given(goal=rotations(0.1), rates=numbers(-0.3, 0.3, 12))
def test_the_reference_of_the_body_is_that_of_the_controller(goal, rates):
    setpoint = tilthex.Setpoint([0.2, 0, 1], goal, *rates.reshape(4, 3))
    at = VEHICLE.robot_reference(setpoint)
    out = tilthex.Controller(VEHICLE, CONFIG).step(
        position=at.position,
        velocity=at.velocity,
        rotation=at.rotation,
        angular_velocity=at.angular_velocity,
        specific_force=at.rotation.T @ [0, 0, tilthex.GRAVITY],
        rotor_speeds=VEHICLE.hover_speeds(at.rotation),
        setpoint=setpoint,
    )
    found = VEHICLE.robot_reference(out.reference)
    for name in ("position", "rotation", "velocity", "angular_velocity", "acceleration"):
        assert np.allclose(getattr(found, name), getattr(out.robot_reference, name), atol=1e-9), name


@settings(max_examples=3)
@given(push=st.floats(-1.5, 1.5))
def test_the_chain_flies_as_the_controller_does(push):
    own, theirs = chain.Chain(VEHICLE, CONFIG), tilthex.Controller(VEHICLE, CONFIG)
    assert abs(flown(own, 1.0, push) - flown(theirs, 1.0, push)).max() < 1e-3


class Stiff:
    """An admittance that never yields."""

    def step(self, setpoint, wrench, dt):
        return setpoint


class Blind:
    """An observer that feels nothing."""

    def step(self, *, rotation, angular_velocity, specific_force, rotor_speeds, dt):
        return np.zeros(6)


class Turned:
    """Pose control with gains of its own."""

    def step(self, *, position, velocity, rotation, angular_velocity, reference):
        pull = 9 * (reference.position - position) - 6 * np.asarray(velocity)
        turn = tilthex.so3.vee(rotation.T @ reference.rotation - reference.rotation.T @ rotation)
        return tilthex.PoseCommand(pull, 20 * turn - 10 * np.asarray(angular_velocity))


class Least:
    """The allocation of least squares."""

    def allocate(self, wrench, rotor_speeds, *, rotation):
        inputs = np.linalg.pinv(VEHICLE.allocation) @ wrench
        return tilthex.Allocation(inputs, VEHICLE.allocation @ inputs)


@pytest.mark.parametrize(
    ("blocks", "low", "high"),
    [
        ({}, 0.005, 0.3),
        ({"admittance": Stiff()}, -0.005, 0.005),
        ({"admittance": Stiff(), "allocator": Least()}, -0.005, 0.005),
        ({"admittance": Stiff(), "pose": Turned()}, -0.02, 0.02),
        # What nobody observes nobody compensates: the pose controller alone holds the push.
        ({"observer": Blind()}, 0.005, 0.1),
    ],
    ids=["none", "admittance", "allocator", "pose", "observer"],
)
def test_each_block_can_be_replaced(blocks, low, high):
    way = flown(chain.Chain(VEHICLE, CONFIG, **blocks), 1.5, push=1.0)
    assert low < way[-1, 0] < high and abs(way[:, 1:] - HOME.position[1:]).max() < 0.05


@settings(max_examples=10)
@given(force=forces, torque=torques)
def test_a_block_gets_the_wrench_at_the_tool(force, torque):
    seen = []

    class Told(Stiff):
        def step(self, setpoint, wrench, dt):
            seen.append(wrench)
            return setpoint

    class Says(Blind):
        def step(self, **sample):
            return np.concatenate([force, torque])

    flown(chain.Chain(VEHICLE, CONFIG, observer=Says(), admittance=Told()), DT)
    assert np.allclose(seen[0], VEHICLE.tool_wrench(np.concatenate([force, torque]), np.eye(3)))


@pytest.mark.parametrize("place", ["observer", "admittance", "pose", "allocator"])
def test_what_is_no_block_is_refused(place):
    method = "allocate" if place == "allocator" else "step"
    with pytest.raises(TypeError, match=f"^{place} is a str without a method `{method}`; expected a block$"):
        chain.Chain(VEHICLE, CONFIG, **{place: "mine"})


def test_an_own_controller_flies_an_experiment():
    pytest.importorskip("mujoco")
    from tilthex.experiments import flight, spec

    waypoint = [{"phase": "hover", "position": [0.0, 0.0, 1.0], "hold": 0.5}]
    run = spec.load("chirp", changes={"trajectory": {"waypoint": waypoint}}).runs[0]
    config = tilthex.Config.default(run.model()).replace(**run.config)
    record = flight.fly(run, controller=chain.Chain(run.model(), config))
    assert record.complete and abs(record.position_error).max() < 0.01
    assert abs(record.tool_position[-1] - [0, 0, 1]).max() < 0.01

    class Silent:
        def step(self, **state):
            return None

    with pytest.raises(
        TypeError, match=r"^the controller's step returned a NoneType; expected a tilthex.Output$"
    ):
        flight.fly(run, controller=Silent())
