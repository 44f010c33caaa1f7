"""The parameters of PX4 that describe rotors: written, read back, and checked against the vehicle."""

from __future__ import annotations

import json

import pytest
import tilthex
from hypothesis import given
from hypothesis import strategies as st
from strategies import vehicles
from tilthex import px4
from tilthex.__main__ import main

EACH = ("PX", "PY", "PZ", "AX", "AY", "AZ", "KM")


@given(vehicles())
def test_a_vehicle_agrees_with_its_own_parameters(vehicle):
    assert list(px4.differences(vehicle, px4.parameters(vehicle))) == []


@given(vehicles(), st.permutations(range(6)))
def test_every_motor_at_the_place_of_another_rotor_is_named(vehicle, order):
    own = px4.parameters(vehicle)
    moved = {
        f"CA_ROTOR{motor}_{name}": own[f"CA_ROTOR{rotor}_{name}"]
        for motor, rotor in enumerate(order)
        for name in EACH
    }
    found = list(px4.differences(vehicle, own | moved))
    for motor, rotor in enumerate(order):
        named = f"motor {motor + 1} of PX4 (CA_ROTOR{motor}) is at the place of rotor {rotor + 1}"
        assert (named in found) == (motor != rotor)


@given(vehicles(), st.integers(0, 5), st.sampled_from(["PX", "PY", "PZ", "AZ", "KM"]))
def test_a_wrong_parameter_is_named(vehicle, motor, name):
    own = px4.parameters(vehicle)
    wrong = own[f"CA_ROTOR{motor}_{name}"] + 0.07 if name[0] == "P" else -own[f"CA_ROTOR{motor}_{name}"]
    (sentence,) = px4.differences(vehicle, own | {f"CA_ROTOR{motor}_{name}": wrong})
    assert sentence.startswith(f"CA_ROTOR{motor}_{name[0]}")


def test_the_conventions_are_those_of_px4():
    # A quadrotor of PX4: motor 1 is at the front right and turns counter-clockwise seen from above.
    rotor = {"thrust_coefficient": 1e-3, "drag_coefficient": 2e-5, "min_speed": 0, "max_speed": 100}
    first = {"position": [0.2, -0.3, 0.0], "axis": [0, 0, 1], "spin": -1, **rotor}
    others = [
        {"position": place, "axis": [0, 0, 1], "spin": spin, **rotor}
        for place, spin in (([-0.2, 0.3, 0], -1), ([0.2, 0.3, 0], 1), ([-0.2, -0.3, 0], 1))
    ]
    quadrotor = {"name": "px4", "mass": 1.0, "inertia": [0.01, 0.01, 0.02], "rotors": [first, *others]}
    found = px4.parameters(tilthex.Vehicle.from_dict(quadrotor))
    assert found["CA_ROTOR_COUNT"] == 4
    assert [found[f"CA_ROTOR0_{name}"] for name in EACH] == pytest.approx([0.2, 0.3, 0, 0, 0, -1, 0.02])
    assert found["CA_ROTOR2_PY"] < 0 and found["CA_ROTOR2_KM"] < 0


def test_the_command_writes_and_checks_a_file(tmp_path, capsys):
    path = tmp_path / "mine.params"
    assert main(["px4", "tilt-hex", "--out", str(path)]) == 0
    assert main(["px4", "tilt-hex", "--check", str(path)]) == 0
    assert "the 6 motors of PX4 are the rotors of tilt-hex" in capsys.readouterr().out
    assert main(["px4", "tilt-hex", "--json"]) == 0
    written = json.loads(capsys.readouterr().out)["parameters"]
    assert written == px4.parameters(tilthex.Vehicle.preset("tilt-hex"))
    text = path.read_text().replace("CA_ROTOR2_", "X_").replace("CA_ROTOR4_", "CA_ROTOR2_")
    path.write_text(text.replace("X_", "CA_ROTOR4_"))
    assert main(["px4", "tilt-hex", "--check", str(path), "--json"]) == 2
    printed = capsys.readouterr()
    said, found = printed.err, json.loads(printed.out)["differences"]
    assert len(found) >= 2 and all(difference in said for difference in found)
    assert "motor 3 of PX4 (CA_ROTOR2) is at the place of rotor 5" in said
    assert "motor 5 of PX4 (CA_ROTOR4) is at the place of rotor 3" in said
    assert main(["px4", "quadrotor", "--check", str(path)]) == 2
    assert "CA_ROTOR_COUNT is 6; quadrotor has 4 rotors" in capsys.readouterr().err
    path.write_text("\n".join(line for line in text.splitlines() if "CA_ROTOR3_PX" not in line))
    assert main(["px4", "tilt-hex", "--check", str(path)]) == 2
    assert "CA_ROTOR3_PX is missing" in capsys.readouterr().err
    path.write_text("# nothing\n")
    assert main(["px4", "tilt-hex", "--check", str(path)]) == 2
    assert "holds no parameters" in capsys.readouterr().err
