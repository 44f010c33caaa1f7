"""A short version of every experiment, with the complete chain in the loop."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the experiments need MuJoCo: pip install 'tilthex[experiments]'")

from tilthex import __main__ as command
from tilthex.experiments import flight, peg_in_hole, spec
from tilthex.experiments.flight import fly
from tilthex.experiments.found import judge_of
from tilthex.experiments.record import Record


@pytest.mark.parametrize("name", spec.built_in())
def test_the_short_version_passes_what_it_checks(name: str) -> None:
    experiment = spec.load(name, short=True)
    judged = judge_of(experiment)
    checked = 0
    for run in experiment.runs:
        record = fly(run)
        assert record.ended == ""
        for check in judged.checks(run, record):
            assert check.passed is not False, check
            checked += check.passed is not None
        assert np.all(np.isfinite(record.tool_position))
    assert checked > 0


def test_an_attempt_that_misses_is_judged_a_failure() -> None:
    """The judging can fail: the path beside the funnel, and the wrist of Table 2."""
    stiff = spec.load("peg-in-hole", changes={"world": {"tilt_deg": 12.0}}).runs[1]
    record = fly(stiff, exact=True)
    found = peg_in_hole.insertion(stiff, record)
    assert not found.succeeded
    assert found.inserted_at is None
    assert 0.005 < found.depth < 0.03


def test_the_command_writes_a_report(tmp_path: Path) -> None:
    call = [sys.executable, "-m", "tilthex", "experiment", "chirp", "--short", "--out", str(tmp_path)]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "chirp.html").read_text()
    assert "at most 10 %" in page
    assert "data:image/png;base64," in page
    assert (tmp_path / "chirp-chirp.png").exists()
    assert len(Record.load(tmp_path / "chirp-chirp.npz").time) > 1000
    # Progress is for a terminal.
    assert done.stderr == ""
    assert not [path for path in tmp_path.iterdir() if set(path.name) & set(" =()&;")]


@pytest.mark.parametrize("name", spec.built_in())
def test_a_flight_that_is_thrown_away_falls_short(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(flight, "FAR", 1e-9)
    command.main(["experiment", name, "--short", "--out", str(tmp_path)])
    shown = capsys.readouterr()
    table = [line for line in shown.out.splitlines() if "flown to its end" in line]
    assert len(table) == len(spec.load(name, short=True).runs) and not shown.err
    assert all(line.startswith("FALLS SHORT") and "thrown" in line for line in table)
    assert (tmp_path / f"{name}.html").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["slidign"], "no experiment 'slidign'"),
        (["sliding", "--random", "3"], "--random needs an experiment with random cases; sliding has none"),
        (["peg-in-hole", "--case", "3"], "--random"),
        (["sliding", "--set", "world.friction"], "--set world.friction"),
        (["sliding", "--set", "vehicle=hexarotor"], "a text has quotes: 'vehicle=\"hexarotor\"'"),
    ],
)
def test_wrong_use_is_refused_in_one_sentence(arguments: list[str], said: str, tmp_path: Path) -> None:
    call = [sys.executable, "-m", "tilthex", "experiment", *arguments, "--out", str(tmp_path)]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
