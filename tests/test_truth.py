"""A vehicle that is not its model: what is drawn, flown and named, and vehicles of one's own everywhere."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import tilthex
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

VEHICLE = tilthex.Vehicle.preset("tilt-hex")
CONFIG = tilthex.Config.default(VEHICLE)
HOME = tilthex.Setpoint([0, 0, 1], np.eye(3))


def held(truth, **keys):
    """The last 4 s of a hover of 12 s."""
    run = tilthex.simulate(CONFIG, duration=12, setpoint=HOME, truth=truth, **keys)
    return {name: array[-2000:] for name, array in run.items()}


def test_an_exact_truth_flies_as_none_at_all():
    flights = [
        tilthex.simulate(CONFIG, duration=0.5, setpoint=HOME, seed=3, truth=t) for t in (None, "exact", {})
    ]
    for flight in flights[1:]:
        assert all(flight[name].tobytes() == flights[0][name].tobytes() for name in flights[0])


@given(st.integers(0, 2**32), st.sampled_from(tilthex.Truth.levels()))
@settings(max_examples=40)
def test_a_seed_is_a_vehicle(seed, level):
    truth = tilthex.Truth(VEHICLE, level)
    assert truth.name == level
    drawn, again = truth.draw(seed), truth.draw(seed)
    assert drawn.to_toml() == again.to_toml()
    assert drawn.vehicle.to_toml() == again.vehicle.to_toml()
    assert_allclose(drawn.vehicle.allocation, VEHICLE.allocation, rtol=1.0, atol=1e-4)
    # What is fixed to the airframe stays there: the captured point is the model's centre of mass.
    assert_allclose(drawn.sensor_errors().captured, -drawn.centre_of_mass, atol=0)


@pytest.mark.parametrize("seed", [11, 12])
def test_a_wrong_mass_is_seen_as_its_weight(seed):
    """Missing weight pulls up as an unknown force does; the truth of the contact is zero."""
    end = held({"error": {"mass": 0.02}}, seed=seed)
    assert not end["wrench_true"].any()
    assert_allclose(end["wrench_tool"][:, :3].mean(axis=0), [0, 0, -0.02 * 2.4 * 9.81], atol=0.02)


def test_what_is_drawn_is_what_flies():
    truth, seed = tilthex.Truth(VEHICLE, "cad"), 5
    drawn = truth.draw(seed)
    end = held(truth, seed=seed, noise=0.0, estimator=False)
    # Still: the true rotors carry the true weight.
    wrench = drawn.vehicle.allocation @ (end["rotor_speeds"].mean(axis=0) ** 2)
    assert_allclose(np.linalg.norm(wrench[:3]), drawn.vehicle.mass * 9.81, rtol=2e-3)


def test_wind_blows_as_its_drag_says():
    """Held in a steady wind the observer reports the drag, in the wind's direction."""
    truth = {
        "aerodynamics": {"wind_speed": 3.0, "wind_direction_deg": 90, "drag_area": [0.03, 0.03, 0.03]},
    }
    end = held(truth, noise=0.0, estimator=False)
    drag = 0.5 * 1.225 * 0.03 * 9.0
    force = end["wrench_tool"][:, :3].mean(axis=0)
    assert_allclose(force, [0, drag, 0], atol=0.02 * drag + 1e-3)


def test_the_plant_in_python_takes_the_effects():
    truth = {"aerodynamics": {"rotor_drag": 3e-4}}
    effects = tilthex.Truth(VEHICLE, truth).draw(0).effects()
    plant = tilthex.Plant(VEHICLE, effects=effects)
    velocity = np.array([0.7, -0.4, 0.0])
    plant.set_state(velocity=velocity)
    axes = np.array([rotor["axis"] for rotor in VEHICLE.rotors])
    in_disc = velocity - axes * (axes @ velocity)[:, None]
    expected = -(3e-4 * plant.rotor_speeds[:, None] * in_disc).sum(axis=0)
    assert_allclose(plant.effects_wrench[:3], expected, rtol=1e-12)
    state = (np.zeros(3), velocity, np.eye(3), np.zeros(3), plant.rotor_speeds, np.zeros(6))
    assert_allclose(effects.step(*state, 1e-3), plant.effects_wrench, rtol=1e-12)


