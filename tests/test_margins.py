"""The linear model of the loop, and `tilthex check`."""

from __future__ import annotations

import doctest
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import tilthex
from tilthex import __main__ as command
from tilthex import check, stability
from tilthex.experiments.stability import TIP_DAMPING, Chain, growth

from benchmarks import contact_stability

PLANE = {"preset": "tilt-hex", "tool_position": [0, 0, -0.4], "inertia": [0.0115, 0.0115, 0.0194]}
STIFF_TIP = 1e5


@pytest.mark.parametrize(
    ("gain", "low_pass", "damping"), [(30.0, 0.0, 1.5), (30.0, 5.0, 1.5), (100.0, 0.0, 1.5), (10.0, 0.0, 3.0)]
)
def test_a_held_tool_has_the_border_of_the_chain_in_the_plane(gain, low_pass, damping):
    """Six axes without delays in a plane of symmetry: the 14 states of `Chain`, which were derived apart."""
    config = tilthex.Config.default(tilthex.Vehicle.from_dict(PLANE)).replace(
        pose_control={
            "position_gain": 16.0,
            "velocity_gain": 8.0,
            "rotation_gain": 100.0,
            "angular_velocity_gain": 20.0,
        },
        wrench_observer={"force_gain": gain, "torque_gain": gain},
        admittance={
            "mass": [1.5] * 3 + [0.01] * 3,
            "damping": [10.0] * 3 + [damping] * 3,
            "stiffness": [6.0] * 3 + [0.05] * 3,
            "low_pass_hz": low_pass,
        },
    )
    model = tilthex.LoopModel(config, loop_delay=0.0, rotor_speed_age=0.0, period=5e-5)
    border = model.contact(about=[0, 1, 0], tip=(STIFF_TIP, TIP_DAMPING))[0][1]
    chain = replace(Chain(), observer_gain=gain, low_pass_hz=low_pass, rotation=(0.01, damping, 0.05))

    def rate(stiffness: float) -> float:
        # Touched at the height of the centre of mass, where the lateral spring is weak beside the tip's.
        return growth(chain, ((0.0, STIFF_TIP, TIP_DAMPING), (0.4, stiffness / 0.4**2, 0.0)))

    assert rate(0.96 * border) < 0.0 < rate(1.04 * border)


def test_the_margins_of_drawn_vehicles_are_around_the_models():
    config = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
    nominal = tilthex.LoopModel(config).hover()
    exact = tilthex.LoopModel(config, truth="exact").hover()
    assert np.allclose(exact["phase_margin_deg"], nominal["phase_margin_deg"])
    spread = check.drawn(config, "measured", 4)
    below = nominal["phase_margin_deg"] - spread.phase_margin_deg
    assert ((below > 0.0) & (below < 15.0)).all() and spread.unstable == 0
    late = tilthex.LoopModel(config, loop_delay=0.024).hover()
    lost = np.degrees(0.02 * nominal["crossover"])
    assert np.allclose(nominal["phase_margin_deg"] - late["phase_margin_deg"], lost, atol=3.0)


def test_margins_are_those_of_the_model_and_of_stiffer_gains():
    config = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
    found, model = tilthex.margins(config), tilthex.LoopModel(config)
    assert found.stable and found.axes == model.axes
    assert np.allclose(np.degrees(found.phase_margin), model.hover()["phase_margin_deg"])
    assert found.contact_stiffness[2] == model.contact(along=[0, 0, 1])
    assert found.contact_stiffness[4] == model.contact(about=[0, 1, 0])
    derived = tilthex.margins(config.replace(**model.derive()))
    assert np.degrees(derived.phase_margin.min()) > 45.0 and derived.sensitivity_peak.max() < 2.0
    assert doctest.testmod(stability) == (0, 4)
    tight = config.replace(pose_control={"rotation_gain": 3000.0, "angular_velocity_gain": 200.0})
    assert not tilthex.margins(tight).stable


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"along": [1, 0, 0], "about": [1, 0, 0]}, "along and about .* expected exactly one"),
        ({}, "along and about .* expected exactly one"),
        ({"along": [0, 0, 0]}, "along is zero; expected a direction"),
        ({"along": [1, 0, 0], "damping_time": -1.0}, "damping_time is -1; expected a number from 0 to 10"),
    ],
)
def test_what_is_no_contact_is_refused(arguments, sentence):
    model = tilthex.LoopModel(tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex")))
    with pytest.raises(ValueError, match=sentence):
        model.contact(**arguments)


def test_check_prints_and_plots(tmp_path):
    config = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
    hard = config.replace(pose_control={"rotation_gain": 900.0, "angular_velocity_gain": 60.0})
    (tmp_path / "hard.toml").write_text(hard.to_toml())
    command = [sys.executable, "-m", "tilthex", "check", "hard.toml", "--draws", "1", "--plot", "loops.png"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    low = [line.split()[0] for line in done.stdout.splitlines() if line.endswith("<- low")]
    assert {"roll", "pitch", "yaw"} <= set(low)
    assert "low: a phase margin below 45 deg" in done.stdout and "`tilthex tune`" in done.stdout
    assert "along x" in done.stdout and "the tip pushes" in done.stdout
    assert (tmp_path / "loops.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("found", "words", "up_to"),
    [
        ([], "no stiffness is stable", "no stiffness"),
        ([(0.0, 1e6)], "stable at any stiffness", "any stiffness"),
        ([(0.0, 1642.0)], "stable up to 1640 N/m", "1640 N/m"),
        (
            [(0.0, 344.0), (6920.0, 1e6)],
            "stable up to 344 N/m and above 6920 N/m",
            "344 N/m",
        ),
        ([(20.0, 80.0)], "stable from 20 to 80 N/m", "no stiffness"),
    ],
)
def test_ranges_of_stiffness_are_words(found, words, up_to):
    assert check._ranges(found, "N/m") == words
    assert check.border(found, "N/m") == up_to


def test_a_contact_that_is_not_stable_says_what_helps():
    contact = {
        "damping_time": 1e-3,
        "along": {},
        "along_undamped": {},
        "worst": {"direction": np.eye(3)[0], "stable": []},
        "about": {},
        "stiffness": 5e3,
        "least_apparent_mass": {"x": np.inf, "y": 0.3},
    }
    *_, along_x, along_y = check._contact(contact)
    assert along_x.endswith("a larger damping of [admittance] helps")
    assert along_y.endswith("unstable below an apparent mass of 0.3 kg")


def test_tuned_gains_are_toml_with_reasons_that_reads_back(capsys):
    config = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
    assert command.main(["tune", "tilt-hex"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("# Derived by `tilthex tune` for tilt-hex")
    tuned = tilthex.Config.from_text(f'[vehicle]\npreset = "tilt-hex"\n{printed}')
    assert tuned == config.replace(**tilthex.LoopModel(config).derive()) != config
    found = tilthex.LoopModel(tuned).hover()
    assert found["phase_margin_deg"].min() >= check.LEAST_PHASE_MARGIN
    assert found["sensitivity_peak"].max() <= check.LARGEST_PEAK


@pytest.mark.parametrize("seed", [7112, 7115])
def test_flown_contact_ends_where_the_model_says(seed):
    border, flown = contact_stability.judge(contact_stability.draw(seed))
    assert 200.0 < border < 50e3
    assert [grown for _, _, grown in flown] == [False, True]
