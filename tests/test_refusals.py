"""What a file or an answer has wrong is said in one sentence, where it is wrong, and loses no flight."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import numpy as np
import pytest
import tilthex
from tilthex import __main__ as command

HEAVY = '[vehicle]\npreset = "tilt-hex"\nmass = 12.0\n'
WAYS = """
[[trajectory.waypoint]]
phase = "stay"
position = [0.0, 0.0, 1.0]

[[trajectory.waypoint]]
phase = "on"
hold = 0.2
"""


class Terminal(io.StringIO):
    """Answers that somebody types."""

    def isatty(self) -> bool:
        return True


def status(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    """The exit status of `tilthex`, and the last line that it says on standard error."""
    found = command.main([*map(str, arguments)])
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) <= 1
    return found, lines[-1] if lines else ""


@pytest.mark.parametrize("key", ["mass = 12.0", "tilted_hexarotor.thrust_coefficient = 1.6"])
def test_a_vehicle_that_cannot_hover_is_refused_by_every_command(
    key: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mujoco")
    (tmp_path / "mine.toml").write_text(HEAVY.replace("mass = 12.0", key))
    (tmp_path / "own.toml").write_text('vehicle = "mine.toml"\n' + WAYS)
    with pytest.raises(ValueError, match=r"cannot hover") as refused:
        tilthex.Config.from_toml(tmp_path / "mine.toml").check_hover()
    assert "rotor " in str(refused.value) and "thrust_coefficient (N/Hz^2)" in str(refused.value)
    for arguments in (("check", "mine.toml"), ("tune", "mine.toml"), ("experiment", "own.toml")):
        said = status(capsys, arguments[0], tmp_path / arguments[1])
        assert said == (2, f"tilthex: {refused.value}")


def test_a_new_vehicle_that_cannot_hover_is_written_with_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n12\n"))
    assert command.main(["new", "vehicle", str(tmp_path / "mine.toml")]) == 0
    assert "warning: [vehicle]: it cannot hover: " in capsys.readouterr().err
    text = (tmp_path / "mine.toml").read_text()
    assert "It cannot hover" in text and tilthex.Vehicle.from_toml(tmp_path / "mine.toml").mass == 12.0


def test_a_terminal_is_asked_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    inertia, position = "0.9\n0.01\n0.01\n0.03\n0.03\n0.05\n", "35\n0.3\n0\n0\n"
    rotors = "-0.3\n0.3\n30\n10\n-1\n0.0016\n-2\n0.00003\n1\n9000\n90\n"
    answers = f"wasp\n-3\nheavy\n3.2\n{inertia}7\n0.04\n{position}aside\nforward\n{rotors}"
    monkeypatch.setattr(sys, "stdin", Terminal(answers))
    assert command.main(["new", "vehicle", str(tmp_path / "mine.toml")]) == 0
    said = capsys.readouterr().err
    for sentence in (
        "mass is -3",
        "'heavy'; expected a number",
        "principal moments",
        "rotor_time_constant is 7",
        "tool_position is 35.0000 m",
        "is 'aside'; expected one of",
        "arm is -0.3",
        "thrust_coefficient = -1",
        "drag_coefficient = -2",
        "up to 9000 Hz",
    ):
        assert sentence in said
    made = tilthex.Vehicle.from_toml(tmp_path / "mine.toml")
    assert (made.mass, made.rotor_time_constant) == (3.2, 0.04)
    assert made.tool_position.tolist() == [0.3, 0.0, 0.0] and made.inertia[0, 0] == 0.03
    np.testing.assert_array_equal(made.rotor_speed_limits[0], [1.0, 90.0])
    monkeypatch.setattr(sys, "stdin", Terminal("\nnone.toml\n\nshelf\nfree\n\n\n"))
    assert command.main(["new", "experiment", str(tmp_path / "own.toml")]) == 0
    said = capsys.readouterr().err
    assert "cannot read the file" in said and "scene is 'shelf'" in said


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("hold = 0.2", 'duration = "5 s"', "waypoint]] 2: duration is '5 s'; expected a number, in s"),
        ("hold = 0.2", "hodl = 0.2", "[[trajectory.waypoint]] 2: unknown key `hodl`"),
        ("hold = 0.2", "rpy_deg = 90", "2: rpy_deg is 90; expected 3 numbers, in degrees"),
        ("hold = 0.2", "wrench = [1, 2]", "2: wrench is [1, 2]; expected 6 numbers, in N and N m"),
        ("hold = 0.2", 'force_axes = "z"', "2: force_axes is 'z'; expected a list of axes"),
        ("[0.0, 0.0, 1.0]", "[0.0, 1.0]", "1: position is [0.0, 1.0]; expected 3 numbers, in m"),
        ("[0.0, 0.0, 1.0]", '["0", 0, 1]', "1: position is ['0', 0, 1]; expected 3 numbers, in m"),
        ('"stay"', "3", "1: phase is 3; expected a text"),
        ("[[tra", '[trajectory]\nvelocity = "fast"\n[[tra', "velocity is 'fast'; expected a number"),
        ("[[trajectory", "[push]\nforce = 3\n[[trajectory", "[push]: force is 3; expected 3 numbers, in N"),
    ],
)
def test_a_wrong_value_names_file_way_point_and_key(
    old: str, new: str, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mujoco")
    path = tmp_path / "own.toml"
    path.write_text(WAYS.replace(old, new, 1))
    found, said = status(capsys, "experiment", path)
    assert found == 2 and said.startswith(f"tilthex: {path}: ") and sentence in said


def test_a_wrong_file_is_named_for_what_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    Path("wasp.toml").write_text('[vehicle]\npreset = "tilt-hex"\n')
    Path("flown.toml").write_text("[admittance]\nmass = [1.0, 1, 1, 1, 1, 1]\n")
    Path("button.toml").write_text('vehicle = "wsap.toml"\n' + WAYS)
    Path("set.toml").write_text("[config.admittance]\nmas = 1\n" + WAYS)
    for arguments, sentence in (
        (("experiment", "button"), "or a .toml file; did you mean button.toml?"),
        (("experiment", "wasp.toml"), "wasp.toml is the file of a vehicle; expected an experiment"),
        (("experiment", "flown.toml"), "flown.toml is the file of a configuration; expected an experiment"),
        (("experiment", "button.toml"), "button.toml: key `vehicle`: [vehicle]: cannot read the file"),
        (("experiment", "set.toml", "--vehicle", "no.toml"), "--vehicle: [vehicle]: cannot read"),
        (("experiment", "set.toml"), "set.toml: [config]: [admittance]: unknown key `mas`"),
        (("check", "button.toml"), "button.toml is the file of an experiment; expected a configuration"),
        (("tune", "button.toml"), "button.toml is the file of an experiment; expected a configuration"),
    ):
        found, said = status(capsys, *arguments)
        assert found == 2 and sentence in said, arguments


@pytest.mark.parametrize(
    ("checks", "sentence"),
    [
        ("[record.toool]", "line 3: the judge ended with AttributeError: the record has no column 'toool'"),
        (
            "[1 / 0]",
            "line 3: the judge ended with ZeroDivisionError: division by zero; the record has a",
        ),
        ("None", "`checks` returned None; expected a list of Check"),
    ],
)
def test_an_exception_in_a_judge_keeps_the_flight(
    checks: str, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mujoco")
    from tilthex.experiments.record import Record

    (tmp_path / "own.toml").write_text(WAYS)
    (tmp_path / "own.py").write_text(
        "from tilthex.experiments.judge import Judge\ndef checks(run, record):\n"
        f"    return {checks}\nJUDGE = Judge(checks, lambda flights: {{}})\n"
    )
    found, said = status(capsys, "experiment", tmp_path / "own.toml", "--out", tmp_path / "out")
    assert found == 2 and str(tmp_path / "own.py") in said and sentence in said
    [kept] = (tmp_path / "out").glob("*.npz")
    assert str(kept) in said and len(Record.load(kept).time) > 50


def test_a_module_without_a_judge_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("mujoco")
    (tmp_path / "own.toml").write_text(WAYS)
    (tmp_path / "own.py").write_text("JUDG = 3\n")
    found, said = status(capsys, "experiment", tmp_path / "own.toml", "--out", tmp_path / "out")
    assert found == 2 and "own.py has no JUDGE; expected JUDGE = Judge(checks, figures)" in said


def test_a_module_that_cannot_be_imported_is_named_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mujoco")
    (tmp_path / "own.toml").write_text(WAYS)
    (tmp_path / "own.py").write_text("first = 1\nJUDGE = Jugde(first)\n")
    found, said = status(capsys, "experiment", tmp_path / "own.toml", "--out", tmp_path / "out")
    assert found == 2
    assert f"{tmp_path / 'own.py'}, line 2: cannot be imported: NameError: name 'Jugde' is not" in said


def test_a_number_above_and_below_a_limit() -> None:
    pytest.importorskip("mujoco")
    from tilthex.experiments.record import above, below

    high, low = above("travel", 6e-3, 5e-3, "mm", scale=1e3), below("force", 6.0, 5.0, "N")
    assert (high.required, high.measured, high.passed) == ("at least 5 mm", "6 mm", True)
    assert (low.required, low.measured, low.passed) == ("at most 5 N", "6 N", False)
    assert above("travel", float("nan"), 5e-3, "m").passed is False
