"""`tilthex view --sim`: starts a simulated flight."""

from __future__ import annotations

import re
import signal
import subprocess
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import IO, NamedTuple

from tilthex._programs import program

LANDING = 30.0
"""Longest time for the landing if the page ends in flight, s."""


class Ports(NamedTuple):
    """Ports of a simulated flight on this computer."""

    control: int
    """TCP: orders and states."""
    pushes: int
    """UDP: pushes of the tool."""


SAID = {"control": r"control socket at .*:(\d+)$", "pushes": r"pushes of the tool at .*:(\d+)$"}
"""The lines in which the flight prints them."""


@contextmanager
def flight(arguments: Sequence[str]) -> Iterator[Ports]:
    """Starts a simulated `tilthex-rt` and yields its ports. At the end the flight lands.

    Args:
        arguments: Arguments in addition to those that make it simulated and controlled.

    Raises:
        OSError: It is not installed, or does not start; it prints the reason on standard error.
    """
    process = subprocess.Popen(
        [program("tilthex-rt"), "--sim", "--control", "127.0.0.1:0", "--push-port", "0", *arguments],
        stdout=subprocess.PIPE,
        text=True,
        # Ctrl-C must reach only the page, which then ends the flight.
        start_new_session=True,
    )
    assert process.stdout is not None
    reader = threading.Thread(target=_drain, args=(process.stdout,), daemon=True)
    try:
        ports = _ports(process.stdout)
        if ports is None:
            raise OSError(f"the simulated flight does not start: tilthex-rt ended with {process.wait()}")
        # The output is not needed, but must be read.
        reader.start()
        yield ports
    finally:
        _end(process)
        if reader.ident is not None:
            reader.join()
        process.stdout.close()


def _end(process: subprocess.Popen[str]) -> None:
    if process.poll() is not None:
        return
    process.send_signal(signal.SIGINT)
    try:
        process.wait(LANDING)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _ports(output: IO[str]) -> Ports | None:
    found: dict[str, int] = {}
    for line in output:
        for name, said in SAID.items():
            if match := re.match(said, line.strip()):
                found[name] = int(match[1])
        if len(found) == len(SAID):
            return Ports(**found)
    return None


def _drain(output: IO[str]) -> None:
    for _ in output:
        pass
