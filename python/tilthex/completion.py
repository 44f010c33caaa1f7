"""`tilthex completion SHELL`: prints the script with which a shell completes the command."""

from __future__ import annotations

import argparse
from typing import Any

SHELLS = ("bash", "zsh", "tcsh")
FILES = ("config", "recording", "log", "out", "plot", "truth")
"""The names of arguments that are files, if they have no choices."""


def add_parser(commands: Any) -> None:
    """Registers the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "completion",
        help="print the completion script of a shell",
        description="Prints a script. bash: tilthex completion bash > "
        "~/.local/share/bash-completion/completions/tilthex",
    )
    parser.add_argument("shell", choices=SHELLS)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Prints the script."""
    import shtab

    from tilthex.__main__ import parser

    whole = parser()
    _complete_files(whole, shtab.FILE)
    print(shtab.complete(whole, shell=arguments.shell))


def _complete_files(parser: argparse.ArgumentParser, file: Any) -> None:
    """Marks the arguments that are files."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for one in action.choices.values():
                _complete_files(one, file)
        elif action.dest in FILES and not action.choices:
            action.complete = file  # type: ignore[attr-defined]
