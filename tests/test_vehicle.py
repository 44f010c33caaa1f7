"""Vehicles, and rotations, against SciPy and an independent formulation of the allocation matrix."""

import re

import numpy as np
import pytest
import tilthex
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

angles = st.floats(-0.6, 0.6)
PRESETS = tilthex.Vehicle.presets()
TILTED = [p for p in PRESETS if p not in ("hexarotor", "quadrotor")]
"""Those that hover at an angle."""


def hexarotor(alpha: float, beta: float, offset: np.ndarray) -> dict:
    return {
        "preset": "tilt-hex",
        "tilted_hexarotor": {
            "alpha_deg": np.degrees(alpha),
            "beta_deg": np.degrees(beta),
            "rotor_offset": offset,
        },
    }


def allocation_by_momentum(alpha: float, beta: float, offset: np.ndarray) -> np.ndarray:
    """Column by column from the forces of six rotors, with SciPy's rotations."""
    columns = []
    for i in range(6):
        sign = (-1) ** i
        yaw = Rotation.from_euler("z", 60 * i, degrees=True)
        tilted = yaw * Rotation.from_euler("XY", [sign * alpha, beta])
        thrust = tilted.apply([0, 0, 11.4e-4])
        drag = tilted.apply([0, 0, sign * 2.4e-5])
        arm = yaw.apply([0.39, 0, 0]) + tilted.apply(offset)
        columns.append([*thrust, *(np.cross(arm, thrust) + drag)])
    return np.array(columns).T


@given(
    st.floats(0.2, 0.9) | st.floats(-0.9, -0.2),
    angles,
    st.tuples(*[st.floats(-0.05, 0.05)] * 3).map(np.array),
)
def test_every_column_of_the_allocation_matrix(alpha, beta, offset):
    vehicle = tilthex.Vehicle.from_dict(hexarotor(alpha, beta, offset))
    expected = allocation_by_momentum(alpha, beta, offset)
    np.testing.assert_allclose(vehicle.allocation, expected, rtol=0, atol=1e-15)


@given(st.sampled_from(TILTED), st.tuples(angles, angles, angles))
def test_hover_speeds_carry_the_weight(preset, tilt):
    vehicle = tilthex.Vehicle.preset(preset)
    if np.linalg.matrix_rank(vehicle.allocation) < 6:
        tilt = (0.0, 0.0, tilt[2])  # it cannot hover tilted
    rotation = Rotation.from_rotvec(tilt).as_matrix()
    w = vehicle.hover_speeds(rotation)
    wrench = vehicle.allocation @ (w * abs(w))
    assert vehicle.weight == vehicle.mass * tilthex.GRAVITY
    np.testing.assert_allclose(rotation @ wrench[:3], [0, 0, vehicle.weight], atol=1e-9)
    np.testing.assert_allclose(wrench[3:], 0, atol=1e-9)


@given(st.tuples(*[st.floats(-1.8, 1.8)] * 3).map(np.array))
def test_rotations_are_those_of_scipy(v):
    r = Rotation.from_rotvec(v).as_matrix()
    np.testing.assert_allclose(tilthex.so3.exp(v), r, atol=1e-14)
    np.testing.assert_allclose(tilthex.so3.log(r), Rotation.from_matrix(r).as_rotvec(), atol=1e-12)
    np.testing.assert_allclose(tilthex.so3.hat(v) @ [1, 2, 3], np.cross(v, [1, 2, 3]), atol=1e-14)
    np.testing.assert_array_equal(tilthex.so3.vee(tilthex.so3.hat(v)), v)
    np.testing.assert_allclose(tilthex.so3.project(1.3 * r), r, atol=1e-12)


