"""Files of experiments, random cases, and the stability bound."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("mujoco", reason="the experiments need MuJoCo: pip install 'tilthex[experiments]'")

from tilthex.experiments import peg_in_hole, spec
from tilthex.experiments.found import judge_of
from tilthex.experiments.stability import Chain, growth, least_damping


@pytest.mark.parametrize("name", spec.built_in())
@pytest.mark.parametrize("short", [False, True])
def test_every_built_in_experiment_loads(name: str, short: bool) -> None:
    experiment = spec.load(name, short=short)
    assert experiment.runs
    assert judge_of(experiment).checks.__module__ == f"tilthex.experiments.{name.replace('-', '_')}"
    for run in experiment.runs:
        run.scene()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[world]", "[wrold]", "unknown key `wrold`; the nearest known one is `world`"),
        ("hold = 3.0", "hodl = 3.0", "the nearest known one is `hold`"),
        ('scene = "plane"', 'scene = "plain"', "expected one of clamp, free, funnel, plane"),
        ("friction = 0.2", "fricton = 0.2", "fricton"),
        ("friction = 0.2", "friction = -0.3", "world.friction is -0.3; expected a number from 0 to 10"),
        ("friction = 0.2", "friction = nan", "world.friction is nan; expected a number"),
        ("point = [0.0", "point = [inf", "world.point is inf; expected a number that is finite"),
        ("velocity = 0.12", "velocity = -0.12", "trajectory.velocity is -0.12; expected a number from"),
        ("hold = 3.0", "hold = -3.0", "trajectory.waypoint.hold is -3.0; expected a number from 0"),
        ("[world]", "[noise]\ngyro = -1.0\n[world]", "noise.gyro is -1.0; expected a number from 0"),
        ("[world]", "[world", "line"),
    ],
)
def test_a_wrong_file_is_refused_in_one_sentence(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = spec.load("sliding").text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ValueError, match=r".+") as refused:
        for run in spec.load(str(path)).runs:
            run.scene()
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


OWN_JUDGE = """
from tilthex.experiments.judge import Judge
from tilthex.experiments.record import Check

JUDGE = Judge(lambda run, record: [Check("own", "", "", run.name, True)], lambda flights: {})
"""


def test_an_own_experiment_is_judged_by_the_module_beside_it(tmp_path: Path) -> None:
    text = (Path(spec.__file__).parent / "sliding.toml").read_text()
    own = tmp_path / "my-slide.toml"
    own.write_text(text.replace('experiment = "sliding"\n', ""))
    experiment = spec.load(str(own))
    # Without a module nothing is judged.
    assert judge_of(experiment).checks(experiment.runs[0], None) == []  # type: ignore[arg-type]
    (tmp_path / "my_slide.py").write_text(OWN_JUDGE)
    checks = judge_of(experiment).checks(experiment.runs[0], None)  # type: ignore[arg-type]
    assert [check.what for check in checks] == ["own"]
    (tmp_path / "my_slide.py").write_text("JUDGE = 3\n")
    with pytest.raises(ValueError, match=r"my_slide\.py: JUDGE is 3; expected a"):
        judge_of(experiment)
    # A file may name a built-in experiment that judges it; an unknown one is refused.
    own.write_text(text)
    assert judge_of(spec.load(str(own))).checks.__module__ == "tilthex.experiments.sliding"
    own.write_text(text.replace('"sliding"', '"slidign"', 1))
    with pytest.raises(ValueError, match="experiment = 'slidign': found neither"):
        judge_of(spec.load(str(own)))


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(
        ValueError, match="chirp, multi-contact, peg-in-hole, pressing, shaping, sliding, all"
    ):
        spec.load("slidign")


def test_changes_win_over_runs_and_runs_over_the_file() -> None:
    changed = spec.load("sliding", changes={"world": {"friction": 0.11}, "seed": 9})
    assert {run.world["friction"] for run in changed.runs} == {0.11}
    assert {run.seed for run in changed.runs} == {9}
    plain = {run.name: run for run in spec.load("sliding").runs}
    assert plain["K_y = 10"].config["admittance"]["stiffness"][1] == 10.0
    assert plain["K_y = 2.5"].config["admittance"]["stiffness"][1] == 2.5
    assert plain["K_y = 10"].config["admittance"]["mass"] == plain["K_y = 2.5"].config["admittance"]["mass"]


@given(seed=st.integers(0, 2**31), index=st.integers(0, 10_000))
def test_random_cases_are_reproducible_and_within_their_ranges(seed: int, index: int) -> None:
    run = spec.load("peg-in-hole").runs[0]
    case = peg_in_hole.draw(run, seed, index)
    assert case == peg_in_hole.draw(run, seed, index)
    assert 5.0 <= case.world["tilt_deg"] <= 20.0
    assert 0.05 <= case.world["friction"] <= 0.3
    scene = case.scene()
    mouth = scene.origin + 0.012 * scene.rotation[:, 2]
    path = np.array(run.waypoints[0].position[:2])
    assert np.linalg.norm(mouth[:2] - path) <= 0.008 + 1e-12


def test_the_directions_of_random_cases_cover_the_circle() -> None:
    run = spec.load("peg-in-hole").runs[0]
    cases = [peg_in_hole.draw(run, 1, i) for i in range(100)]
    counts, _ = np.histogram([c.world["direction_deg"] for c in cases], bins=4, range=(-180.0, 180.0))
    assert counts.min() > 10
    assert len({c.seed for c in cases}) == 100


@given(
    gain=st.floats(5.0, 100.0),
    stiffness=st.floats(5.0, 100.0),
    part=st.floats(0.05, 0.8),
)
def test_less_damping_than_the_bound_is_unstable(gain: float, stiffness: float, part: float) -> None:
    """The bound is necessary: below it, the poles of the full linear loop grow."""
    chain = Chain(observer_gain=gain)
    damping = part * least_damping(chain, stiffness)
    low = replace(chain, rotation=(1e-4, damping, 0.05))
    height = 0.045
    walls = ((0.0, 1e5, 200.0), (height, stiffness / height**2, 0.0))
    assert growth(low, walls) > 0.0


def test_the_parameters_of_the_experiment_are_stable_and_those_seen_to_shake_are_not() -> None:
    walls = ((0.0, 1e5, 200.0), (0.045, 2e4, 0.0))
    assert growth(Chain(), walls) < 0.0
    for gain in (10.0, 30.0):
        assert growth(Chain(observer_gain=gain, rotation=(0.01, 0.5, 0.05)), walls) > 0.0


def test_free_flight_is_stable() -> None:
    assert growth(Chain(), ()) <= 1e-9
    assert growth(Chain(low_pass_hz=5.0), ()) <= 1e-9