def test_gusts_differ_from_seed_to_seed_and_not_within_one():
    truth = tilthex.Truth(VEHICLE, {"aerodynamics": {"gust_deviation": 1.0, "wind_speed": 3.0}})
    still = (np.zeros(3), np.zeros(3), np.eye(3), np.zeros(3), np.zeros(6), np.zeros(6))

    def wind(seed):
        effects = truth.draw(seed).effects()
        for _ in range(50):
            effects.step(*still, 1e-2)
        return effects.wind

    assert_allclose(wind(4), wind(4), atol=0)
    assert np.abs(wind(4) - wind(5)).max() > 1e-3


@pytest.mark.parametrize(
    ("truth", "said"),
    [
        ("cda", "unknown level `cda`; the nearest known one is `cad`"),
        ({"eror": {}}, "unknown key `eror`; the nearest known one is `error`"),
        ({"error": {"mass": {"std": -1}}}, "std 0 or above"),
        ({"aerodynamics": {"wind_speed": "much"}}, "[truth.aerodynamics]"),
        ("nowhere.toml", "nowhere.toml"),
        (3, "truth is a int"),
    ],
)
def test_a_wrong_truth_is_refused_in_one_sentence(truth, said):
    with pytest.raises((ValueError, TypeError)) as refused:
        tilthex.simulate(CONFIG, duration=0.1, setpoint=HOME, truth=truth)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_vehicle_prints_and_reads_as_itself(tmp_path):
    for name in tilthex.Vehicle.presets():
        vehicle = tilthex.Vehicle.preset(name)
        path = tmp_path / f"{name}.toml"
        path.write_text(vehicle.to_toml())
        again = tilthex.Vehicle.named(str(path))
        assert again.to_toml() == vehicle.to_toml()
        assert_allclose(again.allocation, vehicle.allocation, atol=0)
        columns = [
            np.r_[c := np.array(r["axis"]) * r["thrust_coefficient"], np.cross(r["position"], c)]
            + r["spin"] * r["drag_coefficient"] * np.r_[0, 0, 0, r["axis"]]
            for r in vehicle.rotors
        ]
        assert_allclose(np.array(columns).T, vehicle.allocation, atol=1e-18, rtol=1e-12)
    assert VEHICLE.replace(mass=3.0, tool_position=[0, 0, -0.2]).mass == 3.0


OWN = """
[vehicle]
preset = "tilt-hex"
name = "own"
mass = 2.2
tool_position = [0.0, 0.0, -0.35]
"""


@pytest.fixture
def own(tmp_path: Path) -> Path:
    path = tmp_path / "own.toml"
    path.write_text(OWN)
    return path


def test_an_experiment_flies_a_vehicle_of_ones_own(own: Path) -> None:
    pytest.importorskip("mujoco")
    from tilthex.experiments import spec

    text = spec.load("shaping").text.replace('vehicle = "tilt-hex"', 'vehicle = "own.toml"')
    path = own.parent / "mine.toml"
    path.write_text(text)
    [run, *_] = spec.load(str(path)).runs
    assert run.model().name == "own" and run.model().mass == 2.2
    # A key of the vehicle alone leaves its others; another name replaces all.
    [heavier, *_] = spec.load(str(path), changes={"vehicle": {"mass": 2.5}}).runs
    assert (heavier.model().mass, heavier.model().name) == (2.5, "own")
    [other, *_] = spec.load(str(path), changes={"vehicle": "hexarotor"}).runs
    assert other.model().name == "hexarotor"
    [built_in, *_] = spec.load("shaping", changes={"vehicle": str(own), "truth": "cad"}).runs
    assert built_in.model().name == "own"
    assert built_in.truth_name() == f"truth cad, drawn with seed {built_in.seed}"
    [keys, *_] = spec.load("shaping", changes={"truth": {"level": "cad", "error": {"mass": 0.0}}}).runs
    assert keys.drawn().vehicle.mass == keys.model().mass


