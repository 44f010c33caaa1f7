"""How throttles depend on the battery, and the age of rotor speeds: `tilthex fit` and `tilthex calibrate`."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import tilthex
from test_estimate import recorded
from test_programs import run
from tilthex import _battery, _core, _speed_age, estimate, fit
from tilthex.__main__ import main
from tilthex._identified import Figure
from tilthex._priors import Prior
from tilthex._speed_age import SpeedAge
from tilthex._toml import tomllib
from tilthex.excite import trajectory
from tilthex.identify import Flight, identify
from tilthex.log import Log

from benchmarks.identify import sensed

MAP = (-0.05, 0.005, 2.5e-5)
PX4 = f"""
vehicle.preset = "tilt-hex"
[link]
protocol = "px4"
baud = 0
throttle = {list(MAP)}
throttle_voltage = 15.0
"""


def throttled(seconds: float, falls: float, exponent: float, seed: int = 0) -> Flight:
    """A flight at changing speeds with a voltage that falls by a part; each motor has its own factor."""
    rng = np.random.default_rng(seed)
    time = 0.01 * np.arange(100 * seconds)
    voltage = 1.05 - falls * time / seconds
    wanted = 80 + 8 * np.sin(0.7 * time[:, None] + np.arange(4)) + 2 * rng.normal(size=(len(time), 4))
    throttle = MAP[0] + MAP[1] * wanted + MAP[2] * wanted**2
    factor = 1 + 0.03 * rng.normal(size=4)
    speeds = factor * wanted * voltage[:, None] ** exponent + 0.2 * rng.normal(size=wanted.shape)
    nothing = np.zeros((len(time), 3))
    mapped = _battery.speeds_of(throttle, MAP)
    return Flight(time, nothing, nothing, speeds, mapped_speeds=mapped, voltage=voltage)


def test_the_map_is_inverted():
    speeds = np.array([[20.0, 60.0, 110.0]])
    for c0, c1, c2 in (MAP, (0.02, 0.006, 0.0)):
        found = _battery.speeds_of(c0 + c1 * speeds + c2 * speeds**2, (c0, c1, c2))
        np.testing.assert_allclose(found, speeds, rtol=1e-12)
    assert np.isnan(_battery.speeds_of(np.array([np.nan, 0.0, 1.0]), MAP)).all()


@pytest.mark.parametrize("exponent", [0.0, 0.62, 1.0, 1.4])
def test_the_exponent_is_found_within_its_deviation(exponent):
    off = []
    for seed in range(12):
        (found,) = _battery.exponent([throttled(120.0, 0.15, exponent, seed)])
        assert found.learnt and found.deviation < 0.1
        off.append((found.value - exponent) / found.deviation)
    assert np.sqrt(np.mean(np.square(off))) < 2.0 and max(np.abs(off)) < 4.0


def test_a_voltage_that_does_not_move_is_said():
    """The exponent stays that of the link, and is no key of the file; a log with another charge tells it."""
    flight = replace(throttled(60.0, 0.001, 0.6), exponent=0.9)
    (found,) = _battery.exponent([flight])
    assert not found.learnt and abs(found.value - 0.9) < 2 * found.deviation
    assert "[link]" not in fit.link_keys([found]) and "not learnt" in fit.link_keys([found])
    fallen = flight.voltage - 0.12
    slower = flight.rotor_speeds * (fallen / flight.voltage)[:, None] ** 0.6
    low = replace(flight, voltage=fallen, rotor_speeds=slower)
    (both,) = _battery.exponent([flight, low])
    assert both.learnt and both.value == pytest.approx(0.6, abs=0.05)
    assert f"throttle_exponent = {both.value:.6g}" in fit.link_keys([both])
    # What the user knows stands in its place.
    (known,) = _battery.exponent([flight], {"throttle exponent": Prior(0.61, 0.01)})
    assert known.value == pytest.approx(0.61, abs=0.01) and known.known
    assert _battery.exponent([replace(flight, mapped_speeds=None)]) == []
    # A throttle at its end in each mean: nothing is learnt, and what the user knows stays.
    ends = flight.mapped_speeds.copy()
    ends[::300] = np.nan
    full = replace(flight, mapped_speeds=ends)
    (left,) = _battery.exponent([full])
    assert left.value == 0.9 and not left.known
    (told,) = _battery.exponent([full], {"throttle exponent": Prior(0.61, 0.01)})
    assert (told.value, told.deviation, told.given) == (0.61, 0.01, 0.61)


def test_flights_with_different_maps_tell_the_exponent_together():
    """Maps that were measured at other times differ by a factor, which is not the battery's."""
    first = replace(throttled(120.0, 0.08, 0.7, 1), throttle_map=(*MAP, 15.0))
    second = throttled(120.0, 0.08, 0.7, 1)
    fallen = second.voltage - 0.05
    speeds = second.rotor_speeds * (fallen / second.voltage)[:, None] ** 0.7
    other = replace(second, rotor_speeds=speeds, voltage=fallen, mapped_speeds=1.03 * second.mapped_speeds)
    (found,) = _battery.exponent([first, replace(other, throttle_map=(*MAP, 15.5))])
    assert found.learnt and abs(found.value - 0.7) < 3 * found.deviation, str(found)


