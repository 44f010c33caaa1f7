"""The command for scripts: results as JSON, completion, files that are asked for, and the doctor."""

import ast
import contextlib
import io
import json
import os
import pty
import re
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
import tilthex
from hypothesis import given, settings
from hypothesis import strategies as st
from tilthex import __main__ as command
from tilthex import _json, _programs, new

MODULE = """
from tilthex.experiments.judge import Judge
from tilthex.experiments.record import below

JUDGE = Judge(lambda run, record: [below("error", abs(record.position_error).max(), 0.05, "mm", scale=1e3)],
              lambda flights: {})
"""


def said(capsys, *arguments):
    """The JSON that a command prints, and nothing else."""
    assert command.main([*map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def imported(module):
    """The packages that a module imports as it is itself imported, in every version of Python."""
    nodes = ast.parse(Path(module).read_text()).body
    while nodes:
        node = nodes.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) != "TYPE_CHECKING":
            nodes += [*node.body, *node.orelse]
        elif isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module.split(".")[0]


def test_the_command_needs_only_what_every_installation_has():
    listed = "[getattr(module, '__file__', None) for module in sys.modules.values()]"
    listing = f"import json, sys, tilthex.__main__; print(json.dumps({listed}))"
    found = subprocess.run([sys.executable, "-c", listing], capture_output=True, text=True, check=True).stdout
    package = str(Path(tilthex.__file__).parent)
    modules = [path for path in json.loads(found) if str(path).startswith(package) and path.endswith(".py")]
    required = [line for line in metadata.requires("tilthex") if "extra ==" not in line]
    installed = {re.match(r"[\w-]+", line)[0] for line in required} | {"tilthex"} | sys.stdlib_module_names
    assert len(modules) > 10
    assert {package for module in modules for package in imported(module)} <= installed


def test_check_and_tune_as_json_are_what_the_model_says(capsys):
    model = tilthex.LoopModel(tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex")))
    found = said(capsys, "check", "tilt-hex", "--draws", 1)
    hover = model.hover()
    assert list(found["axes"]) == model.axes and found["stable"] is True
    assert [axis["phase_margin_deg"] for axis in found["axes"].values()] == hover["phase_margin_deg"].tolist()
    assert all(axis["drawn_phase_margin_deg"] <= 90 for axis in found["axes"].values())
    assert found["drawn"] == {"truth": "measured", "draws": 1, "unstable": 0}
    assert found["contact"]["along_undamped"]["z"] == [list(pair) for pair in model.contact(along=[0, 0, 1])]
    tuned = said(capsys, "tune", "tilt-hex")
    assert tuned["sections"] == json.loads(json.dumps(model.derive())) and tuned["axes"] == model.axes


def test_an_experiment_as_json_has_its_checks(capsys, tmp_path):
    pytest.importorskip("mujoco")
    path = tmp_path / "mine.toml"
    sys.stdin, before = io.StringIO("\n\nfree\n0.2\n\n"), sys.stdin
    try:
        assert command.main(["new", "experiment", str(path)]) == 0
    finally:
        sys.stdin = before
    capsys.readouterr()
    (tmp_path / "mine.py").write_text(MODULE)
    (one,) = said(capsys, "experiment", path, "--out", tmp_path / "out")["experiments"]
    assert one["experiment"] == "mine" and (tmp_path / "out/mine.html").exists()
    (check,) = one["checks"]
    assert check.pop("measured").endswith(" mm") and check["passed"] is True
    assert check == {"what": "error", "required": "at most 50 mm", "paper": "", "passed": True}


@settings(max_examples=15)
@given(st.recursive(st.none() | st.booleans() | st.integers() | st.floats() | st.text(), st.lists))
def test_anything_is_said_as_json(value):
    back = json.loads(json.dumps(_json.plain({"a": value, "b": np.array([1.0, np.nan])}), allow_nan=False))
    assert back["b"] == [1.0, None]


@pytest.mark.parametrize("answers", ["", "mine\n4.5\n0.02\n\n0.03\n0.1\n0\n-0.2\n0.5\nup\n0.3\n"])
def test_a_new_vehicle_is_read_and_every_key_has_a_comment(answers, monkeypatch, tmp_path, capsys):
    path = tmp_path / "own.toml"
    monkeypatch.setattr(sys, "stdin", io.StringIO(answers))
    assert command.main(["new", "vehicle", str(path)]) == 0
    vehicle = tilthex.Vehicle.from_toml(path)
    if answers:
        assert (vehicle.name, vehicle.mass, vehicle.rotor_time_constant) == ("mine", 4.5, 0.1)
        assert vehicle.tool_position.tolist() == [0.0, -0.2, 0.5] and vehicle.inertia[0, 0] == 0.02
        # The rod goes down to the vehicle.
        np.testing.assert_allclose(vehicle.tool_rotation[:, 2], [0.0, 0.0, -1.0], atol=1e-12)
    else:
        assert vehicle.name == "own"
    text = path.read_text()
    assert text.startswith("# Written by") and text.count("\n#") > 8
    assert command.main(["new", "vehicle", str(path)]) == 2
    assert "exists; expected a new file" in capsys.readouterr().err


@pytest.mark.parametrize(
    "answers", ["", 'A "title"\nhexarotor\nplane\n5\n0.1\n0.03\n1\n9\n', "\n\nfree\n\n\n"]
)
def test_a_new_experiment_is_read(answers, monkeypatch, tmp_path):
    pytest.importorskip("mujoco")
    from tilthex.experiments import spec

    path = tmp_path / "own.toml"
    monkeypatch.setattr(sys, "stdin", io.StringIO(answers))
    assert command.main(["new", "experiment", str(path)]) == 0
    found = spec.load(str(path))
    (run,) = found.runs
    assert run.scene() and run.model().name in ("tilt-hex", "hexarotor")
    if answers.startswith("A"):
        assert found.title == 'A "title"' and run.seed == 9 and run.world["tilt_deg"] == [5, 0]


def test_a_new_experiment_hovers_level_with_a_tool_that_points_forward(monkeypatch, tmp_path):
    pytest.importorskip("mujoco")
    from tilthex.experiments import spec

    monkeypatch.setattr(sys, "stdin", io.StringIO("\n" * 9 + "forward\n"))
    assert command.main(["new", "vehicle", str(tmp_path / "mine.toml")]) == 0
    (tmp_path / "wall.xml").write_text("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    monkeypatch.setattr(sys, "stdin", io.StringIO("\nmine.toml\nwall.xml\n"))
    assert command.main(["new", "experiment", str(tmp_path / "own.toml")]) == 0
    (run,) = spec.load(str(tmp_path / "own.toml")).runs
    assert [element.tag for element in run.scene().elements] == ["geom", "geom"]
    for point in run.waypoints:
        np.testing.assert_allclose(point.rotation, run.model().tool_rotation, atol=1e-12)
    np.testing.assert_allclose(run.model().tool_rotation[:, 2], [-1.0, 0.0, 0.0], atol=1e-12)


def test_an_answer_that_does_not_fit_is_refused(monkeypatch, tmp_path, capsys):
    for answers, sentence in (
        ("x\nheavy\n", "is 'heavy'; expected a number"),
        ("x\n-1\n", "mass is -1"),
        ("x\n" + "\n" * 8 + "aside\n", "where the tool points is 'aside'; expected one of down, forward, up"),
    ):
        monkeypatch.setattr(sys, "stdin", io.StringIO(answers))
        assert command.main(["new", "vehicle", str(tmp_path / "own.toml")]) == 2
        assert sentence in capsys.readouterr().err.splitlines()[-1]
    assert command.main(["new", "vehicle", "own.txt"]) == 2
    assert "own.txt does not end in .toml" in capsys.readouterr().err
    assert not list(tmp_path.iterdir()) and set(new.KINDS) == {"vehicle", "experiment"}


def completion_of(printed, function, folder):
    """What bash offers for the last word of a line, with a script in a folder."""
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("bash is not installed")
    (folder / f"{function}.bash").write_text(printed)

    def completed(*words):
        line = " ".join(f"'{word}'" for word in words)
        call = f"source {function}.bash; COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; "
        call += f"{function} '{words[0]}' '{words[-1]}' '{words[-2]}'; "
        call += 'printf "%s\\n" "${COMPREPLY[@]}"'
        done = subprocess.run([bash, "-c", call], cwd=folder, capture_output=True, text=True)
        return set(done.stdout.split())

    return completed


def test_bash_completes_commands_options_and_choices(tmp_path, capsys):
    pytest.importorskip("shtab")
    assert command.main(["completion", "bash"]) == 0
    completed = completion_of(capsys.readouterr().out, "_shtab_tilthex", tmp_path)
    assert {"check", "experiment", "new", "doctor", "view"} <= completed("tilthex", "")
    assert completed("tilthex", "ex") == {"excite", "experiment"}
    assert "--json" in completed("tilthex", "check", "--j")
    assert completed("tilthex", "new", "") == {"vehicle", "experiment"}
    for name in ("sloop.toml", "flight.mcap", "secret"):
        (tmp_path / name).touch()
    assert completed("tilthex", "experiment", "sl") == {"sliding", "sloop.toml"}
    assert completed("tilthex", "experiment", "sliding", "--truth", "cad") == {"cad"}
    assert {"tilt-hex", "sloop.toml"} <= completed("tilthex", "check", "")
    files = {"sloop.toml", "flight.mcap", "secret", "_shtab_tilthex.bash"}
    for name in ("estimate", "view"):
        assert completed("tilthex", name, "--config", "") == files, name
    assert completed("tilthex", "view", "fl") == {"flight.mcap"}
    assert completed("tilthex", "view", "--token-file", "se") == {"secret"}


def completion_of_program(name, folder):
    """What bash offers for the last word of a line of one of the Rust programs."""
    call = [_programs.program(name), "completion", "bash"]
    printed = subprocess.run(call, capture_output=True, text=True, check=True).stdout
    return completion_of(printed, f"_{name.replace('-', '__')}", folder)


def test_bash_completes_the_doctor_as_the_program(tmp_path, capsys):
    pytest.importorskip("shtab")
    assert command.main(["completion", "bash"]) == 0
    completed = completion_of(capsys.readouterr().out, "_shtab_tilthex", tmp_path)
    of_program = completion_of_program("tilthex-rt", tmp_path)
    options = of_program("tilthex-rt", "doctor", "--")
    assert {"--port", "--json", "--realtime"} < options
    assert completed("tilthex", "doctor", "--") == options
    (tmp_path / "vehicle.toml").touch()
    for option, part, offered in (
        ("--realtime", "", {"require", "prefer", "off"}),
        ("--realtime", "re", {"require"}),
        ("--config", "ve", {"vehicle.toml"}),
        ("--json", "--m", {"--mocap"}),
    ):
        assert of_program("tilthex-rt", "doctor", option, part) == offered
        assert completed("tilthex", "doctor", option, part) == offered


def test_bash_completes_the_simulated_vehicle(tmp_path):
    completed = completion_of_program("tilthex-sim", tmp_path)
    assert completed("tilthex-sim", "--mocap-l") == {"--mocap-latency", "--mocap-loss"}
    assert completed("tilthex-sim", "com") == {"completion"}
    assert {"bash", "zsh", "fish"} < completed("tilthex-sim", "completion", "")
    (tmp_path / "push.toml").touch()
    assert completed("tilthex-sim", "--pushes", "pu") == {"push.toml"}


@pytest.mark.parametrize("name", ["tilthex-rt", "tilthex-sim"])
def test_a_program_says_its_own_name(name):
    said = subprocess.run([_programs.program(name), "--version"], capture_output=True, text=True, check=True)
    assert said.stdout.split()[0] == name


def test_bash_completes_the_program_of_the_flight(tmp_path):
    completed = completion_of_program("tilthex-rt", tmp_path)
    assert completed("tilthex-rt", "--take") == {"--take-off"}
    assert completed("tilthex-rt", "--realtime", "") == {"require", "prefer", "off"}
    assert completed("tilthex-rt", "doctor", "--j") == {"--json"}
    assert "merge" in completed("tilthex-rt", "campaign", "")
    (tmp_path / "flight.mcap").touch()
    assert "flight.mcap" in completed("tilthex-rt", "--log", "fl")


def test_the_doctor_as_json_has_every_check(capfd):
    with pytest.raises(SystemExit) as end:
        command.main(["doctor", "--json", "--realtime", "off", "--port", "/dev/no-such-port"])
    assert end.value.code == 2
    said, complaint = capfd.readouterr()
    found = json.loads(said)
    assert found["passed"] is False and "checks failed" in complaint
    by_name = {check["name"]: check for check in found["checks"]}
    assert {"kernel", "clock", "wake-up"} < by_name.keys()
    assert by_name["port"]["verdict"] == "fail" and "does not exist" in by_name["port"]["text"]
    assert {check["verdict"] for check in found["checks"]} <= {"ok", "fair", "fail"}


def test_the_doctor_is_that_of_the_program(monkeypatch, tmp_path, capfd):
    program = tmp_path / "tilthex-rt"
    program.write_text('#!/bin/sh\necho "$@"\nexit 3\n')
    program.chmod(0o755)
    monkeypatch.setattr("tilthex.doctor.program", lambda name: str(tmp_path / name))
    with pytest.raises(SystemExit) as end:
        command.main(["doctor", "--port", "/dev/ttyUSB0", "--help"])
    assert end.value.code == 3 and capfd.readouterr().out == "doctor --port /dev/ttyUSB0 --help\n"


def on_a_terminal(*call, **environment):
    """What a command prints on a terminal."""
    ours, theirs = pty.openpty()
    with os.fdopen(ours, "rb", buffering=0) as terminal:
        process = subprocess.Popen(call, stdout=theirs, stderr=theirs, env=os.environ | environment)
        os.close(theirs)
        printed = b""
        # The terminal of a program that has ended gives an error.
        with contextlib.suppress(OSError):
            while part := terminal.read(4096):
                printed += part
        process.wait()
    return printed.decode().replace("\r\n", "\n")


@pytest.mark.parametrize(
    ("arguments", "coloured"),
    [
        (["check", "tilt-hex", "--draws", 0], "\x1b[33m  <- low\x1b[0m"),
        (["plot", "none.mcap"], "\x1b[31mtilthex:\x1b[0m none.mcap: No such file"),
        (["doctor", "--realtime", "off", "--port", "/dev/none"], "\x1b[31mFAIL \x1b[0m port"),
    ],
)
def test_colours_are_for_terminals(arguments, coloured):
    plain = re.sub(r"\x1b\[\d*m", "", coloured)
    call = [sys.executable, "-m", "tilthex", *map(str, arguments)]
    assert coloured in on_a_terminal(*call, NO_COLOR="")
    without = on_a_terminal(*call, NO_COLOR="1")
    piped = subprocess.run(call, capture_output=True, text=True)
    for printed in (without, piped.stdout + piped.stderr):
        assert plain in printed and "\x1b" not in printed


def test_a_campaign_shows_its_progress_only_on_a_terminal():
    call = [_programs.program("tilthex-rt"), "campaign", "--number", "3", "--seed", "7"]
    shown = on_a_terminal(*call)
    table = subprocess.run(call, capture_output=True, text=True).stdout
    assert "\r" not in table
    assert shown == f"\r1 of 3 flights\r2 of 3 flights\r3 of 3 flights\r\x1b[K{table}"
