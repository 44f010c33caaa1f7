"""Every compiled class is explained, shown, copied and pickled; every wrong argument is named."""

import ast
import copy
import importlib.util
import inspect
import multiprocessing
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
import tilthex
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import forces, numbers, rotations
from tilthex import _core

VEHICLE = tilthex.Vehicle.preset("tilt-hex")
CONFIG = tilthex.Config.default(VEHICLE)
EYE, ZERO, HOME = np.eye(3), np.zeros(3), np.array([0.0, 0.0, 1.0])
SPEEDS = VEHICLE.hover_speeds()
SETPOINT = tilthex.Setpoint(
    HOME, EYE, velocity=[0.1, 0, 0], wrench=np.arange(6), force_axes=["z"], surface=EYE
)
REFERENCE = tilthex.Reference(HOME, EYE, acceleration=[0, 0, 0.3])
TRUTH = tilthex.Truth(VEHICLE, "outdoors")
STATE = {"position": HOME, "velocity": ZERO, "rotation": EYE, "angular_velocity": ZERO}
FORCE = np.array([0.0, 0.0, tilthex.GRAVITY])
SAMPLE = {"rotation": EYE, "angular_velocity": ZERO, "specific_force": FORCE, "rotor_speeds": SPEEDS}


def run_of_filter():
    times, poses = 0.002 * np.arange(1, 20), np.array([0.001, 0.01])
    filter = tilthex.Ukf(CONFIG)
    return filter.run(
        times, np.zeros((19, 3)), np.tile(FORCE, (19, 1)), poses, np.tile(HOME, (2, 1)), [EYE, EYE]
    )


def flown(steps=3):
    loop = tilthex.Loop(CONFIG)
    loop.initialize(0.0, HOME, EYE)
    for k in range(1, steps + 1):
        loop.step_from(0.002 * k, specific_force=FORCE, rotor_speeds=SPEEDS, setpoint=SETPOINT, **STATE)
    return loop


VALUES = {
    "Allocation": lambda: tilthex.Allocator(VEHICLE).allocate([9, 0, 500.0, 0, 1, 0]),
    "Allocator": lambda: tilthex.Allocator(VEHICLE, CONFIG),
    "Config": lambda: CONFIG,
    "Drawn": lambda: TRUTH.draw(3),
    "LoopModel": lambda: tilthex.LoopModel(CONFIG, truth="cad", seed=2, loop_delay=0.004),
    "Output": lambda: tilthex.Controller(VEHICLE, CONFIG).step(setpoint=SETPOINT, **STATE | SAMPLE),
    "PoseCommand": lambda: tilthex.PoseController(CONFIG).step(reference=REFERENCE, **STATE),
    "PoseController": lambda: tilthex.PoseController(CONFIG),
    "Reference": lambda: REFERENCE,
    "Setpoint": lambda: SETPOINT,
    "Trajectory": lambda: tilthex.Trajectory(
        [{"position": ZERO, "hold": 1}, {"position": HOME, "force_axes": ["x"], "surface": EYE}], velocity=0.2
    ),
    "Truth": lambda: TRUTH,
    "UkfRun": run_of_filter,
    "Vehicle": lambda: VEHICLE,
}
"""How each class that is a value is made. What is made twice is equal."""