def test_the_file_of_a_preset_gives_the_preset(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('[vehicle]\npreset = "tilt-hex"\nname = "mine"\ntool_position = [0, 0, -0.3]\n')
    mine = tilthex.Vehicle.from_toml(path)
    assert (mine.name, mine.mass) == ("mine", 2.4)
    np.testing.assert_array_equal(mine.tool_position, [0, 0, -0.3])
    again = tmp_path / "again.toml"
    again.write_text('[vehicle]\nfile = "mine.toml"\n')
    assert tilthex.Vehicle.from_toml(again).name == "mine"


ROTOR = {
    "position": [0.2, 0, 0],
    "axis": [0, 0, 1],
    "spin": 1,
    "thrust_coefficient": 3e-4,
    "drag_coefficient": 5e-6,
    "min_speed": 16,
    "max_speed": 130,
}


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"spinn": 1}, "[[vehicle.rotors]] 3: unknown key `spinn`; the nearest known one is `spin`"),
        ({"spin": "left"}, "[[vehicle.rotors]] 3: invalid type: string"),
        ({"spin": 0.5}, "rotor 3 has spin = 0.5; expected 1 or -1"),
        ({"position": [1, 2]}, "[[vehicle.rotors]] 3: found 2 numbers, expected one number or 3"),
        ({"axis": [0, 0, 2]}, "rotor 3 has length of axis = 2; expected a unit vector"),
        ({"max_speed": 10}, "rotor 3 has max_speed = 10; expected a number above min_speed"),
        ({"drag_coefficient": -1}, "rotor 3 has drag_coefficient = -1; expected zero or a positive"),
        ({"min_speed": None}, "[[vehicle.rotors]] 3: `min_speed` is missing"),
    ],
)
def test_a_bad_rotor_is_named_with_its_key(change, sentence):
    angles = np.arange(4) * np.pi / 2
    rotors = [
        ROTOR | {"position": [0.2 * np.cos(a), 0.2 * np.sin(a), 0], "spin": (-1) ** i}
        for i, a in enumerate(angles)
    ]
    described = {"mass": 1, "inertia": [0.01, 0.01, 0.02], "rotors": rotors}
    assert tilthex.Vehicle.from_dict(described).tracks == "position and heading"
    rotors[2] = {k: v for k, v in (rotors[2] | change).items() if v is not None}
    with pytest.raises(ValueError, match=re.escape(sentence)):
        tilthex.Vehicle.from_dict(described)


def test_a_vehicle_says_what_it_tracks():
    assert tilthex.Vehicle.preset("tilt-hex").tracks == "position and attitude"
    assert "tracks position and heading" in repr(tilthex.Vehicle.preset("hexarotor"))


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"preset": "tilt-hax"}, "unknown preset `tilt-hax`; the nearest known one is `tilt-hex`"),
        ({"preset": "tilt-hex", "mas": 1}, "unknown key `mas`; the nearest known one is `mass`"),
        ({"preset": "tilt-hex", "mass": -1.0}, "mass is -1; expected"),
        ({"preset": "tilt-hex", "inertia": [1, 2]}, "found 2 numbers, expected 3"),
        ({"preset": "tilt-hex", "tool_position": [1, 2]}, "found 2 numbers, expected"),
        ({"mass": 1, "inertia": [1, 1, 1]}, "no rotors"),
        ({"preset": "tilt-hex", "tilted_hexarotor": {"alfa_deg": 3}}, "`alpha_deg`"),
    ],
)
def test_a_bad_key_is_named(keys, sentence):
    with pytest.raises(ValueError, match=sentence.replace("[", r"\[")):
        tilthex.Vehicle.from_dict(keys)


@pytest.mark.parametrize(
    ("bad", "sentence"),
    [
        ([1.0, 2.0], r"v has shape \(2,\); expected \(3,\)"),
        (np.eye(3), r"v has shape \(3, 3\); expected \(3,\)"),
        ([0.0, np.nan, 0.0], "v holds NaN; expected finite numbers"),
        ([0.0, np.inf, 0.0], "v holds inf; expected finite numbers"),
        ("x", "v is a str; expected an array of numbers"),
    ],
)
def test_a_bad_array_is_named(bad, sentence):
    with pytest.raises(ValueError, match=sentence):
        tilthex.so3.exp(bad)


def test_a_reflection_is_no_rotation():
    with pytest.raises(ValueError, match=r"rotation is .* away from a rotation; expected"):
        tilthex.Vehicle.preset("tilt-hex").hover_speeds(-np.eye(3))
