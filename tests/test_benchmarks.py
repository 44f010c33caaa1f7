"""What the benchmarks say where they cannot run."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_a_recording_that_is_not_there_is_status_2_and_says_where_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setenv("TILTHEX_DATA", str(tmp_path))
    command = [sys.executable, "-m", "benchmarks.broad"]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert found.returncode == 2, found
    assert found.stdout == ""
    assert "https://github.com/dlaidig/broad" in found.stderr
    assert "TILTHEX_DATA" in found.stderr
