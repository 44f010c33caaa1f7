"""`tilthex doctor`: what `tilthex-rt doctor` says of this computer, and of the vehicle and motion capture."""

from __future__ import annotations

import argparse
import subprocess
from typing import Any

from tilthex._programs import program


def add_parser(commands: Any) -> None:
    """Registers the command. Every argument goes to `tilthex-rt doctor`, `--help` too."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "doctor",
        help="check this computer, the vehicle and motion capture: tilthex-rt doctor",
        # No argument has this prefix, so that argparse reads none of the options.
        prefix_chars="\0",
        add_help=False,
    )
    parser.add_argument("arguments", nargs="*")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Runs the program; its exit status is that of the command.

    Raises:
        SystemExit: With this status.
    """
    raise SystemExit(subprocess.run([program("tilthex-rt"), "doctor", *arguments.arguments]).returncode)
