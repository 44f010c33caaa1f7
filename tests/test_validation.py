"""Every class refuses a wrong shape, a NaN, an infinity and a non-rotation, by name."""

from __future__ import annotations

import re

import numpy as np
import pytest
import tilthex

VEHICLE = tilthex.Vehicle.preset("tilt-hex")
CONFIG = tilthex.Config.default(VEHICLE)
EYE = np.eye(3)
ZERO = np.zeros(3)
HOME = tilthex.Setpoint(ZERO, EYE)
SPEEDS = VEHICLE.hover_speeds()

STATE = {"position": ZERO, "velocity": ZERO, "rotation": EYE, "angular_velocity": ZERO}
SAMPLE = {"rotation": EYE, "angular_velocity": ZERO, "specific_force": ZERO, "rotor_speeds": SPEEDS}
SETPOINT = {
    "position": ZERO,
    "rotation": EYE,
    "velocity": ZERO,
    "angular_velocity": ZERO,
    "acceleration": ZERO,
    "angular_acceleration": ZERO,
}
SIMULATION = {"duration": 0.01, "gyro_bias": ZERO, "accelerometer_bias": ZERO}

CALLS = {
    "Setpoint": (tilthex.Setpoint, SETPOINT | {"wrench": np.zeros(6)}),
    "Reference": (tilthex.Reference, SETPOINT),
    "Controller": (
        lambda **a: tilthex.Controller(VEHICLE, CONFIG).step(setpoint=HOME, **a),
        STATE | SAMPLE | {"dt": 0.002},
    ),
    "PoseController": (
        lambda **a: tilthex.PoseController(CONFIG).step(reference=tilthex.Reference(ZERO, EYE), **a),
        STATE,
    ),
    "WrenchObserver": (
        lambda **a: tilthex.WrenchObserver(VEHICLE, CONFIG).step(**a),
        SAMPLE | {"dt": 0.002},
    ),
    "AdmittanceFilter": (
        lambda **a: tilthex.AdmittanceFilter(CONFIG).step(HOME, **a),
        {"wrench": np.zeros(6), "dt": 0.002},
    ),
    "Allocator": (
        lambda **a: tilthex.Allocator(VEHICLE).allocate(**a),
        {"wrench": np.zeros(6), "rotor_speeds": SPEEDS},
    ),
    "Plant": (
        lambda **a: tilthex.Plant(VEHICLE).step(**a),
        {"rotor_speeds": SPEEDS, "wrench": np.zeros(6), "tool_wrench": np.zeros(6), "dt": 0.001},
    ),
    "Plant.set_state": (
        lambda **a: tilthex.Plant(VEHICLE).set_state(**a),
        STATE | {"rotor_speeds": SPEEDS},
    ),
    "Plant.new": (lambda position: tilthex.Plant(VEHICLE, position), {"position": ZERO}),
    "Vehicle.hover_speeds": (lambda rotation: VEHICLE.hover_speeds(rotation), {"rotation": EYE}),
    "Vehicle.tool_wrench": (VEHICLE.tool_wrench, {"wrench": np.zeros(6), "rotation": EYE}),
    "Vehicle.robot_wrench": (VEHICLE.robot_wrench, {"wrench": np.zeros(6), "rotation": EYE}),
    "Trajectory.sample": (
        lambda **a: tilthex.Trajectory([{"position": ZERO}]).sample(**a),
        {"time": 0.0},
    ),
    "simulate": (lambda **a: tilthex.simulate(CONFIG, setpoint=HOME, **a), SIMULATION),
}
CASES = [(call, name) for call, (_, arguments) in CALLS.items() for name in arguments]


def poisoned(value, bad):
    if np.ndim(value) == 0:
        return bad
    array = np.array(value, dtype=float)
    array.flat[-1] = bad
    return array


@pytest.mark.parametrize("call", CALLS)
def test_good_arguments_are_taken_as_arrays_or_lists(call):
    function, arguments = CALLS[call]
    function(**arguments)
    function(**{name: np.asarray(value).tolist() for name, value in arguments.items()})
    function(**{name: poisoned(value, np.ravel(value)[-1]) for name, value in arguments.items()})


@pytest.mark.parametrize(("call", "name"), CASES)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_not_finite_is_named(call, name, bad):
    function, arguments = CALLS[call]
    shown = "NaN" if np.isnan(bad) else str(bad)
    with pytest.raises(ValueError, match=rf"^{name} (holds|is) {re.escape(shown)}; expected "):
        function(**arguments | {name: poisoned(arguments[name], bad)})


@pytest.mark.parametrize(("call", "name"), CASES)
def test_a_wrong_shape_is_named_with_both_shapes(call, name):
    function, arguments = CALLS[call]
    expected = np.shape(arguments[name])
    if not expected:
        pytest.skip("a number")
    for bad in (np.zeros((2, *expected)), np.zeros(expected[0] + 1), 1.0):
        message = f"{name} has shape {np.shape(bad)}; expected {expected}"
        with pytest.raises(ValueError, match=f"^{re.escape(message)}(, [A-Za-z].*)?$"):
            function(**arguments | {name: bad})
    with pytest.raises(ValueError, match=f"^{name} is a dict; expected an array of numbers$"):
        function(**arguments | {name: {}})
    with pytest.raises(
        ValueError, match=f"^{name} is an array of truth values; expected an array of numbers$"
    ):
        function(**arguments | {name: np.ones(expected, bool)})


