"""PEP 517 backend: maturin, plus the two Rust programs in the wheel's scripts.

maturin packs either a library or programs, not both. It copies the contents of the folder `[tool.maturin]
data` into the wheel. So this backend builds the programs into `scripts` of that folder, and leaves the
rest to maturin.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import maturin

get_requires_for_build_wheel = maturin.get_requires_for_build_wheel
get_requires_for_build_editable = maturin.get_requires_for_build_editable
get_requires_for_build_sdist = maturin.get_requires_for_build_sdist

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / "target" / "wheel-data"
PROGRAMS = ("tilthex-rt", "tilthex-sim")


def build_programs(how: Sequence[str] = ("build",)) -> None:
    """Builds the programs with a cargo command, and leaves only them in DATA/scripts."""
    scripts = DATA / "scripts"
    shutil.rmtree(scripts, ignore_errors=True)
    scripts.mkdir(parents=True)
    command = [os.environ.get("CARGO", "cargo"), *how, "--release", "--bins", "-p", "tilthex-rt"]
    command += ["--message-format=json-render-diagnostics"]
    build = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True)
    for message in map(json.loads, build.stdout.splitlines()):
        executable = message.get("executable")
        if executable and message["target"]["name"] in PROGRAMS:
            shutil.copy2(executable, scripts)


def _ensure_data() -> None:
    """Makes the data folder, which maturin needs even to write metadata."""
    DATA.mkdir(parents=True, exist_ok=True)


def prepare_metadata_for_build_wheel(directory: str, settings: dict[str, Any] | None = None) -> str:
    """The wheel's metadata."""
    _ensure_data()
    return str(maturin.prepare_metadata_for_build_wheel(directory, settings))


prepare_metadata_for_build_editable = prepare_metadata_for_build_wheel


def build_wheel(
    directory: str, settings: dict[str, Any] | None = None, metadata_directory: str | None = None
) -> str:
    """The wheel: library, stubs and both programs."""
    build_programs()
    return str(maturin.build_wheel(directory, settings, metadata_directory))


def build_editable(
    directory: str, settings: dict[str, Any] | None = None, metadata_directory: str | None = None
) -> str:
    """An editable wheel: the Python files stay in place, programs and library are built."""
    build_programs()
    return str(maturin.build_editable(directory, settings, metadata_directory))


def build_sdist(directory: str, settings: dict[str, Any] | None = None) -> str:
    """The source distribution."""
    _ensure_data()
    return str(maturin.build_sdist(directory, settings))
