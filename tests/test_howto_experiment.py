"""The page about own experiments: its example flies, and its table has every column of a record."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the experiments need MuJoCo: pip install 'tilthex[experiments]'")

from tilthex import __main__ as command
from tilthex._toml import tomllib
from tilthex.experiments.record import COLUMNS, Record

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "howto" / "experiment.md").read_text()


def fenced(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def begin(record: Record, name: str) -> str:
    """The begin of a column's row in the table."""
    shape = " x ".join(map(str, record.columns[name].shape[1:])) or "1"
    if name == "rotor_speeds":
        shape = "one for each rotor"
    elif name == "scene_joints":
        shape = "one for each coordinate"
    return f"\n| `{name}` | {shape} | "


def test_the_example_flies_and_the_table_has_its_columns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    experiment, _ = fenced("toml")
    for name, [text] in (
        ("mine.toml", [experiment]),
        ("wall.xml", fenced("xml")),
        ("mine.py", fenced("python")),
    ):
        Path(name).write_text(text)
    assert command.main(["experiment", "mine.toml", "--out", "out"]) == 0
    said = capsys.readouterr().out
    assert said.count("pass ") == 2 and "FALLS SHORT" not in said
    [file] = Path("out").glob("*.npz")
    record = Record.load(file)
    assert set(COLUMNS) <= set(record.columns)
    table = PAGE.split("## The columns")[1]
    for name in record.columns:
        assert begin(record, name) in table, f"the page needs a row with this begin:{begin(record, name)}"
    assert table.count("\n| `") == len(record.columns)
    # The frames: positions of the tip and of the centre of mass, and the wrench at the button.
    np.testing.assert_allclose(
        record.tool_position,
        record.robot_position + record.robot_rotation @ [0.6, 0.0, 0.0],
        atol=1e-6,
    )


def test_the_pushes_of_the_page_are_those_of_the_example() -> None:
    _, pushes = fenced("toml")
    [push] = tomllib.loads(pushes)["push"]
    [example] = tomllib.loads((ROOT / "examples" / "push.toml").read_text())["push"]
    assert push.keys() >= example.keys() and {key: push[key] for key in example} == example
