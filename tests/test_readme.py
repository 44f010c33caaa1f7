"""The lines of the README do what it says."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
import tilthex

README = (Path(__file__).parent.parent / "README.md").read_text()


def fenced(language: str) -> str:
    (code,) = re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)
    return code


def test_the_ten_lines_fly_a_push_and_plot_it(tmp_path, monkeypatch):
    mpl.use("Agg")
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(fenced("python"), names)
    assert (tmp_path / "push.png").stat().st_size > 1000
    run = names["run"]
    pushed = (run["time"][:, 0] > 9) & (run["time"][:, 0] < 11)
    assert run["tool_position"][pushed, 0].mean() == pytest.approx((1.4 - 0.2) / 6, abs=5e-3)


def test_the_configuration_is_one(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(fenced("toml"))
    config = tilthex.Config.from_toml(path)
    np.testing.assert_array_equal(config.vehicle.tool_position, [0.12, 0, -0.4])
