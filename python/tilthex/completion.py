"""`tilthex completion SHELL`: prints the script with which a shell completes the command."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tilthex import Truth, Vehicle, doctor
from tilthex.experiments.cli import built_in

SHELLS = ("bash", "zsh", "tcsh")


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

    whole, words = parser(), _words()
    (commands,) = (action for action in whole._actions if isinstance(action, argparse._SubParsersAction))
    commands.choices["doctor"] = doctor.options()
    _complete_files(whole, shtab.FILE, words)
    functions = "\n".join(
        f'{_function(name)}() {{ compgen -W "{" ".join(known)}" -- "$1"; _shtab_compgen_files "$1"; }}'
        for name, known in words.items()
    )
    print(shtab.complete(whole, shell=arguments.shell, preamble={"bash": functions}))


def _words() -> dict[str, Sequence[str]]:
    """The names that an argument takes in place of a file, by the name of the argument."""
    presets = Vehicle.presets()
    return {"name": [*built_in(), "all"], "truth": Truth.levels(), "vehicle": presets, "config": presets}


def _function(name: str) -> str:
    """The function of bash that completes an argument with words and files."""
    return f"_tilthex_{name}"


def _complete_files(parser: argparse.ArgumentParser, file: Any, words: dict[str, Sequence[str]]) -> None:
    """Marks the arguments that are files, and those that are files or one of some words."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for one in action.choices.values():
                _complete_files(one, file, words)
        elif action.type is Path or action.dest == "poses":
            action.complete = file  # type: ignore[attr-defined]
        elif not action.choices and action.dest in words:
            action.complete = file | {"bash": _function(action.dest)}  # type: ignore[attr-defined]
