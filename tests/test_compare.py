"""`tilthex compare`: an external sensor on another clock, in other axes, beside what was observed."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tilthex import compare as c
from tilthex import log
from tilthex.__main__ import main

HEADER = "time,force_x,force_y,force_z,torque_x,torque_y,torque_z"


def contact(seed=0, seconds=20.0, rate=500.0):
    """A wrench of slow noise on a tool that moves; world axes, about the tip."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, seconds, 1 / rate) + 1.7e9
    noise = c.without_phase(rng.normal(size=(len(time), 6)), rate, 1.5)
    wrench = noise / noise.std(axis=0) * [2, 1, 3, 0.1, 0.3, 0.2]
    swing = np.sin(np.outer(time - time[0], [1.1, 0.7, 0.9]))
    turn = Rotation.from_rotvec(0.2 * swing)
    return c.Wrenches(time, wrench), c.ToolPath(time, [0.1, 0, 0.5] + 0.02 * swing, turn.as_matrix())


def reading(flight, tool, mounting, late, rate):
    """What a sensor there reads, on a clock of its own."""
    turn = Rotation.from_matrix(tool.rotation)
    force, torque = flight.wrench[:, :3], flight.wrench[:, 3:]
    if mounting.position is not None:
        place = tool.position + turn.apply(mounting.position) if mounting.on_tool else mounting.position
        torque = torque + np.cross(tool.position - place, force)
    axes = Rotation.identity() if mounting.rotation is None else Rotation.from_matrix(mounting.rotation)
    if mounting.on_tool:
        axes = turn * axes
    read = np.hstack([axes.inv().apply(force), axes.inv().apply(torque)])
    read *= -1 if mounting.reads_robot else 1
    time = np.arange(flight.time[0] + 1, flight.time[-1] - 1, 1 / rate)
    columns = [np.interp(time, flight.time, column) for column in read.T]
    return c.Wrenches(time - late, np.stack(columns, axis=1))


@settings(max_examples=12)
@given(
    on_tool=st.booleans(),
    reads_robot=st.booleans(),
    placed=st.booleans(),
    turn=st.tuples(*[st.floats(-3, 3)] * 3),
    late=st.floats(-3, 1.7e9),
    rate=st.sampled_from([100.0, 333.0, 1000.0]),
    seed=st.integers(0, 1000),
)
def test_any_sensor_on_any_clock_reads_the_same(on_tool, reads_robot, placed, turn, late, rate, seed):
    flight, tool = contact(seed)
    mounting = c.Mounting(
        on_tool,
        np.array([0.02, -0.03, 0.05]) if placed else None,
        Rotation.from_rotvec(turn).as_matrix(),
        reads_robot,
    )
    found = c.compare(flight, tool, reading(flight, tool, mounting, late, rate), mounting)
    assert abs(found.offset - late) < 3e-3
    assert found.correlation > 0.995
    off = np.std(found.observed - found.sensor, axis=0) / np.std(found.sensor, axis=0)
    assert off.max() < 0.05


def test_a_known_offset_shows_the_lag():
    flight, tool = contact(4)
    sensor = reading(flight, tool, c.Mounting(), 0.0, 500.0)
    late = c.Wrenches(flight.time + 0.033, flight.wrench)
    at_once, shifted = (c.compare(late, tool, sensor, c.Mounting(), offset=o) for o in (0.0, None))
    assert abs(shifted.offset - 0.033) < 3e-3
    spread = [np.std(f.observed - f.sensor, axis=0).max() for f in (at_once, shifted)]
    assert spread[0] > 5 * spread[1]


def test_a_tare_takes_the_sensors_zero_off():
    flight, tool = contact(5)
    flight.wrench[flight.time < flight.time[0] + 4] = 0.0
    sensor = reading(flight, tool, c.Mounting(on_tool=True), 0.0, 500.0)
    sensor.wrench[:] += [5, -4, 3, 0.2, 0.1, -0.3]
    mounting = c.Mounting(on_tool=True)
    plain = c.compare(flight, tool, sensor, mounting)
    tared = c.compare(flight, tool, sensor, mounting, tare=(1.5, 3.0))
    assert abs((plain.observed - plain.sensor).mean(axis=0)[0]) > 4.9
    np.testing.assert_allclose((tared.observed - tared.sensor).mean(axis=0), 0, atol=0.02)
    with pytest.raises(ValueError, match="no reading from 100 to 101 s"):
        c.compare(flight, tool, sensor, mounting, tare=(100, 101))


