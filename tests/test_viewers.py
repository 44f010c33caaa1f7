"""A log in the files of Foxglove and Rerun, read back with their own libraries."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import tilthex
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from tilthex import __main__ as command
from tilthex import _foxglove, convert, log, plot
from tilthex._quaternions import quaternion_from_rotation, rotations_from_quaternions
from tilthex.view.geometry import cylinders, turn

AXES = st.sampled_from(np.vstack([np.eye(3), -np.eye(3)]).tolist())
NUMBERS = st.floats(-1e3, 1e3).filter(lambda x: x == 0.0 or abs(x) > 1e-3)


@given(axis=AXES, direction=st.lists(NUMBERS, min_size=3, max_size=3).filter(any))
def test_a_turn_takes_the_axis_to_the_direction(axis, direction):
    direction = np.array(direction)
    rotation = turn(axis, direction)
    assert np.allclose(rotation @ axis, direction / np.linalg.norm(direction), atol=1e-7)
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    again = rotations_from_quaternions(quaternion_from_rotation(rotation)[None])[0]
    assert np.allclose(again, rotation, atol=1e-7)


@pytest.fixture(scope="module")
def foxglove(path):
    pytest.importorskip("foxglove_schemas_protobuf", reason="Foxglove's schemas are not installed")
    out = path.with_name("foxglove")
    convert.convert(path, "foxglove", out)
    return out


def messages(path):
    """Topic: times, ns, and messages."""
    from mcap_protobuf.decoder import DecoderFactory

    found = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            found.setdefault((channel.topic, schema.name), []).append((message.log_time, decoded))
    return found


def place(pose):
    """Position and rotation matrix of a pose of Foxglove."""
    at, q = pose.position, pose.orientation
    turned = rotations_from_quaternions(np.array([[q.x, q.y, q.z, q.w]]))[0]
    return np.array([at.x, at.y, at.z]), turned


@pytest.mark.real_time
def test_the_log_itself_is_in_the_file_for_foxglove(path, foxglove):
    before, after = log.Log(path), log.Log(foxglove / "flight.mcap")
    assert after.attachments == before.attachments
    new = {"/scene", "/setpoint_pose", "/reference_pose"}
    assert {t: n for t, n in after.topics.items() if t not in new} == before.topics
    names = {number: channel[0] for number, channel in before.channels.items()}
    again = {number: channel[0] for number, channel in after.channels.items()}

    def ordered(log, names):
        rows = ((time, names[number], data) for time, number, data in log.raw())
        return sorted(row for row in rows if row[1] not in new)

    assert ordered(before, names) == ordered(after, again)


@pytest.mark.real_time
def test_foxglove_shows_poses_and_scene(path, foxglove):
    found = messages(foxglove / "flight.mcap")
    topics = log.read(path, ["/setpoint", "/reference", "/wrench", "/state"])
    times = {topic: [round(1e9 * t) for t in columns["log_time"]] for topic, columns in topics.items()}
    for topic in ("/setpoint", "/reference"):
        poses = found[f"{topic}_pose", "foxglove.PoseInFrame"]
        # Fifty a second, as long as the flight does not stand still.
        gaps = np.diff([time for time, _ in poses])
        stands = np.diff(times["/state"]).max()
        assert gaps.max() < 0.03e9 + stands and np.median(gaps) == pytest.approx(0.02e9, rel=0.2)
        for time, message in poses:
            row = times[topic].index(time)
            position, rotation = place(message.pose)
            assert message.frame_id == "world" and message.timestamp.ToNanoseconds() == time
            assert np.allclose(position, topics[topic]["position_w"][row])
            logged = rotations_from_quaternions(topics[topic]["orientation"][row][None])[0]
            assert np.allclose(rotation, logged, atol=1e-7)
    arrows, vehicles = 0, []
    config = tilthex.Config.from_text(log.configuration(path))
    for time, message in found["/scene", "foxglove.SceneUpdate"]:
        (entity,) = message.entities
        if entity.id == "vehicle":
            vehicles.append(entity)
            continue
        row = times["/wrench"].index(time)
        robot = rotations_from_quaternions(topics["/state"]["orientation"][row][None])[0]
        tip = topics["/state"]["position_w"][row] + robot @ config.vehicle.tool_position
        force = topics["/wrench"]["tool_w.force"][row]
        for arrow in entity.arrows:
            position, rotation = place(arrow.pose)
            assert np.allclose(position, tip, atol=1e-9)
            if arrow.color.r == pytest.approx(220 / 255):
                arrows += 1
                shown = (arrow.shaft_length + arrow.head_length) * rotation[:, 0]
                assert np.allclose(shown, _foxglove.FORCE_LENGTH * force, atol=1e-6)
    assert arrows > 20 and len(vehicles) > 2
    for entity in vehicles:
        assert entity.frame_id == "robot" and entity.frame_locked
        for cylinder, shape in zip(entity.cylinders, cylinders(config.vehicle), strict=True):
            position, rotation = place(cylinder.pose)
            half = 0.5 * cylinder.size.z * rotation[:, 2]
            assert np.allclose([position - half, position + half], [shape.begin, shape.end], atol=1e-6)


@pytest.mark.real_time
def test_the_layout_shows_what_the_file_has(foxglove):
    found = messages(foxglove / "flight.mcap")
    newest = {topic: rows[-1][1] for (topic, _), rows in found.items()}
    layout = json.loads((foxglove / "layout.json").read_text())
    panels = layout["configById"]
    for panel in panels.values():
        for path in panel.get("paths", []):
            topic, *names = path["value"].split(".")
            value = newest[topic]
            for name in names:
                name, _, index = name.partition("[")
                value = getattr(value, name)
                value = value[int(index[:-1])] if index else value
            assert isinstance(value, float | int)
    assert set(panels["3D!scene"]["topics"]) <= set(newest)

    def leaves(node):
        return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]

    assert sorted(leaves(layout["layout"])) == sorted(panels)


@pytest.mark.real_time
def test_rerun_reads_its_file(path, tmp_path):
    pytest.importorskip("rerun", reason="rerun-sdk is not installed: no file of Rerun is written")
    reader = shutil.which("rerun", path=str(Path(sys.executable).parent)) or shutil.which("rerun")
    convert.convert(path, "rerun", tmp_path / "out")
    file = str(tmp_path / "out" / "flight.rrd")
    subprocess.run([reader, "rrd", "verify", file], check=True, capture_output=True)
    shown = subprocess.run([reader, "rrd", "stats", file], check=True, capture_output=True, text=True).stdout
    rows = len(log.read(path, ["/state"])["/state"]["log_time"])
    # It groups the digits of a number with thin spaces.
    most = next(line for line in shown.splitlines() if line.startswith("num_rows_max"))
    assert "".join(filter(str.isdigit, most)) == str(rows)
    for entity in ("/world/robot", "/world/force", "/plots/tool_force/x", "/plots/rotor_speed/6", "/events"):
        assert f"{entity}: " in shown, entity


@pytest.mark.real_time
def test_a_plot_is_vector_graphics_by_its_name(path, tmp_path, capsys):
    pdf, svg = tmp_path / "flight.pdf", tmp_path / "flight.svg"
    for out in (pdf, svg):
        assert command.main(["plot", str(path), "--out", str(out)]) == 0
        capsys.readouterr()
    document = pdf.read_bytes()
    assert document.startswith(b"%PDF") and b"/FontFile2" in document and b"/Subtype /Image" not in document
    drawing = svg.read_text()
    assert all(f"{name}</text>" in drawing for name in plot.PANELS if "$" not in name)
    assert "<image" not in drawing
    # One legend, and the phases of the flight.
    for entry in ("x", "set-point", "reference", "estimated", "true", "rotor 1", "rotor 6"):
        assert drawing.count(f">{entry}</text>") == 1, entry
    assert ">flying</text>" in drawing and ">landing</text>" in drawing
    assert command.main(["plot", str(path), "--out", str(tmp_path / "flight.doc")]) == 2
    assert "pdf" in capsys.readouterr().err


@pytest.mark.real_time
def test_a_plot_shows_an_estimate_from_the_first_pose_on(path):
    """The estimator waits for samples at rest. Before, its state is the origin, where the tool is not."""
    drawn = plot.figure(path)
    position, angles = drawn.axes[0], drawn.axes[1]
    assert position.get_ylabel() == "tool position, m"
    flown = log.read(path, ["/flight", "/truth"])
    rows = len(flown["/flight"]["log_time"])

    def estimated(panel):
        lines = [line for line in panel.get_lines() if line.get_linestyle() == "-"]
        return np.transpose([line.get_ydata() for line in lines if len(line.get_ydata()) == rows])

    place = estimated(position)
    known = np.isfinite(place)
    assert not known[0].any() and known[log.flying(flown["/flight"]["phase"])].all()
    np.testing.assert_array_equal(np.isfinite(estimated(angles)), known)
    # True values are logged more rarely.
    times, truth = flown["/flight"]["log_time"], flown["/truth"]
    for column, seen, true in zip(place.T, known.T, truth["tool_position_w"].T, strict=True):
        np.testing.assert_allclose(
            column[seen], np.interp(times[seen], truth["log_time"], true), rtol=0, atol=0.05
        )


@pytest.mark.real_time
def test_a_plot_is_scaled_to_the_free_flight(path):
    """The ground pushes harder at the landing than anything before it."""
    drawn = plot.figure(path)
    force = next(axes for axes in drawn.axes if axes.get_ylabel() == "tool force, N")
    columns = log.read(path, ["/wrench", "/flight"])
    values = columns["/wrench"]["tool_w.force"]
    free = values[np.isin(columns["/flight"]["phase"], log.FREE_FLIGHT)]
    low, high = force.get_ylim()
    assert low < free.min() < free.max() < high < values.max()
    assert high - low == pytest.approx(1.2 * np.ptp(free))
