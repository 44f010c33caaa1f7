"""The `tilthex` command: what is no log, and what is not installed."""

from __future__ import annotations

import subprocess
import sys

import tilthex
from tilthex import __main__ as command


def test_a_file_that_is_no_log_is_one_sentence(tmp_path, capsys):
    path = tmp_path / "flight.mcap"
    path.write_text("no log")
    for arguments in (["plot", str(path)], ["fit", str(path)]):
        assert command.main(arguments) == 2
        error = capsys.readouterr().err
        assert error.startswith("tilthex: ")
        assert str(path) in error
        assert error.count("\n") == 1
    assert command.main(["plot", str(tmp_path / "none.mcap")]) == 2
    assert "none.mcap" in capsys.readouterr().err


def test_the_command_is_installed():
    out = subprocess.run(
        [sys.executable, "-m", "tilthex", "--version"], capture_output=True, text=True, check=True
    )
    assert out.stdout == f"tilthex {tilthex.__version__}\n"


def test_the_command_starts_without_the_extras():
    code = (
        "import sys, tilthex.__main__\n"
        "extras = {'scipy', 'matplotlib', 'mujoco', 'pandas', 'mcap', 'tqdm'} & set(sys.modules)\n"
        "assert not extras, extras"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_missing_extra_is_one_sentence(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "mcap_protobuf.decoder", None)
    assert command.main(["fit", str(tmp_path / "flight.mcap")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("tilthex: ")
    assert "not installed: pip install 'tilthex[" in error
    assert error.count("\n") == 1
