"""The options of programs that connect to the control socket of a running flight."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path

from tilthex.client import DEFAULT_PORT, Flight, connect


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds `--control` and `--control-token-file`."""
    parser.add_argument(
        "--control",
        default=f"127.0.0.1:{DEFAULT_PORT}",
        metavar="ADDRESS",
        help="control socket of tilthex-rt --control: HOST:PORT or unix:PATH (default: %(default)s)",
    )
    parser.add_argument(
        "--control-token-file", type=Path, metavar="FILE", help="the flight's token, if it requires one"
    )


def connector(address: str, token_file: Path | None) -> Callable[..., Flight]:
    """`tilthex.connect` with the address and the token of the options.

    The function takes the other arguments, `timeout` and `present`, by their names.

    Raises:
        ValueError: It is not an address.
        OSError: The file of the token cannot be read.
    """
    token = None if token_file is None else token_file.read_text(encoding="utf-8").strip()
    scheme, separator, path = address.partition(":")
    if scheme == "unix" and separator:
        return partial(connect, path=path, token=token)
    host, _, port = address.rpartition(":")
    host = host.strip("[]")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise ValueError(f"--control is {address!r}; expected HOST:PORT or unix:PATH")
    return partial(connect, host, int(port), token=token)
