"""A log in the formats of other programs, read back with their own libraries."""

import numpy as np
import pandas
import pytest
from rosbags.highlevel import AnyReader
from tilthex import __main__ as command
from tilthex import convert, log
from tilthex._quaternions import rotations_from_quaternions

pytestmark = pytest.mark.real_time


@pytest.mark.parametrize(("to", "read"), [("csv", pandas.read_csv), ("parquet", pandas.read_parquet)])
def test_tables_hold_every_number_of_every_topic(tmp_path, path, to, read):
    out = tmp_path / "new" / "tables"
    convert.convert(path, to, out)
    topics = [topic for topic in log.Log(path).topics if topic in convert.TOPICS]
    assert sorted(file.name for file in out.iterdir()) == sorted(f"{topic[1:]}.{to}" for topic in topics)
    for topic in topics:
        table = read(out / f"{topic[1:]}.{to}")
        expected = convert.flat(log.read(path, [topic])[topic])
        assert list(table.columns) == list(expected)
        for name, values in expected.items():
            if values.dtype.kind == "f":
                assert np.array_equal(table[name].to_numpy(float), values, equal_nan=True), (topic, name)
            else:
                assert table[name].fillna("").tolist() == values.tolist()


def test_a_bag_shows_the_flight_that_the_log_has(tmp_path, path):
    out = tmp_path / "bag"
    convert.convert(path, "rosbag2", out)
    topics = log.read(path, ["/state", "/wrench", "/rotors", "/setpoint"])
    found = {}
    with AnyReader([out]) as bag:
        for connection, time, raw in bag.messages():
            found.setdefault(connection.topic, []).append((time, bag.deserialize(raw, connection.msgtype)))
    assert set(found) == {
        "/commanded_wrench", "/imu", "/joint_states", "/odom",
        "/reference", "/setpoint", "/tf", "/tool_wrench",
    }  # fmt: skip
    state = topics["/state"]
    rotations = rotations_from_quaternions(state["orientation"])
    assert len(found["/odom"]) == len(rotations)
    for k, (time, message) in enumerate(found["/odom"]):
        stamp = message.header.stamp
        assert time == stamp.sec * 10**9 + stamp.nanosec == round(state["log_time"][k] * 1e9)
        assert (message.header.frame_id, message.child_frame_id) == ("map", "base_link")
        place, twist = message.pose.pose.position, message.twist.twist.linear
        assert (place.x, place.y, place.z) == tuple(state["position_w"][k])
        # The twist is in the child's axes.
        velocity_w = rotations[k] @ (twist.x, twist.y, twist.z)
        assert np.allclose(velocity_w, state["velocity_w"][k], atol=1e-12)
    for k, (_, message) in enumerate(found["/tf"]):
        moved, turned = message.transforms[0].transform.translation, message.transforms[0].transform.rotation
        assert (moved.x, moved.y, moved.z) == tuple(state["position_w"][k])
        assert (turned.x, turned.y, turned.z, turned.w) == tuple(state["orientation"][k])
    for k, (_, message) in enumerate(found["/joint_states"]):
        assert np.allclose(message.velocity, 2 * np.pi * topics["/rotors"]["measured"][k])
    for k, (_, message) in enumerate(found["/tool_wrench"]):
        force = message.wrench.force
        assert (force.x, force.y, force.z) == tuple(topics["/wrench"]["tool_w.force"][k])


def test_what_cannot_be_converted_is_one_sentence(tmp_path, capsys, path):
    (tmp_path / "there").mkdir()
    assert command.main(["convert", str(path), "--to", "csv", "--out", str(tmp_path / "there")]) == 2
    assert "there exists; remove it, or name another folder with --out" in capsys.readouterr().err
    expected = "expected one of csv, foxglove, parquet, rerun, rosbag2"
    with pytest.raises(ValueError, match=f"cannot be converted to 'xml'; {expected}"):
        convert.convert(path, "xml", tmp_path / "new")


def test_the_command_names_the_folder(path, capsys):
    assert command.main(["convert", str(path), "--to", "csv"]) == 0
    assert capsys.readouterr().out == f"written: {path.with_name('flight-csv')}\n"