def test_rotor_discs_are_drawn_where_the_rotors_are() -> None:
    mujoco = pytest.importorskip("mujoco")
    vehicle = tilthex.Vehicle.preset("coaxial-tilt-hex")
    model = mujoco.MjModel.from_xml_string(vehicle.to_mjcf())
    discs = model.geom_pos[model.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER]
    expected = [np.array(r["position"]) + 0.002 * np.array(r["axis"]) for r in vehicle.rotors]
    assert_allclose(discs, expected, atol=1e-12)


def hover_in_a_world(truth, seconds=3.0, noise=False):
    """The true wrench that the rotors and the effects exert in a free hover in MuJoCo, and the world."""
    pytest.importorskip("mujoco")
    from tilthex.experiments.scenes import free_air
    from tilthex.experiments.world import PERIOD, Noise, World

    drawn = tilthex.Truth(VEHICLE, truth).draw(7)
    quiet = Noise(0.0, 0.0, 0.0, 0.0, 0.0, pose_jitter=0.0)
    world = World(
        drawn.vehicle,
        free_air(),
        quiet,
        seed=7,
        tool_position=HOME.position,
        tool_rotation=HOME.rotation,
        drawn=drawn,
    )
    chain = tilthex.Loop(CONFIG)
    chain.initialize(0.0, world.captured_position, world.rotation)
    command = drawn.vehicle.hover_speeds()
    for _ in range(round(seconds / PERIOD)):
        world.step(command)
        command = chain.step(
            world.time,
            world.gyro(),
            world.specific_force(),
            world.measured_rotor_speeds(),
            world.arrived_poses(),
            HOME,
        )
    return world, chain


def test_the_mujoco_world_blows_as_the_plant_does():
    truth = {"aerodynamics": {"wind_speed": 3.0, "drag_area": [0.05, 0.05, 0.05]}}
    _, chain = hover_in_a_world(truth, seconds=8.0)
    world_says = chain.record()["wrench_tool"][-1000:].mean(axis=0)
    plant_says = held(truth, noise=0.0, seed=7)["wrench_tool"].mean(axis=0)
    drag = 0.5 * 1.225 * 0.05 * 9.0
    assert_allclose(world_says[:3], [drag, 0, 0], atol=0.03)
    assert_allclose(world_says, plant_says, atol=0.03)


def test_the_mujoco_world_flies_the_drawn_vehicle():
    world, chain = hover_in_a_world("cad", seconds=8.0)
    drawn = tilthex.Truth(VEHICLE, "cad").draw(7)
    assert world.vehicle.mass == drawn.vehicle.mass
    # The same vehicle in the plant of the core shows the observer the same wrench.
    plant_says = held("cad", noise=0.0, seed=7)["wrench_tool"].mean(axis=0)
    world_says = chain.record()["wrench_tool"][-1000:].mean(axis=0)
    assert np.linalg.norm(plant_says[:3]) > 0.1
    assert_allclose(world_says, plant_says, atol=0.03)


def test_the_command_names_the_truth_in_its_report(tmp_path: Path, own: Path) -> None:
    pytest.importorskip("mujoco")
    call = [sys.executable, "-m", "tilthex", "experiment", "shaping", "--short", "--truth", "measured"]
    call += ["--vehicle", str(own), "--seed", "21", "--out", str(tmp_path / "out")]
    done = subprocess.run(call, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "out" / "shaping.html").read_text()
    assert "truth measured, drawn with seed 21" in page
    assert "[truth.sensors]" in page and "Drawn with seed 21" in page


def test_a_vehicle_with_a_rod_that_bends_weighs_and_turns_as_without() -> None:
    mujoco = pytest.importorskip("mujoco")
    from tilthex.mjcf import Rod, to_mjcf

    for name in ("tilt-hex", "omnidirectional-octorotor"):
        vehicle = tilthex.Vehicle.preset(name)
        model = mujoco.MjModel.from_xml_string(to_mjcf(vehicle, rod=Rod(1000.0, 0.4)))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        assert model.body_subtreemass[0] == pytest.approx(vehicle.mass, rel=1e-12)
        assert_allclose(data.subtree_com[0], data.qpos[:3], atol=1e-12)
        inertia = np.zeros((3, model.nv))
        for column, turn in zip(inertia, np.eye(model.nv)[3:6], strict=True):
            mujoco.mj_mulM(model, data, column, turn)
        assert_allclose(inertia[:, 3:6], vehicle.inertia, atol=1e-12)
        tool = data.site("tool")
        assert_allclose(tool.xpos, data.qpos[:3] + vehicle.tool_position, atol=1e-12)
        assert_allclose(tool.xmat.reshape(3, 3), vehicle.tool_rotation, atol=1e-12)