@pytest.mark.parametrize(("call", "name"), [case for case in CASES if case[1] == "rotation"])
@pytest.mark.parametrize("bad", [-EYE, 1.01 * EYE, np.ones((3, 3)), np.zeros((3, 3))])
def test_a_matrix_that_is_no_rotation_is_named(call, name, bad):
    function, arguments = CALLS[call]
    with pytest.raises(ValueError, match=r"^rotation is .* away from a rotation; expected "):
        function(**arguments | {name: bad})


@pytest.mark.parametrize("dt", [0.0, -0.002, 1.5])
@pytest.mark.parametrize("call", [call for call, name in CASES if name == "dt"])
def test_a_period_is_positive(call, dt):
    function, arguments = CALLS[call]
    with pytest.raises(ValueError, match=r"^dt is .*; expected seconds above 0, up to 1$"):
        function(**arguments | {"dt": dt})


@pytest.mark.parametrize(
    ("sections", "sentence"),
    [
        ({"admitance": {}}, "unknown section `admitance`; the nearest known one is `admittance`"),
        ({"admittance": {"stifness": 1}}, "unknown key `stifness`; the nearest known one is `stiffness`"),
        ({"admittance": {"stiffness": [1, 2]}}, "found 2 numbers, expected 6 numbers"),
        ({"admittance": {"mass": [-1] * 6}}, "admittance mass has the eigenvalue -1"),
        ({"pose_control": {"position_gain": float("nan")}}, "position_gain holds a NaN"),
        ({"wrench_observer": {"force_gain": 0}}, "force_gain is 0; expected a number from"),
        ({"admittance": {"room_torque": -1}}, "[admittance]: room_torque is -1; expected a number from 0"),
        ({"admittance": 3}, "[admittance]: found an integer; expected a table"),
    ],
)
def test_a_bad_key_is_named(sections, sentence):
    with pytest.raises(ValueError, match=re.escape(sentence)):
        CONFIG.replace(**sections)


@pytest.mark.parametrize(
    ("waypoints", "sentence"),
    [
        ([], "waypoints is empty"),
        ([{}], 'waypoints[0]["position"] is missing'),
        ([{"position": [0, 0]}], 'waypoints[0]["position"] has shape (2,); expected (3,)'),
        ([{"position": ZERO}, {"position": ZERO, "holt": 1}], 'waypoints[1]["holt"] is unknown'),
        ([{"position": ZERO, "rotation": -EYE}], 'waypoints[0]["rotation"] is'),
        ([{"position": ZERO, "hold": -1}], 'waypoints[0]["hold"] is -1; expected'),
        ([{"position": ZERO}] * 66, "65 way-points were given; expected 0 to 64"),
    ],
)
def test_a_bad_waypoint_is_named(waypoints, sentence):
    with pytest.raises(ValueError, match=re.escape(sentence)):
        tilthex.Trajectory(waypoints)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({}, "setpoint and trajectory are both given or both missing; expected exactly one of them"),
        ({"setpoint": HOME, "pushes": [{"at": 1}]}, "pushes[0]: missing field `duration`"),
        (
            {"setpoint": HOME, "pushes": [{"at": 1, "duration": 1, "fource": ZERO}]},
            "pushes[0]: unknown field",
        ),
        ({"setpoint": HOME, "noise": -1}, "noise is -1; expected a number from 0"),
    ],
)
def test_a_bad_scenario_is_named(arguments, sentence):
    with pytest.raises(ValueError, match=re.escape(sentence)):
        tilthex.simulate(CONFIG, duration=1, **arguments)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"duration": "long"}, "duration is a str; expected a number of seconds"),
        ({"setpoint": [0, 0, 1]}, "setpoint is a list; expected a tilthex.Setpoint"),
        ({"trajectory": HOME}, "trajectory is a Setpoint; expected a tilthex.Trajectory"),
        ({"noise": None}, "noise is a NoneType; expected a number"),
        ({"estimator": "no"}, "estimator is a str; expected True or False"),
        ({"pose_delay": "late"}, "pose_delay is a str; expected a number of seconds"),
        ({"start": 3}, "start is a int; expected 'air' or 'ground'"),
        ({"pushes": [3]}, "pushes[0] is a int; expected a dict"),
    ],
)
def test_an_argument_of_the_wrong_kind_is_named(arguments, sentence):
    flight = {"duration": np.float64(0.01), "setpoint": HOME, "noise": 0} | arguments
    for simulate in (tilthex.simulate, tilthex.simulate_many):
        with pytest.raises(TypeError, match=f"^{re.escape(sentence)}$"):
            simulate(CONFIG, **flight)
    for wrong, kind in ((3, "int"), (CONFIG.to_toml(), "str")):
        sentence = f"the config of flight 1 is a {kind}; expected a tilthex.Config"
        with pytest.raises(TypeError, match=f"^{re.escape(sentence)}$"):
            tilthex.simulate_many([CONFIG, wrong], duration=0.01, setpoint=HOME)


def test_a_configuration_survives_its_file(tmp_path):
    changed = CONFIG.replace(admittance={"stiffness": np.diag([1, 2, 3, 4, 5, 6]) + 0.1})
    path = tmp_path / "config.toml"
    path.write_text(changed.to_toml())
    assert tilthex.Config.from_toml(path) == changed
    assert changed != CONFIG
    assert changed.vehicle.name == "tilt-hex"
    assert CONFIG.warnings == []
    slow = CONFIG.replace(wrench_observer={"torque_gain": 2})
    assert len(slow.warnings) == 1
    path.write_text("[vehicle]\npreset = 'tilt-hex'\n[admittance]\nmas = 1\n")
    with pytest.raises(ValueError, match=rf"^{re.escape(str(path))}: \[admittance\]: unknown key `mas`"):
        tilthex.Config.from_toml(path)
