"""Finds and runs the Rust programs."""

from __future__ import annotations

import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO

LANDING = 20.0
"""Time in which a program that is interrupted in flight has to land, s."""


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


def free_port() -> int:
    """A port of this computer at which no program receives packets."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind(("127.0.0.1", 0))
        return int(line.getsockname()[1])


class Program:
    """One of the Rust programs. When the stack that it was entered into ends, it lands and ends."""

    def __init__(self, stack: ExitStack, name: str, arguments: Sequence[str], output: int | IO[str]) -> None:
        self._name = name
        errors = tempfile.TemporaryFile("w+", encoding="utf-8")  # noqa: SIM115 - the stack closes it
        self._errors = stack.enter_context(errors)
        # In its own session: an interrupt reaches only this program, which ends the other two in
        # order.
        self.process = subprocess.Popen(
            [program(name), *arguments],
            stdout=output,
            stderr=self._errors,
            text=True,
            start_new_session=True,
        )
        stack.callback(self._end)

    def ready(self) -> str:
        """The first line that it prints.

        Raises:
            OSError: It ended first; with its own sentence.
        """
        assert self.process.stdout is not None
        line: str = self.process.stdout.readline().strip()
        if not line:
            self.process.wait()
            raise OSError(self.sentence())
        return line

    def sentence(self) -> str:
        """The sentence with which the program failed."""
        lines = [line for line in self._lines() if "warning:" not in line]
        return lines[-1] if lines else f"{self._name} ended without a message ({self.process.returncode})"

    def warnings(self) -> list[str]:
        """The warnings of the program."""
        return [line for line in self._lines() if "warning:" in line]

    def _lines(self) -> list[str]:
        self._errors.seek(0)
        return [line.strip() for line in self._errors if line.strip()]

    def _end(self) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(LANDING)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        if self.process.stdout is not None:
            self.process.stdout.close()
