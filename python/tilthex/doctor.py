"""`tilthex doctor`: what `tilthex-rt doctor` says of this computer, and of the vehicle and motion capture."""

from __future__ import annotations

import argparse
import re
import subprocess
from pathlib import Path
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


def options() -> argparse.ArgumentParser:
    """A parser with the options that `tilthex-rt doctor --help` lists, for the completion of the command."""
    call = [program("tilthex-rt"), "doctor", "--help"]
    text = subprocess.run(call, capture_output=True, text=True, check=True).stdout
    parser = argparse.ArgumentParser()
    # The only option with a letter is -h, --help, which the parser has.
    for option in re.split(r"^ {6}(?=--)", text, flags=re.MULTILINE)[1:]:
        head, about, *_ = map(str.strip, option.splitlines())
        name, _, value = head.partition(" ")
        choices = re.findall(r"^ +- ([\w-]+):", option, re.MULTILINE)
        if choices:
            parser.add_argument(name, help=about, choices=choices)
        elif value:
            parser.add_argument(name, help=about, type=Path)
        else:
            parser.add_argument(name, help=about, action="store_true")
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Runs the program; its exit status is that of the command.

    Raises:
        SystemExit: With this status.
    """
    raise SystemExit(subprocess.run([program("tilthex-rt"), "doctor", *arguments.arguments]).returncode)