BLOCKS = {
    "AdmittanceFilter": (
        lambda: tilthex.AdmittanceFilter(CONFIG),
        lambda one, rng: one.step(SETPOINT, rng.normal(size=6)),
    ),
    "Controller": (
        lambda: tilthex.Controller(VEHICLE, CONFIG),
        lambda one, rng: one.step(setpoint=SETPOINT, **STATE | SAMPLE | {"velocity": rng.normal(size=3)}),
    ),
    "Effects": (
        lambda: TRUTH.draw(1).effects(),
        lambda one, rng: one.step(HOME, rng.normal(size=3), EYE, ZERO, SPEEDS, 0 * SPEEDS, 0.01),
    ),
    "Loop": (
        flown,
        lambda one, rng: one.step_from(
            0.002 * len(one.record()["saturated"]) + 0.002,
            specific_force=FORCE + 0.1 * rng.normal(size=3),
            rotor_speeds=SPEEDS,
            setpoint=SETPOINT,
            **STATE,
        ),
    ),
    "Plant": (
        lambda: tilthex.Plant(VEHICLE, HOME, effects=TRUTH.draw(1).effects()),
        lambda one, rng: (one.step(SPEEDS, wrench=rng.normal(size=6)), one.position, one.specific_force)[1:],
    ),
    "SensorErrors": (
        lambda: TRUTH.draw(1).sensor_errors(),
        lambda one, rng: (
            one.step(SPEEDS + rng.normal(size=6), 0.002),
            one.imu(rng.normal(size=3), FORCE),
            one.rotor_speeds(),
        )[1:],
    ),
    "Ukf": (
        lambda: begun(tilthex.Ukf(CONFIG)),
        lambda one, rng: (
            one.predict(one.time + 0.002, 0.01 * rng.normal(size=3), FORCE),
            one.update_pose(one.time - 0.001, HOME + 1e-4 * rng.normal(size=3), EYE),
            one.position,
            one.covariance,
        )[1:],
    ),
    "VehicleLink": (
        lambda: tilthex.VehicleLink(CONFIG),
        lambda one, rng: (
            one.receive(rng.uniform(0.1, 0.2), b"^?flymu1.4$" + rng.bytes(9)),
            one.command(rng.uniform(0.2, 5.0), SPEEDS + rng.normal(size=6), start=True),
        )[1:],
    ),
    "WrenchObserver": (
        lambda: tilthex.WrenchObserver(VEHICLE, CONFIG),
        lambda one, rng: one.step(**SAMPLE | {"angular_velocity": rng.normal(size=3)}),
    ),
}
"""How each class with a state is made, and a step of it under random inputs, with what it gives."""


def begun(filter):
    filter.initialize(0.0, HOME, EYE)
    return filter


CONNECTIONS = {"PoseClient"}
"""Classes that are neither; tests of their own have them."""

CLASSES = sorted({name for name in _core.__all__ if inspect.isclass(getattr(_core, name))} - CONNECTIONS)


def same(a, b):
    """Equal to the last bit; a NaN is equal to a NaN."""
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(same, a, b))
    return np.array_equal(a, b, equal_nan=True) if isinstance(a, np.ndarray) else a == b


def test_every_class_is_a_value_or_a_block():
    assert sorted(VALUES | BLOCKS) == CLASSES
    assert not VALUES.keys() & BLOCKS.keys()


@pytest.mark.parametrize("name", CLASSES)
def test_every_class_is_explained_and_shown(name):
    kind = getattr(_core, name)
    one = VALUES[name]() if name in VALUES else BLOCKS[name][0]()
    assert len(inspect.getdoc(kind)) > 20
    for member, found in inspect.getmembers(kind):
        if not member.startswith("_") and not isinstance(found, int | float | str | list):
            assert len(inspect.getdoc(found) or "") > 4, f"{name}.{member} has no docstring"
            assert not callable(found) or inspect.signature(found)
    if kind.__new__ is not object.__new__ and "__new__" in vars(kind):
        assert inspect.signature(kind).parameters, f"{name} has no signature"
    assert repr(one).startswith(f"{name}(") and " object at " not in repr(one)
    assert kind.__module__ == "tilthex" and getattr(tilthex, name) is kind


@pytest.mark.parametrize("name", VALUES)
def test_a_value_equals_its_copies(name):
    one, again = VALUES[name](), VALUES[name]()
    assert one == again and one != 0
    for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1):
        assert pickle.loads(pickle.dumps(one, protocol)) == one
    for other in (copy.copy(one), copy.deepcopy(one)):
        assert type(other) is type(one) and other == one and repr(other) == repr(one)
    if type(one).__hash__ is not None:
        assert len({one, again, copy.copy(one)}) == 1


@pytest.mark.parametrize("name", ["Allocation", "Output", "PoseCommand", "Reference", "Setpoint"])
def test_what_a_value_shows_makes_it(name):
    one = VALUES[name]()
    assert eval(repr(one), {name: getattr(tilthex, name) for name in CLASSES}) == one


@settings(max_examples=20)
@given(position=forces, turn=rotations(), force=numbers(-3, 3, 6), time=st.floats(-1, 20))
def test_random_values_keep_every_bit(position, turn, force, time):
    setpoint = tilthex.Setpoint(position, turn, velocity=force[:3], wrench=force)
    waypoints = [{"position": ZERO}, {"position": position, "rotation": turn, "wrench": force, "hold": 0.5}]
    way = tilthex.Trajectory(waypoints, velocity=0.3)
    for one in (setpoint, tilthex.Reference(position, turn), way, way.sample(time)):
        other = pickle.loads(pickle.dumps(one))
        assert other == one and hash(other) == hash(one)
    assert pickle.loads(pickle.dumps(way)).sample(time) == way.sample(time)
    assert setpoint != tilthex.Setpoint(position, turn, velocity=force[:3], wrench=force + 1e-9)
    assert way != tilthex.Trajectory([waypoints[0], waypoints[1] | {"hold": 0.6}], velocity=0.3)


