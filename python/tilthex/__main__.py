"""The `tilthex` command. Each subcommand's module offers `add_parser`."""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from typing import Any

from tilthex import (
    __version__,
    check,
    compare,
    completion,
    convert,
    design,
    doctor,
    estimate,
    excite,
    fit,
    manoeuvres,
    new,
    plot,
    px4,
    tune,
    video,
)
from tilthex._colours import RED, YELLOW, coloured
from tilthex.experiments import cli as experiments
from tilthex.log import LogCut
from tilthex.view import cli as view

COMMANDS: tuple[Callable[[Any], None], ...] = (
    check.add_parser,
    compare.add_parser,
    completion.add_parser,
    convert.add_parser,
    design.add_parser,
    doctor.add_parser,
    estimate.add_parser,
    excite.add_parser,
    experiments.add_parser,
    fit.add_parser,
    manoeuvres.add_parser,
    new.add_parser,
    plot.add_parser,
    px4.add_parser,
    tune.add_parser,
    video.add_parser,
    view.add_parser,
)
"""The `add_parser` of each subcommand's module."""
USAGE = 2
"""Exit status after a usage or configuration error, the same as that of the Rust programs."""


def parser() -> argparse.ArgumentParser:
    """The parser of the command with all its subcommands."""
    parser = argparse.ArgumentParser(prog="tilthex", description="Tools around the tilthex controller.")
    parser.add_argument("--version", action="version", version=f"tilthex {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for add_parser in COMMANDS:
        add_parser(commands)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a subcommand. An error gives one sentence on standard error."""
    chosen = parser().parse_args(arguments)
    # The commands draw into files; whoever draws with the library, in a notebook for example, sees figures.
    os.environ.setdefault("MPLBACKEND", "Agg")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("once", LogCut)
            warnings.showwarning = _show_warning
            chosen.run(chosen)
    except ModuleNotFoundError as error:
        needed = f"this command needs {error.name}, which is not installed"
        _say(f"{needed}: pip install 'tilthex[analysis,completion,experiments,logs,view]'", RED)
        return USAGE
    except OSError as error:
        _say(str(error) if error.filename is None else f"{error.filename}: {error.strerror}", RED)
        return USAGE
    except (ValueError, ImportError) as error:
        _say(str(error), RED)
        return USAGE
    except KeyboardInterrupt:
        return 130
    return 0


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    """Prints a warning as one sentence on standard error."""
    _say(f"warning: {message}", YELLOW)


def _say(sentence: str, colour: int) -> None:
    """Prints a sentence on standard error, after the name of the command in a colour."""
    print(f"{coloured('tilthex:', colour, sys.stderr)} {sentence}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
