"""The notebooks run as scripts, from a folder of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="the experiments need MuJoCo: pip install 'tilthex[experiments]'")

EXAMPLES = sorted((Path(__file__).parent.parent / "examples").glob("*.py"))
FLOWN = [path for path in EXAMPLES if "tilthex.experiments" in path.read_text(encoding="utf-8")]
# `show` writes the figure. The package keeps the backend that was chosen; else a notebook shows nothing.
RUN = """
import runpy, sys
import matplotlib.pyplot as plt

plt.show = lambda: plt.savefig("figure.png")
runpy.run_path(sys.argv.pop(1), run_name="__main__")
assert plt.get_backend() == "svg", plt.get_backend()
"""


@pytest.mark.parametrize("path", FLOWN, ids=lambda path: path.stem)
def test_the_notebook_runs(path: Path, tmp_path: Path) -> None:
    environment = os.environ | {"MPLBACKEND": "svg"}
    call = [sys.executable, "-W", "error::DeprecationWarning:__main__", "-c", RUN, str(path)]
    done = subprocess.run(call, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "FALLS SHORT" not in done.stdout
    assert list(tmp_path.glob("*.png"))
