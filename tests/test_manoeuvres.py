"""Flights that ask for more than the rotors give; `tilthex design`."""

import json

import numpy as np
import pytest
import tilthex
from tilthex import design, manoeuvres
from tilthex.__main__ import main


@pytest.mark.parametrize("manoeuvre", manoeuvres.MANOEUVRES)
def test_the_attitude_holds_where_a_clip_loses_it(manoeuvre):
    vehicle = tilthex.Vehicle.preset("tilt-hex")
    clipped = manoeuvres.fly(vehicle, manoeuvre, "clip")
    assert np.nanmax(manoeuvres.attitude_errors(clipped, manoeuvre, "clip")) > 5
    # At 60 deg of roll no inputs carry the weight: there the attitude must yield.
    for way in ("turned",) if manoeuvre == "roll" else ("turned", "fixed"):
        flight = manoeuvres.fly(vehicle, manoeuvre, way)
        assert manoeuvres.attitude_errors(flight, manoeuvre, way).max() < 5
        assert not flight.lost


@pytest.mark.parametrize(
    ("manoeuvre", "way"),
    [("step", "fixed"), ("step", "turned"), ("push", "fixed"), ("push", "turned"), ("roll", "fixed")],
)
def test_saturation_is_no_contact(manoeuvre, way):
    flight = manoeuvres.fly(tilthex.Vehicle.preset("tilt-hex"), manoeuvre, way)
    assert flight.saturated > 0
    assert np.nanmax(flight.false_force) < 0.1


@pytest.mark.parametrize("manoeuvre", manoeuvres.MANOEUVRES)
@pytest.mark.parametrize("name", tilthex.Vehicle.presets())
def test_every_vehicle_arrives_with_its_attitude(name, manoeuvre):
    flight = manoeuvres.fly(tilthex.Vehicle.preset(name), manoeuvre, "turned", seconds=12.0)
    assert not flight.lost
    assert flight.position_error[-1] < 0.01
    assert flight.attitude_error.max() < 5


def test_the_papers_trade_off_is_found_again():
    """30 to 35 deg make a moderate lateral force cheapest; beta = 10 deg costs little."""
    alphas, betas = np.linspace(0, 60, 25), np.linspace(-20, 20, 5)
    found = design.sweep(
        {"preset": "tilt-hex"}, {"tilted_hexarotor.alpha_deg": alphas, "tilted_hexarotor.beta_deg": betas}
    )
    best = found.best("lateral_efficiency")
    assert 30 <= best["tilted_hexarotor.alpha_deg"] <= 35
    cost = found.values["lateral_efficiency"]
    assert cost[list(alphas).index(32.5), list(betas).index(10)] > 0.9 * best["lateral_efficiency"]
    # What speaks for either side of it: more lateral force, less power in hover.
    at_ten = list(betas).index(10)
    assert (np.diff(found.values["hover_efficiency"][:, at_ten]) < 0).all()
    assert (np.diff(found.values["lateral_reach"][1:16, at_ten]) > 0).all()
    assert found.values["lateral_reach"][0, 2] == pytest.approx(0, abs=1e-6)


def test_design_and_manoeuvres_as_json(tmp_path, capsys):
    assert main(["design", "--sweep", "mass=2:3:3", "--out", str(tmp_path), "--json"]) == 0
    largest = json.loads(capsys.readouterr().out)["largest"]
    found = design.sweep({"preset": "tilt-hex"}, {"mass": np.linspace(2, 3, 3)})
    assert largest == {metric: pytest.approx(found.best(metric)) for metric in design.METRICS}
    assert main(["manoeuvres", "--vehicle", "hexarotor", "--out", str(tmp_path), "--json"]) == 0
    flights = json.loads(capsys.readouterr().out)["flights"]
    flown = [(flight["manoeuvre"], flight["way"]) for flight in flights]
    assert flown == [(m, w) for m in manoeuvres.MANOEUVRES for w in ("clip", "turned")]
    turned = [flight for flight in flights if flight["way"] == "turned"]
    assert not any(flight["lost"] for flight in turned)
    assert all(0 <= flight["saturated"] <= 1 and flight["position_error"] < 0.1 for flight in turned)


def test_the_design_command(tmp_path, capsys):
    assert main(["design", "--sweep", "mass=2:3:3", "--out", str(tmp_path)]) == 0
    table = np.genfromtxt(tmp_path / "design.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["mass"], [2, 2.5, 3])
    assert (np.diff(table["payload"]) < 0).all()
    assert (tmp_path / "design.png").stat().st_size > 1000
    assert "lateral_reach: largest" in capsys.readouterr().out
    assert main(["design", "--sweep", "mas=2:3:3", "--out", str(tmp_path)]) == 2
    assert "nearest known one is `mass`" in capsys.readouterr().err
    assert main(["design", "--sweep", "mass", "--out", str(tmp_path)]) == 2
    capsys.readouterr()
    both = ["--sweep", "mass=2:3:3", "--sweep", "tilted_hexarotor.beta_deg=0:0:1"]
    assert main(["design", *both, "--out", str(tmp_path)]) == 2
    assert "beta_deg has one value; expected 2 or more" in capsys.readouterr().err