def test_what_is_before_the_bias_does_not_count():
    """A bias that is learnt after 8 s; `begin` and `end` are the user's."""
    flight, tool = contact(8)
    sensor = reading(flight, tool, c.Mounting(), 0.0, 500.0)
    flight.wrench[flight.time < flight.time[0] + 8] += [5, 0, 4, 0, 1, 0]
    late = replace(flight, learnt=8.5)
    found = c.compare(late, tool, sensor, c.Mounting())
    assert abs(found.offset) < 3e-3 and found.time[0] == pytest.approx(8.5, abs=0.011)
    assert abs((found.observed - found.sensor).mean(axis=0)).max() < 0.05
    assert "from 8.5 to 19.0 s since take-off" in str(found)
    whole = c.compare(late, tool, sensor, c.Mounting(), begin=0.0, end=12.0, offset=0.0)
    assert (whole.observed - whole.sensor).mean(axis=0)[0] > 2.0
    assert whole.time[0] < 1.1 and whole.time[-1] == pytest.approx(12.0, abs=0.011)
    with pytest.raises(ValueError, match=r"0\.99 s of the flight count; expected 2 s at least: see --begin"):
        c.compare(flight, tool, sensor, c.Mounting(), begin=5.0, end=5.995)


class FakeLog:
    """The topics that show when something was learnt: 100 Hz, in the air after 2 s, still from 4 to 7 s."""

    path = "flight.mcap"

    def __init__(self, hovers_at=None):
        self.time = 1.7e9 + np.arange(0, 20, 0.01)
        since = self.time - 1.7e9
        moves = np.clip(since, 2, 4) + np.maximum(since - 7, 0)
        phase = np.where(since < 2, "grounded", "flying")
        hovers = np.zeros(2000) if hovers_at is None else 1.0 * (since > hovers_at)
        self.topics = {
            "/flight": {"phase": phase},
            "/setpoint": {"position_w": moves[:, None] * [0.0, 0.1, 0.2]},
            "/model": {"hovers": hovers},
        }

    def columns(self, topic):
        return {"log_time": self.time, **self.topics[topic]}


@pytest.mark.parametrize(
    ("bias_time", "hovers_at", "ends"),
    [(2.0, None, 6.0), (0.0, None, 2.0), (5.0, None, 2.0), (2.0, 9.0, 9.0)],
)
def test_a_log_shows_when_the_bias_is_known(bias_time, hovers_at, ends):
    found = log.learning_ends(FakeLog(hovers_at), bias_time) - 1.7e9
    assert found == pytest.approx(ends, abs=0.03)


def test_another_contact_and_another_sign_are_refused():
    flight, tool = contact(6)
    other, _ = contact(7)
    sensor = reading(other, tool, c.Mounting(), 0.0, 500.0)
    with pytest.raises(ValueError, match="not like the observed wrench: largest correlation"):
        c.compare(flight, tool, sensor, c.Mounting())
    sensor = reading(flight, tool, c.Mounting(), 0.0, 500.0)
    with pytest.raises(ValueError, match="the opposite sign fits better: see --reads"):
        c.compare(flight, tool, sensor, c.Mounting(reads_robot=False))
    with pytest.raises(ValueError, match=r"share 0\.00 s"):
        c.compare(flight, tool, sensor, c.Mounting(), offset=100.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time,force_x\n0,1\n", "expected one sensor with time, force_x, force_y"),
        (
            HEADER + "\n" + "\n".join(f"{i},0,0,0,0,0,0" for i in range(20)),
            "the time rises by 1 each reading",
        ),
        (HEADER + "\n0,0,0,0,0,0,0\n", "holds 1 readings; expected at least 10"),
    ],
)
def test_what_is_no_sensor_is_one_sentence(tmp_path, text, said):
    path = tmp_path / "s.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=said):
        c.sensed(c.read_sensor(path))


def judge_a_flight(flight, folder, capsys):
    """The simulation's own contact wrench as the sensor's, on another clock, with its sign and in N mm."""
    truth = log.read(flight, ["/truth"])["/truth"]
    wrench = np.hstack([truth["tool_wrench_w.force"], 1e3 * truth["tool_wrench_w.torque"]])
    rows = np.column_stack([1e9 * (truth["log_time"] - truth["log_time"][0]), -wrench])
    names = ["time [ns]", *(f"force_{a}" for a in "xyz"), *(f"torque_{a} [N mm]" for a in "xyz")]
    np.savetxt(folder / "s.csv", rows, delimiter=",", header=",".join(names), comments="", fmt="%.12g")
    assert main(["compare", str(flight), str(folder / "s.csv"), "--out", str(folder / "c")]) == 0
    printed = capsys.readouterr().out
    assert float(printed.split("correlation ")[1].split()[0]) > 0.9
    assert main(["compare", str(flight), str(folder / "s.csv"), "--out", str(folder / "c"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert f"correlation {told['correlation']:.3f}" in printed and len(told["components"]) == 6
    for name in ("c-norms.png", "c-components.png"):
        assert str(folder / name) in told["pictures"] and (folder / name).read_bytes().startswith(b"\x89PNG")
