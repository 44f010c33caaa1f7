"""`tilthex fit` and `tilthex excite`: a vehicle that is not its model is found from its flight."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import tilthex
from tilthex import _priors, fit
from tilthex.__main__ import main
from tilthex._identified import Figure
from tilthex._parameters import Numbers, corrected
from tilthex._priors import Prior
from tilthex.excite import largest_tilt, to_toml, trajectory, waypoints
from tilthex.identify import Flight, identify

from benchmarks import identify as benchmark
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
    assert "--mass" not in text and "given: " in text.splitlines()[2]
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


def test_the_written_file_is_a_configuration_and_a_vehicle(flight, tmp_path):
    """The vehicle has drag and flapping of its rotors; an age that was not learnt stays away."""
    found = identify([flight, flight], MODEL)
    for learnt in (True, False):
        figures = [
            replace(f, value=1.5e-3, deviation=(0.1 if learnt else 0.9) * f.prior)
            if f.name == "age of rotor speeds"
            else f
            for f in found.figures
        ]
        (tmp_path / "v.toml").write_text(fit.toml(replace(found, figures=figures)))
        config = tilthex.Config.from_toml(tmp_path / "v.toml")
        assert config.to_dict()["link"]["rotor_speed_age"] == (1.5e-3 if learnt else 0.0)
        assert tilthex.Vehicle.from_toml(tmp_path / "v.toml") == found.vehicle == config.vehicle
    drawn = fit.figure([flight, flight], found, ["a.mcap", "b.mcap"])
    assert len(drawn.axes) == 12 and [axes.get_title() for axes in drawn.axes[:2]] == ["a.mcap", "b.mcap"]
    assert all(len(axes.lines) == 2 for axes in drawn.axes)


def test_drag_and_flapping_of_the_rotors_are_found_and_written():
    """In a flight that moves; a hover does not show them, and the model's values stay."""
    model = MODEL.replace(rotor_drag=1e-4, flapping=1e-7)
    config = tilthex.Config.default(model)
    way = trajectory(model, [0, 0, 1], repeat=1)
    air = {"aerodynamics": {"rotor_drag": 2.6e-4, "flapping": 1.4e-6}}
    found = identify(
        [sensed(tilthex.simulate(config, trajectory=way, duration=way.duration, truth=air))], model
    )
    for name, key in (("rotor drag", "rotor_drag"), ("flapping torque", "flapping")):
        figure, true = found[name], air["aerodynamics"][key]
        assert figure.learnt and abs(figure.value - true) < 4 * figure.deviation, str(figure)
        assert figure.model == getattr(model, key)
        assert getattr(found.vehicle, key) == pytest.approx(figure.value)
        assert getattr(tilthex.Config.from_text(fit.toml(found)).vehicle, key) == pytest.approx(figure.value)
    hover = tilthex.Setpoint([0, 0, 1], np.eye(3))
    still = identify([sensed(tilthex.simulate(config, duration=14.0, setpoint=hover, truth=air))], model)
    for name, key in (("rotor drag", "rotor_drag"), ("flapping torque", "flapping")):
        assert not still[name].learnt and getattr(still.vehicle, key) == getattr(model, key)
        assert name in fit.report(still).split("not learnt:")[-1]


def test_what_the_user_knows_moves_what_the_flight_does_not_tell(flight):
    """Mass and thrust are known only together: a prior of the mass moves the thrust with it."""
    plain = identify([flight], MODEL)
    heavy = 1.02 * MODEL.mass
    known = identify([flight], MODEL, priors={"mass": Prior(heavy, 0.001)})
    assert known["mass"].value == pytest.approx(heavy, abs=0.002)
    assert known["mass"].deviation == pytest.approx(0.001, rel=0.05)
    for name in ("thrust, all rotors", "thrust, rotor 4", "inertia xx", "inertia zz"):
        before, after = plain[name], known[name]
        ratio = before.value / plain["mass"].value, after.value / known["mass"].value
        assert ratio[0] == pytest.approx(ratio[1], rel=0.01)
        assert after.given is None
    # Linear theory, with the covariance of all figures without the prior.
    names = [one.name for one in plain.figures[: len(plain.correlation)]]
    spread = np.array([one.deviation for one in plain.figures[: len(names)]])
    covariance = plain.correlation * np.outer(spread, spread)
    m = names.index("mass")
    told = 1 / 0.001**2 - 1 / plain["mass"].prior ** 2
    after = covariance - np.outer(covariance[m], covariance[m]) * told / (1 + told * covariance[m, m])
    for k, name in enumerate(names):
        assert known[name].deviation == pytest.approx(np.sqrt(after[k, k]), rel=0.1), name
    assert known["thrust, all rotors"].deviation < 0.4 * plain["thrust, all rotors"].deviation
    line = next(row for row in fit.report(known).splitlines() if row.startswith("mass"))
    assert f"(given: {heavy:.5g} +- 0.001, model: {MODEL.mass:.5g})" in line and "not learnt" not in line
    # A weighed mass is such a prior.
    weighed = identify([flight], MODEL, mass=heavy)
    same = identify([flight], MODEL, priors={"Mass": Prior(heavy, 0.002 * heavy)})
    assert [str(one) for one in weighed.figures] == [str(one) for one in same.figures]


