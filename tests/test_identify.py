"""`tilthex fit` and `tilthex excite`: a vehicle that is not its model is found from its flight."""

import json
from dataclasses import replace

import numpy as np
import pytest
import tilthex
from tilthex import fit
from tilthex.__main__ import main
from tilthex.excite import largest_tilt, to_toml, trajectory, waypoints
from tilthex.identify import Flight, _Set, _vehicle, identify

from benchmarks.identify import sensed, truth

MODEL = tilthex.Vehicle.preset("tilt-hex")
CONFIG = tilthex.Config.default(MODEL)


@pytest.fixture(scope="module")
def flight():
    way = trajectory(MODEL, [0, 0, 1], repeat=1)
    push = {"at": 14.0, "duration": 2.0, "force": [2.0, 0.0, -1.5]}
    run = tilthex.simulate(CONFIG, duration=way.duration, trajectory=way, truth="cad", seed=3, pushes=[push])
    return sensed(run)


def test_a_vehicle_that_is_not_its_model_is_found(flight):
    """Within the borders that docs/identification.md promises, and a push is left out by itself."""
    vehicle, true = tilthex.Truth(MODEL, "cad").draw(3).vehicle, truth(3)
    found = identify([flight], MODEL, mass=vehicle.mass)
    for name, value in true.items():
        figure = found[name]
        assert figure.learnt or name in ("mass", "drag moment")
        assert abs(figure.value - value) < 4 * figure.deviation, (name, value, str(figure))
    assert found["thrust, all rotors"].value == pytest.approx(true["thrust, all rotors"], rel=0.01)
    for axis in "xyz":
        name = f"inertia {axis * 2}"
        assert found[name].value == pytest.approx(true[name], rel=0.05)
        assert abs(found[f"centre of mass {axis}"].value - true[f"centre of mass {axis}"]) < 1.5e-3
    assert abs(found["rotor lag"].value - true["rotor lag"]) < 3e-3
    assert 2.0 <= found.left_out <= 6.0
    # What is written is this vehicle: the force of the rotors at hover is right.
    speeds = vehicle.hover_speeds()
    wrench = [v.allocation @ speeds**2 / v.mass for v in (found.vehicle, vehicle, MODEL)]
    assert np.linalg.norm(wrench[0] - wrench[1]) < 0.2 * np.linalg.norm(wrench[2] - wrench[1])
    again = tilthex.Vehicle.from_dict({"name": "x", "mass": 1, "inertia": [1, 1, 1], "rotors": MODEL.rotors})
    assert again.rotor_count == found.vehicle.rotor_count
    # The mass was weighed, so that nobody is asked to weigh it; the model's value stays the model's.
    text = fit.report(found)
    assert found["mass"].model == MODEL.mass != found["mass"].value
    assert "--mass" not in text and "weighed" in text.splitlines()[2]
    assert ("drag moment: a flight cannot tell it" in text) != found["drag moment"].learnt
    assert tilthex.Config.from_text(fit.toml(found)).vehicle == found.vehicle
    said = json.loads(json.dumps(fit.summary(found), allow_nan=False))
    assert (
        said["figures"]["rotor lag"]["value"] == found["rotor lag"].value and said["seconds"] == found.seconds
    )
    assert tilthex.Config.from_text(said["vehicle"]).vehicle == found.vehicle


def test_a_still_hover_says_that_it_tells_no_inertia():
    hover = tilthex.Setpoint([0, 0, 1], np.eye(3))
    run = tilthex.simulate(CONFIG, duration=14.0, setpoint=hover, truth="cad", seed=4)
    found = identify([sensed(run)], MODEL)
    for name in ("mass", "inertia xx", "inertia yy", "inertia zz", "drag moment"):
        assert not found[name].learnt, str(found[name])
        assert "not learnt" in str(found[name])