@pytest.mark.parametrize(
    "truth", [*tilthex.Truth.levels(), {"level": "cad", "error": {"mass": {"normal": 0.01}}}]
)
def test_a_truth_draws_the_same_vehicles_after_its_journey(truth):
    try:
        one = tilthex.Truth(VEHICLE, truth)
    except ValueError:
        one = tilthex.Truth(VEHICLE, {"level": "cad"})
    other = pickle.loads(pickle.dumps(one))
    assert other == one and other.name == one.name
    assert all(other.draw(seed) == one.draw(seed) for seed in range(3))
    assert one.draw(0) != one.draw(1)


@pytest.mark.parametrize("name", BLOCKS)
@settings(max_examples=5)
@given(seed=st.integers(0, 2**32 - 1), before=st.integers(0, 6))
def test_a_copied_block_goes_on_to_the_last_bit(name, seed, before):
    make, step = BLOCKS[name]
    one, rng = make(), np.random.default_rng(seed)
    for _ in range(before):
        step(one, rng)
    for way in (copy.copy, copy.deepcopy):
        other, inputs = way(one), rng.spawn(1)[0]
        same_inputs = copy.deepcopy(inputs)
        for _ in range(3):
            assert same(step(one, inputs), step(other, same_inputs))


@pytest.mark.parametrize("name", BLOCKS)
def test_a_block_says_why_it_is_not_pickled(name):
    sentence = (
        rf"^{name} has a state that cannot be pickled; copy it with copy.copy, or pickle .* and make a new"
    )
    with pytest.raises(TypeError, match=sentence):
        pickle.dumps(BLOCKS[name][0]())


def test_another_process_gets_equal_values():
    values = [make() for make in VALUES.values()]
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.map(copy.copy, values) == values


GOOD = (
    STATE
    | {
        "a": ZERO,
        "v": ZERO,
        "m": EYE,
        "r": EYE,
        "time": 0.01,
        "imu_time": 0.002 * np.arange(3),
        "gyro": ZERO,
        "specific_force": FORCE,
        "vehicle": VEHICLE,
        "config": CONFIG,
        "setpoint": SETPOINT,
        "reference": REFERENCE,
        "robot_reference": REFERENCE,
        "wrench": np.zeros(6),
        "rotor_speeds": SPEEDS,
        "rotor_command": SPEEDS,
        "rotor_accelerations": SPEEDS,
        "inputs": SPEEDS,
        "pose_time": np.array([0.001]),
        "poses": [],
        "dt": 0.002,
        "data": b"",
        "waypoints": [{"position": ZERO}],
        "axis": 0,
        "stiffness": 100.0,
        "seed": 1,
        "outcome": [],
    }
    | {
        name: np.zeros(count)
        for count, names in {
            3: "position_error velocity_error rotation_error angular_velocity_error acceleration "
            "angular_acceleration gyro_bias accelerometer_bias",
            6: "wrench_robot wrench_tool wrench_admittance wanted_wrench allocated_wrench",
        }.items()
        for name in names.split()
    }
)
"""A good value for each name of an argument."""

OF_FUNCTION = {
    "Output": {"reference": SETPOINT},
    "Trajectory": dict.fromkeys(
        ("velocity", "acceleration", "angular_velocity", "angular_acceleration"), 1.0
    ),
    "LoopModel.contact-damping_time": {"along": [0, 0, 1]},
    "question_units": {"gyro": np.zeros((3, 3)), "specific_force": np.tile(FORCE, (3, 1))},
    "question_poses": {"gyro": np.zeros((3, 3)), "position": [HOME], "rotation": [EYE]},
    "Ukf.run": {
        "gyro": np.zeros((3, 3)),
        "specific_force": np.tile(FORCE, (3, 1)),
        "position": [HOME],
        "rotation": [EYE],
    },
    "UkfRun": dict.fromkeys(("position", "velocity", "gyro_bias", "accelerometer_bias"), np.zeros((2, 3)))
    | {
        "rotation": [EYE, EYE],
        "innovation": np.zeros((0, 6)),
        "innovation_deviation": np.zeros((0, 6)),
        "nis": [],
    },
}
"""Good values where those differ: of functions with a row for every sample or pose, for example."""