def test_every_figure_takes_a_prior(flight):
    """Very tight priors of all figures are the result, whatever the flight says."""
    plain = identify([flight], MODEL)
    # The thrust of the last rotor follows from those of the others and of all.
    free = [one for one in plain.figures if one.name != f"thrust, rotor {MODEL.rotor_count}"]
    side = dict(
        zip([one.name for one in free], np.random.default_rng(3).choice([-0.3, 0.3], len(free)), strict=True)
    )
    side["dead time"] = 0.3
    side["rotor drag"] = 0.3
    priors = {
        _priors.key(one.name): Prior(one.model + side[one.name] * one.prior, 0.01 * one.deviation)
        for one in free
    }
    found = identify([flight], MODEL, priors=priors)
    for one in free:
        prior, result = priors[_priors.key(one.name)], found[one.name]
        assert result.value == pytest.approx(prior.value, abs=0.5 * one.deviation), one.name
        assert result.given == prior.value and result.known
    config = tilthex.Config.from_text(fit.toml(found))
    assert config.vehicle.rotor_drag == pytest.approx(priors["rotor_drag"].value, rel=0.05)


def test_priors_are_those_of_an_independent_least_squares():
    """A linear problem: the priors as rows beside the data, solved by NumPy."""
    rng = np.random.default_rng(5)
    size, names = 6, ["a", "b", "c"]
    rows, data = rng.normal(size=(9, size)), rng.normal(size=9)
    figures, offset = rng.normal(size=(3, size)), rng.normal(size=3)
    given = {"a": Prior(0.7, 0.02), "c": Prior(-1.1, 3.0)}
    mean, information = _priors.informed(lambda z: figures @ z + offset, size, given, names)
    hessian = rows.T @ rows + information
    found = np.linalg.solve(hessian, rows.T @ data + information @ mean)
    # Without a prior, each parameter has the mean 0 and the deviation 1. Those of the figures are taken away,
    # and the given ones take their places.
    h = figures[[0, 2]]
    gain = h.T @ np.linalg.inv(h @ h.T)
    spread = np.eye(size) - gain @ h + gain @ np.diag([0.02**2, 9.0]) @ gain.T
    start = gain @ (np.array([0.7, -1.1]) - offset[[0, 2]])
    white = np.linalg.inv(np.linalg.cholesky(spread))
    best, *_ = np.linalg.lstsq(np.vstack([rows, white]), np.r_[data, white @ start], rcond=None)
    np.testing.assert_allclose(found, best, rtol=1e-8)
    np.testing.assert_allclose(np.linalg.inv(information), spread, atol=1e-9)
    np.testing.assert_allclose(figures[0] @ mean + offset[0], 0.7, atol=1e-12)