def test_what_belongs_to_other_sections_is_written_for_them(flight, tmp_path):
    """The written file is a configuration, and a vehicle; a key that was not learnt stays away."""
    found = identify([flight, flight], MODEL)
    names = {"rotor drag": ("contact", "rotor_drag"), "age of rotor speeds": ("link", "rotor_speed_age")}
    for learnt in (True, False):
        figures = [
            replace(f, value=1.5e-4, deviation=(0.1 if learnt else 0.9) * f.prior) if f.name in names else f
            for f in found.figures
        ]
        (tmp_path / "v.toml").write_text(fit.toml(replace(found, figures=figures)))
        config = tilthex.Config.from_toml(tmp_path / "v.toml")
        for section, key in names.values():
            assert config.to_dict()[section][key] == (1.5e-4 if learnt else 0.0)
        assert tilthex.Vehicle.from_toml(tmp_path / "v.toml") == found.vehicle == config.vehicle
    drawn = fit.figure([flight, flight], found, ["a.mcap", "b.mcap"])
    assert len(drawn.axes) == 12 and [axes.get_title() for axes in drawn.axes[:2]] == ["a.mcap", "b.mcap"]
    assert all(len(axes.lines) == 2 for axes in drawn.axes)


def test_too_little_of_flight_is_one_sentence():
    n = 2000
    zeros = np.zeros((n, 3))
    flight = Flight(0.002 * np.arange(n), zeros, zeros, np.full((n, 6), 80.0))
    with pytest.raises(ValueError, match="fewer than 10 blocks of 1 s in the air"):
        identify([flight], MODEL)


@pytest.mark.parametrize("preset", tilthex.Vehicle.presets())
def test_the_exciting_flight_stays_within_its_limits(preset):
    vehicle = tilthex.Vehicle.preset(preset)
    centre = np.array([0.3, -0.2, 1.5]) - vehicle.tool_position
    way = trajectory(vehicle, [0.3, -0.2, 1.5], radius=0.3, tilt=np.radians(10))
    tilt = largest_tilt(vehicle, np.radians(10))
    for time in np.linspace(0, way.duration, 2000):
        point = way.sample(time)
        rotation = point.rotation @ vehicle.tool_rotation.T
        place = point.position - rotation @ vehicle.tool_position
        assert np.all(abs(place - centre) < 0.32)
        assert rotation[2, 2] >= np.cos(1.05 * tilt) - 1e-9
        assert np.linalg.norm(point.velocity) < 1.01 and np.linalg.norm(point.angular_velocity) < 1.21
    assert len(waypoints(vehicle, [0, 0, 1])) <= 64
    if tilt == 0.0:
        assert vehicle.tracks != "position and attitude"


def test_the_command_writes_a_trajectory(tmp_path, capsys):
    assert main(["excite", "tilt-hex", "--out", str(tmp_path / "way.toml")]) == 0
    assert "s for tilthex-rt --trajectory" in capsys.readouterr().out
    assert (tmp_path / "way.toml").read_text() == to_toml(MODEL, [0, 0, 1])
    assert main(["excite", "tilt-hex", "--radius", "900"]) == 2
    assert "--radius is 900.0; expected 0.05 to 5 m" in capsys.readouterr().err


def test_an_impossible_fit_says_what_to_fly():
    inertia = np.diag([0.36, 0.039, 0.021])
    n, zero = MODEL.rotor_count, np.zeros(3)
    axis = np.tile([0.0, 0.0, 1.0], (n, 1))
    found = _Set(
        mass=MODEL.mass,
        inertia=inertia,
        position=np.array([rotor["position"] for rotor in MODEL.rotors]),
        axis=axis,
        thrust=np.full(n, 1e-3),
        drag=np.full(n, 2e-5),
        centre=zero,
        rotor_drag=0.0,
        speed_age=0.0,
        bias=zero,
    )
    with pytest.raises(ValueError, match=r"inertia .*fly the trajectory of `tilthex excite`"):
        _vehicle(MODEL, found, [])