UNITS = r"m|m/s|m/s\^2|rad|rad/s|rad/s\^2|N and N m|Hz|Hz/s|Hz\^2|s"
PLAIN = {"a", "v", "m", "r", "rotation", "surface", "along", "about", "covariance", "innovation", "nis"}
PLAIN |= {"innovation_deviation", "rotation_error"}
"""Arguments that have no unit, or several."""


def functions():
    """Each function of the stub: its name, itself as a call by names, and its arguments with their types."""
    stub = ast.parse(
        Path(importlib.util.find_spec("tilthex").submodule_search_locations[0], "_core.pyi").read_text()
    )
    for node in stub.body:
        if isinstance(node, ast.ClassDef) and node.name in CONNECTIONS:
            continue
        members = node.body if isinstance(node, ast.ClassDef) else [node]
        for member in members:
            if not isinstance(member, ast.FunctionDef) or member.name in ("simulate", "simulate_many"):
                continue
            arguments = [a for a in member.args.args + member.args.kwonlyargs if a.arg not in ("self", "cls")]
            types = {a.arg: ast.unparse(a.annotation) for a in arguments if a.annotation}
            setter = any(ast.unparse(d).endswith(".setter") for d in member.decorator_list)
            if isinstance(node, ast.ClassDef):
                yield (
                    f"{node.name}.{member.name}".replace(".__new__", ""),
                    caller(node.name, member.name, setter),
                    types,
                )
            else:
                yield member.name, getattr(_core, member.name), types


def caller(owner, name, setter):
    kind = getattr(_core, owner)
    if name == "__new__":
        return kind
    if setter:
        return lambda **value: setattr(BLOCKS[owner][0](), name, *value.values())
    make = VALUES[owner] if owner in VALUES else BLOCKS[owner][0]
    return lambda **given: getattr(make(), name)(**given)


def cases(wanted):
    for name, function, types in functions():
        for argument, kind in types.items():
            if kind.removesuffix(" | None") == wanted and not argument.startswith(("other", "__")):
                given = GOOD | OF_FUNCTION.get(name, {})
                good = {
                    a: given[a] for a, k in types.items() if a in given and (a == argument or "None" not in k)
                }
                good |= OF_FUNCTION.get(f"{name}-{argument}", {})
                label = "bias" if name == "Controller.bias" else argument
                yield pytest.param(function, good, argument, label, id=f"{name}-{argument}")


@pytest.mark.parametrize(("function", "good", "argument", "label"), [*cases("ArrayLike")])
def test_an_array_of_a_wrong_shape_is_named_with_its_unit(function, good, argument, label):
    unit = "" if label in PLAIN else f", ({UNITS})"
    sentence = rf"^{label} has shape \(97, 5\); expected \(.+\){unit}$"
    with pytest.raises(ValueError, match=sentence):
        function(**good | {argument: np.zeros((97, 5))})
    with pytest.raises(ValueError, match=rf"^{label} is a dict; expected an array of numbers$"):
        function(**good | {argument: {}})


@pytest.mark.parametrize(("function", "good", "argument", "label"), [*cases("float")])
def test_what_is_no_number_is_named(function, good, argument, label):
    words = label.replace("_", "[_ ]")
    with pytest.raises(ValueError, match=rf"^{words}( limit)? (holds|is) (a )?NaN"):
        function(**good | {argument: np.nan})
    with pytest.raises(TypeError, match=rf"^must be real number, not str\n.*'{label}'$"):
        function(**good | {argument: "much"})


@pytest.mark.parametrize(("function", "good", "argument", "label"), [*cases("int")])
def test_a_negative_number_is_named(function, good, argument, label):
    with pytest.raises(
        (ValueError, OverflowError), match=rf"^{label} is -1; expected|^out of range.*\n.*'{label}'$"
    ):
        function(**good | {argument: -1})


@pytest.mark.parametrize("argument", ["lost", "lost_rotors"])
@pytest.mark.parametrize("rotor", [-1, 6])
def test_a_rotor_that_the_vehicle_has_not_is_named(argument, rotor):
    function, good = {
        "lost": (tilthex.Allocator(VEHICLE).allocate, {"wrench": np.zeros(6)}),
        "lost_rotors": (tilthex.Controller(VEHICLE, CONFIG).step, STATE | SAMPLE | {"setpoint": SETPOINT}),
    }[argument]
    with pytest.raises(ValueError, match=re.escape(f"{argument} is {rotor}; expected a number from 0 to 5")):
        function(**good | {argument: [rotor]})