@pytest.mark.real_time
def test_the_log_of_a_vehicle_with_px4_shows_it(tmp_path):
    """Throttles are in the bytes to the vehicle; the simulated motors have the exponent of the truth."""
    (tmp_path / "px4.toml").write_text(PX4)
    truth = tmp_path / "truth.toml"
    keys = {"throttle_exponent": 0.6, "battery_capacity": 0.3, "battery_charge": 1.0}
    lines = "\n".join(f"{key} = {value}" for key, value in keys.items())
    truth.write_text(f"[truth.structure]\n{lines}\n")
    options = ["--sim", "--take-off", "--config", tmp_path / "px4.toml", "--truth", truth]
    log = tmp_path / "a.mcap"
    result = run(*options, "--duration", "40", "--no-battery-limits", "--log", log)
    assert result.returncode == 0, result.stderr
    flight = fit.read(log)
    assert flight.throttle_map == (*MAP, 15.0)
    (found,) = _battery.exponent([flight])
    assert found.learnt and abs(found.value - 0.6) < 4 * found.deviation, str(found)
    named = identify([flight], tilthex.Vehicle.preset("tilt-hex"))["throttle exponent"]
    assert named == found
    # Throttles of the log give the commanded speeds, but for the correction.
    config = tilthex.Config.from_text(PX4)
    rows = _core.read_throttles(config, [bytes(tick.link) for _, tick in Log(log).messages("/output")])
    assert rows.shape[1] == 7 and np.nanmax(rows[:, 1:]) < 1.0 and len(rows) > 3000


def test_calibrate_finds_the_age_of_rotor_speeds(monkeypatch, tmp_path, capsys):
    """As `fit` does; the configured age, which the flight corrected, is a part of it."""
    config = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
    way = trajectory(config.vehicle, [0, 0, 1], repeat=1)
    late = {"delays": {"rotor_speeds": 0.004}}
    flown = sensed(tilthex.simulate(config, trajectory=way, duration=way.duration, truth=late, seed=2))
    monkeypatch.setattr(fit, "read", lambda log: flown)
    found = _speed_age.find_speed_age(None, config)
    assert abs(found.age.value - 0.004) < 4 * found.age.deviation and found.age.learnt
    assert found.after[0] < 0.9 * found.before[0] and found.after[1] < found.before[1]
    assert f"[link]\n# age of rotor speeds, s: {found.age.value:.3g} +- " in str(found)
    assert tilthex.Config.from_text(f'vehicle.preset = "tilt-hex"\n{found}\n')
    # A flight that corrected a part of the age before.
    part = flown.rotor_speeds + 0.003 * flown.rotor_acceleration
    monkeypatch.setattr(fit, "read", lambda log: replace(flown, rotor_speeds=part, speed_age=0.003))
    again = _speed_age.find_speed_age(None, config.replace(link={"rotor_speed_age": 0.003}))
    assert again.age.value == pytest.approx(found.age.value, abs=2e-4) and again.age.model == 0.003
    assert again.before[0] < found.before[0]
    # The line of the command when a log does not tell it.
    monkeypatch.setattr(fit, "read", lambda log: replace(flown, used=flown.time < 6.0))
    said = estimate._speed_age(None, config)
    assert said.startswith(
        "# rotor_speed_age in [link] was not searched: the flights have fewer than 10 blocks"
    )


def test_a_gentle_flight_does_not_tell_the_age(monkeypatch):
    """A calibration flight does not determine the inertia; the speeds of this vehicle have no age."""
    model = tilthex.Vehicle.preset("tilt-hex")
    config, way = tilthex.Config.default(model), tilthex.calibration_flight(model, [0, 0, 1])
    flown = tilthex.simulate(config, trajectory=way, duration=way.duration, truth="cad", seed=8924)
    monkeypatch.setattr(fit, "read", lambda log: sensed(flown))
    found = _speed_age.find_speed_age(None, config)
    assert not found.age.known
    assert "[link]" not in str(found) and str(found).endswith("not learnt")


@pytest.mark.parametrize("told", [True, False])
def test_calibrate_prints_and_writes_the_age(monkeypatch, tmp_path, capsys, told):
    """After the keys of the estimator, and in the table before and after."""
    config = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
    age = Figure("age of rotor speeds", "s", 0.0041, 0.0002, 0.003, 0.0)
    found = SpeedAge(age, (0.2, 0.02), (0.1, 0.01)) if told else "# rotor_speed_age in [link]: why not"
    monkeypatch.setattr(estimate, "own_log", lambda path: SimpleNamespace(configuration=config.to_toml()))
    monkeypatch.setattr(estimate, "_recording", lambda *arguments: recorded())
    monkeypatch.setattr(estimate, "_speed_age", lambda *arguments: found)
    assert main(["calibrate", "a.mcap", "--out", str(tmp_path / "found.toml")]) == 0
    printed = capsys.readouterr().out
    assert str(found) in printed and ("before: 0.2 m/s^2, 0.02 rad/s" in printed) == told
    assert ("with all keys: 0.1 m/s^2, 0.01 rad/s" in printed) == told
    text = (tmp_path / "found.toml").read_text()
    assert str(found) in text
    written = tomllib.loads(text)
    assert written.get("link", {}) == ({"rotor_speed_age": 0.0041} if told else {})
    assert {"latency", "position_noise"} <= written["estimator"].keys()
