"""Finds the Rust programs."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path


def program(name: str) -> str:
    """The path of one of the Rust programs: beside this Python, or on the PATH.

    Raises:
        OSError: It is in neither place.
    """
    beside = Path(sys.executable).parent / name
    found = str(beside) if beside.exists() else shutil.which(name)
    if found is None:
        raise OSError(f"{name} is neither in {beside.parent} nor on the path; install tilthex with pip")
    return found