def test_a_rod_in_a_world_bends_as_its_stiffness_says() -> None:
    """Pushed sideways where the robot is held still: the tip moves by force over stiffness."""
    pytest.importorskip("mujoco")
    from tilthex.experiments.scenes import free_air
    from tilthex.experiments.world import Noise, World

    drawn = tilthex.Truth(VEHICLE, {"structure": {"tool_stiffness": 1000.0, "tool_length": 0.4}}).draw(0)
    quiet = Noise(0.0, 0.0, 0.0, 0.0, 0.0)
    home = {"tool_position": np.array([0.0, 0.0, 1.0]), "tool_rotation": np.eye(3)}
    world = World(drawn.vehicle, free_air(), quiet, seed=1, drawn=drawn, **home)
    # So heavy that only the rod moves.
    world.model.dof_armature[:6] = 1e9
    world.push = np.array([2.0, -1.0, 0.0])
    for _ in range(2000):
        world.step(drawn.vehicle.hover_speeds())
    moved = world.tool_position - home["tool_position"]
    assert_allclose(moved[:2], [2e-3, -1e-3], rtol=0.002, atol=1e-6)
    assert abs(moved[2]) < 1e-4


def test_the_world_behind_the_wire_greets_with_what_was_drawn() -> None:
    """The board has the errors of the vehicle in the world; the configuration has the model."""
    pytest.importorskip("mujoco")
    from tilthex.experiments import spec
    from tilthex.experiments.world_process import GREETING, MAGIC

    call = [sys.executable, "-m", "tilthex.experiments.world_process", "sliding"]

    def greeting(*more: str) -> tuple[float, ...]:
        done = subprocess.run(call + list(more), input=b"", capture_output=True, check=True, timeout=120)
        magic, *numbers = GREETING.unpack(done.stdout[: GREETING.size])
        assert magic == MAGIC
        return tuple(numbers)

    drawn = tilthex.Truth(VEHICLE, "outdoors").draw(4)
    said, exact = greeting("--level", "outdoors", "--seed", "4"), greeting()
    noise = spec.load("sliding").runs[0].noise
    for numbers in (said, exact):
        assert numbers[:3] == (6.0, VEHICLE.mass, noise.position)
        assert numbers[-3] == noise.pose_period
    assert_allclose(said[13:24], drawn.sensor_errors().constants[6:], atol=0)
    assert not any(exact[13:24])


@pytest.mark.parametrize(("age", "lag_error"), [(0.004, 0.0), (0.012, 0.1)])
def test_rotor_speeds_whose_age_is_known_are_no_contact(age, lag_error):
    """Old speeds look like contact where the vehicle accelerates; brought to the sample's time they do
    not, also where the rotors' lag is known to 10 % only."""
    way = [{"position": [x, 0, 1], "rotation": np.eye(3)} for x in (0.0, 1.0, 0.0)]
    there_and_back = tilthex.Trajectory(way, velocity=0.8, acceleration=3.0)
    truth = {"delays": {"rotor_speeds": age}, "error": {"rotor_lag": lag_error}}

    def largest(known):
        run = tilthex.simulate(
            CONFIG.replace(link={"rotor_speed_age": known}, mission={"bias_time": 0.0}),
            duration=there_and_back.duration,
            trajectory=there_and_back,
            truth=truth,
            noise=0.0,
            estimator=False,
        )
        sizes = np.abs(run["wrench_tool"])
        return np.array([sizes[:, :3].max(), sizes[:, 3:].max()])

    taken_as_it_comes, brought = largest(0.0), largest(age)
    assert np.all(taken_as_it_comes > [0.04, 0.015])
    part = 0.01 if lag_error == 0.0 else 0.25
    assert np.all(brought < part * taken_as_it_comes), (taken_as_it_comes, brought)