def test_a_prior_far_from_the_model_is_met():
    """The mass is the exponential of its parameter; a small deviation asks for the exact value."""
    for factor in (1 / _priors.FACTOR, _priors.FACTOR):
        given = {"mass": Prior(factor * MODEL.mass, 1e-3)}
        mean, _ = _priors.informed(lambda z: MODEL.mass * np.exp(0.03 * z), 1, given, ["mass"])
        assert MODEL.mass * np.exp(0.03 * mean[0]) == pytest.approx(given["mass"].value, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("mass", "--prior is 'mass'; expected NAME=VALUE+-DEVIATION"),
        ("mass=2.4", "expected NAME=VALUE+-DEVIATION"),
        ("mass=2.4+-x", "expected NAME=VALUE+-DEVIATION"),
        ("inertia=0.08+-0.01", "no figure is named 'inertia'; expected one of mass, thrust_all_rotors, "),
        ("mass=2.4+-0", "the deviation of mass is 0; expected 7.2e-07 to 72 kg"),
        ("mass=2.4+--0.1", "the deviation of mass is -0.1; expected 7.2e-07 to 72 kg"),
        ("mass=2.4+-nan", "the deviation of mass is nan; expected"),
        ("mass=2.4+-1e-12", "the deviation of mass is 1e-12; expected"),
        ("mass=2.4+-1e9", "the deviation of mass is 1e+09; expected"),
        ("mass=nan+-0.1", "mass is nan, that of the model 2.4 kg; expected"),
        ("mass=2400+-1", "mass is 2400, that of the model 2.4 kg; expected 0.48 to 12 kg"),
        ("mass=2400+-1 g", "mass is given in g; expected kg"),
        ("inertia_zz=-0.08+-0.01", "inertia zz is -0.08"),
        ("rotor drag=-1e-4+-1e-5", "rotor drag is -0.0001"),
        ("centre_of_mass_z=4+-1", "centre of mass z is 4, that of the model 0 m"),
        ("age of rotor speeds=4+-1", "age of rotor speeds is 4"),
    ],
)
def test_a_wrong_prior_is_one_sentence(text, says):
    n = 2000
    zeros = np.zeros((n, 3))
    flight = Flight(0.002 * np.arange(n), zeros, zeros, np.full((n, 6), 80.0), np.full((n, 6), 80.0))
    model = MODEL.replace(mass=2.4)
    with pytest.raises(ValueError, match=re.escape(says)) as error:
        identify([flight], model, priors=dict([_priors.parse(text)]))
    assert "\n" not in str(error.value)


def test_priors_that_follow_from_others_are_refused():
    n = 2000
    zeros = np.zeros((n, 3))
    flight = Flight(0.002 * np.arange(n), zeros, zeros, np.full((n, 6), 80.0))
    each = {f"thrust, rotor {k}": Prior(1.0, 0.01) for k in range(1, 7)}
    with pytest.raises(ValueError, match="one follows from the others"):
        identify([flight], MODEL, priors=each | {"thrust, all rotors": Prior(1.0, 0.01)})
    with pytest.raises(ValueError, match="the mass is given twice"):
        identify([flight], MODEL, mass=2.0, priors={"mass": Prior(2.0, 0.01)})
    with pytest.raises(ValueError, match="no figure is named 'rotor_lag'"):
        identify([flight], MODEL, priors={"rotor_lag": Prior(0.02, 0.01)})


def test_the_benchmark_leaves_out_a_flight_with_a_fault(monkeypatch, capsys):
    """This vehicle sinks to the floor and stands on its tool."""
    monkeypatch.setattr(benchmark, "MODEL", tilthex.Vehicle.preset("coaxial-tilt-hex"))
    monkeypatch.setattr("sys.argv", ["identify", "8907", "1"])
    benchmark.main()
    assert "seed 8907 is left out: excursion at " in capsys.readouterr().out


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


def test_an_impossible_fit_says_what_to_do():
    inertia = np.diag([0.36, 0.039, 0.021])
    n, zero = MODEL.rotor_count, np.zeros(3)
    axis = np.tile([0.0, 0.0, 1.0], (n, 1))
    found = Numbers(
        mass=MODEL.mass,
        inertia=inertia,
        position=np.array([rotor["position"] for rotor in MODEL.rotors]),
        axis=axis,
        thrust=np.full(n, 1e-3),
        drag=np.full(n, 2e-5),
        centre=zero,
        rotor_drag=0.0,
        flapping=0.0,
        speed_age=0.0,
        bias=zero,
    )
    with pytest.raises(ValueError, match=r"inertia .*fly the trajectory of `tilthex excite`.*--end.*--prior"):
        corrected(MODEL, found, [])
    # A drag that the flight determined, a little below 0, is not that of the model.
    dragged = MODEL.replace(rotor_drag=1e-4)
    below = Figure("rotor drag", "N s/m/Hz", -1e-6, 4e-6, 3e-4, 1e-4)
    possible = replace(found, inertia=MODEL.inertia)
    assert corrected(dragged, possible, [below]).rotor_drag == 0.0
    assert corrected(dragged, possible, [replace(below, deviation=2e-4)]).rotor_drag == 1e-4
