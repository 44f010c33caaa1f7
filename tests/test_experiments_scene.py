"""A scene of one's own, as an MJCF file or a Python module: what it puts into the world; what is refused."""

from __future__ import annotations

import html
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the experiments need MuJoCo: pip install 'tilthex[experiments]'")

import matplotlib.pyplot as plt
import mujoco
import tilthex
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from test_experiments_world import world_at
from tilthex import __main__ as command
from tilthex.experiments import own_scene, report, spec, video
from tilthex.experiments.flight import fly
from tilthex.experiments.record import Check
from tilthex.experiments.scenes import Scene
from tilthex.mjcf import ROTOR_RADIUS

BUTTON = """
<mujoco>
  <worldbody>
    <body name="button" pos="0.12 0 0.49">
      <joint name="button" type="slide" axis="0 0 -1" stiffness="1000" damping="20"/>
      <geom name="top" type="box" size="0.05 0.05 0.01" mass="0.05" friction="0.3 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""
WAY = '[[trajectory.waypoint]]\nphase = "stay"\nposition = [0.0, 0.0, 1.0]\n'


def written(folder: Path, scene: str, text: str, keys: str = "") -> spec.Run:
    (folder / scene).write_text(text)
    (folder / "mine.toml").write_text(f'[world]\nscene = "{scene}"\n{keys}\n{WAY}')
    return spec.load(str(folder / "mine.toml")).runs[0]


def test_a_tip_presses_a_button_until_its_spring_bears_the_missing_lift(tmp_path: Path) -> None:
    world = world_at(written(tmp_path, "button.xml", BUTTON).scene(), [0.12, 0.0, 0.5035])
    vehicle, data = world.vehicle, world.data
    # The coordinates of the robot are the first ones, also beside a joint of the scene.
    np.testing.assert_allclose(world.position, [0.12, 0.0, 0.5035] - vehicle.tool_position, atol=1e-12)
    lacking = np.array([0.0, 0.0, 5.0])
    body = np.r_[0.0, 0.0, vehicle.mass * 9.81 - 5.0, -np.cross(vehicle.tool_position, lacking)]
    speeds = np.sqrt(np.linalg.solve(vehicle.allocation, body))
    for _ in range(300):
        data.qvel[:6] *= 0.97
        world.step(speeds)
    wrench, _, _ = world.contact_wrench()
    assert wrench[2] == pytest.approx(5.0, abs=0.5)
    travel = float(data.joint("button").qpos[0])
    assert 1000.0 * travel == pytest.approx(wrench[2] + 0.05 * 9.81, rel=0.05)


@pytest.mark.parametrize("truth", ["exact", "cad"])
def test_the_record_has_the_joints_of_the_scene(tmp_path: Path, truth: str) -> None:
    """A ball falls; the rod of the second vehicle bends, and has joints of its own."""
    ball = """<mujoco><worldbody><body name="ball" pos="3 0 9"><joint type="slide" axis="0 0 1"/>
        <geom size="0.1" mass="1"/></body></worldbody></mujoco>"""
    run = written(tmp_path, "ball.xml", ball)
    record = fly(replace(run, truth=truth, waypoints=(replace(run.waypoints[0], hold=0.2),)))
    assert record.scene_joints.shape == (len(record.time), 1)
    np.testing.assert_allclose(record.scene_joints[:, 0], -0.5 * 9.81 * record.time**2, atol=0.01)
    assert record.scene_joints[-1, 0] < -0.15


def in_picture(points: np.ndarray, camera: mujoco.MjvCamera, size: tuple[int, int]) -> np.ndarray:
    """Where MuJoCo draws points, from -1 (left, bottom) to 1 (right, top): (n, 2)."""
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    scene = mujoco.MjvScene(model, 10)
    options, everything = mujoco.MjvOption(), mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, mujoco.MjData(model), options, None, camera, everything, scene)
    left, right = scene.camera
    at, forward, up = 0.5 * (left.pos + right.pos), left.forward, left.up
    top = left.frustum_top / left.frustum_near
    away = points - at
    across = np.column_stack([away @ np.cross(forward, up) * size[0] / size[1], away @ up])
    return across / (away @ forward)[:, None] / top


@settings(max_examples=25)
@given(
    name=st.sampled_from(tilthex.Vehicle.presets()),
    turned=st.sampled_from([[0.0, 0.0, 0.0], [0.0, -90.0, 0.0], [180.0, 0.0, 0.0]]),
    seed=st.integers(0, 2**32 - 1),
    size=st.sampled_from([(480, 640), (640, 480), (120, 200)]),
)
def test_a_camera_sees_the_whole_vehicle_all_the_time(name, turned, seed, size) -> None:
    vehicle = tilthex.Vehicle.preset(name).replace(tool_rotation_deg=turned)
    draws = np.random.default_rng(seed)
    positions = draws.uniform(-2.0, 2.0, (7, 3))
    rotations = Rotation.from_rotvec(draws.normal(0.0, 0.3, (7, 3))).as_matrix()
    camera = video.camera(vehicle, positions, rotations, size)
    parts = [vehicle.tool_position, *(rotor["position"] for rotor in vehicle.rotors)]
    for rotor in vehicle.rotors:
        side = np.cross(rotor["axis"], [1.0, 0.0, 0.0])
        side *= ROTOR_RADIUS / np.linalg.norm(side)
        front = np.cross(rotor["axis"], side)
        around = np.linspace(0.0, 2.0 * np.pi, 16)[:, None]
        parts.extend(rotor["position"] + np.cos(around) * side + np.sin(around) * front)
    seen = in_picture(np.vstack([positions + rotations @ np.array(part) for part in parts]), camera, size)
    assert 0.6 < np.abs(seen).max() < 1.0
    if turned[1]:
        # It looks along the tool, not against it: what the tool touches does not hide the vehicle.
        forward = rotations.mean(axis=0)[:, 0]
        assert (
            np.cos(np.radians(camera.azimuth)) * forward[0] + np.sin(np.radians(camera.azimuth)) * forward[1]
            > 0.3
        )


def test_a_scene_of_a_module_gets_the_keys_of_the_world(tmp_path: Path) -> None:
    module = f"def scene(size):\n    return {BUTTON!r}.replace('0.05 0.05', f'{{size}} {{size}}')\n"
    run = written(tmp_path, "button.py", module, "size = 0.07\nlook_at = [1.0, 2.0, 3.0]")
    scene = run.scene()
    (_, button) = scene.elements
    geom = button.find("geom")
    assert geom is not None and geom.get("size") == "0.07 0.07 0.01" and geom.get("solref") == "0.004 1"
    assert scene.look_at == (1.0, 2.0, 3.0)
    own = "from tilthex.experiments.scenes import free_air as scene\n"
    assert isinstance(written(tmp_path, "air.py", own).scene(), Scene)
    # An experiment may be flown from another folder than its own.
    assert Path(run.world["scene"]) == tmp_path / "button.py"


def test_files_that_a_scene_names_are_in_its_folder(tmp_path: Path) -> None:
    mesh = '<mujoco><asset><mesh name="m" file="wall.obj" solref="1"/></asset><worldbody/></mujoco>'
    scene = written(tmp_path, "wall.xml", mesh).scene()
    assert scene.extra[0][0].get("file") == str(tmp_path / "wall.obj")


@pytest.mark.parametrize(
    ("name", "text", "keys", "says"),
    [
        ("a.xml", "<mujoco", "", "a.xml is not XML: unclosed token"),
        ("a.xml", "<robot/>", "", "a.xml holds <robot>; expected the model <mujoco>"),
        ("a.xml", "<mujoco><option/><sensor/></mujoco>", "", "a.xml has <option>, <sensor>; expected only"),
        ("a.xml", BUTTON, "size = 1.0", "has the keys size; expected only `look_at` beside"),
        ("a.py", "scene = 3\n", "", "a.py has no function `scene`"),
        ("a.xml", BUTTON.replace("slide", "slip"), "", "MuJoCo refuses the scene: XML Error"),
        ("a.txt", BUTTON, "", "expected one of clamp, free, funnel, plane, plate-with-ledges, or a file"),
    ],
)
def test_what_is_no_scene_is_refused_in_one_sentence(tmp_path, name, text, keys, says):
    run = written(tmp_path, name, text, keys)
    with pytest.raises(ValueError, match=r".+") as refused:
        world_at(run.scene(), [0.0, 0.0, 1.0])
    assert says in str(refused.value) and "\n" not in str(refused.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"gone\.xml'; expected a file that exists"):
        own_scene.load(tmp_path / "gone.xml", {})


def test_a_report_without_checks_says_where_they_come_from() -> None:
    said = report.text_table([])
    assert "a module beside the file" in said and said in report.table([])
    one = Check("error", "at most 1 mm", "", "0.5 mm", True)
    assert "required" in report.text_table([one]) and "no checks" not in report.table([one])
    # The paper's column is there only if the paper has a value.
    assert "paper" not in report.text_table([one]) and "<th>paper" not in report.table([one])
    other = replace(one, paper="2 mm")
    assert "paper" in report.text_table([one, other]) and "<th>paper" in report.table([one, other])


def test_the_report_has_the_files_of_vehicle_and_scene_and_the_changes(tmp_path: Path) -> None:
    (tmp_path / "button.xml").write_text(BUTTON)
    (tmp_path / "own.toml").write_text('[vehicle]\npreset = "tilt-hex"\nname = "my-own"\n')
    (tmp_path / "mine.toml").write_text(
        f'vehicle = "own.toml"\n[world]\nscene = "button.xml"\n{WAY}hold = 0.1\n'
    )
    change = "seed=17"
    call = ["experiment", str(tmp_path / "mine.toml"), "--out", str(tmp_path / "out"), "--set", change]
    assert command.main(call) == 0
    page = html.unescape((tmp_path / "out" / "mine.html").read_text())
    assert BUTTON in page and 'name = "my-own"' in page and f"# --set {change}\n" in page


def test_the_overview_has_one_legend_and_shows_small_motions() -> None:
    run = spec.load("pressing", short=True).runs[0]
    record = fly(run, exact=True)
    figure = report.overview(record)
    panels = figure.axes
    try:
        assert not any(panel.get_legend() for panel in panels)
        [legend] = figure.legends
        assert [text.get_text() for text in legend.get_texts()] == [
            *"xyz",
            *("set-point", "reference", "true", "estimated"),
        ]
        for axis, panel in zip("xyz", panels[:6:2], strict=True):
            assert panel.get_ylabel() == f"tool position {axis}, m"
            low, high = panel.get_ylim()
            drawn = [record.setpoint_position, record.reference_position, record.tool_position]
            span = float(np.ptp([values[:, "xyz".index(axis)] for values in drawn]))
            assert report.LEAST_SPAN - 1e-12 <= high - low <= max(report.LEAST_SPAN, 1.2 * span) + 1e-3
        named = {text.get_text() for text in panels[0].texts}
        assert named and named <= set(record.phases)
    finally:
        plt.close(figure)
