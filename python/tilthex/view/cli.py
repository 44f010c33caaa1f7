"""`tilthex view`: serves the page and opens it in a browser."""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import threading
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tilthex._control import add_options, connector

if TYPE_CHECKING:
    import viser

ABOUT = """Shows a flight in the browser: a running one, with its controls, a simulated one, or a log.

Without LOG and --sim the page is connected to the control socket of a running tilthex-rt --control
(docs/howto/view.md).
"""


def add_parser(commands: Any) -> None:
    """Adds the subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "view",
        help="show a flight in the browser: running, simulated or from a log",
        description=ABOUT,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("log", nargs="?", type=Path, metavar="LOG", help="MCAP file of tilthex-rt")
    what.add_argument("--sim", action="store_true", help="start a simulated flight and show it")
    add_options(parser)
    parser.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="configuration of the flight of --sim; a log and a running flight have their own",
    )
    parser.add_argument(
        "--listen",
        default="127.0.0.1:8080",
        metavar="ADDRESS:PORT",
        help="address of the page; an address of a network requires a token (default: %(default)s)",
    )
    parser.add_argument(
        "--token-file",
        type=Path,
        metavar="FILE",
        help="file with the token (default: for an address of a network, a new token at each start)",
    )
    parser.add_argument(
        "--no-browser", action="store_true", help="print the address of the page, and do not open it"
    )
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> None:
    try:
        import viser  # noqa: F401
    except ImportError as error:
        raise ImportError(
            f"the page needs {error.name}, which is not installed: pip install 'tilthex[view]'"
        ) from error
    from tilthex.view import gate

    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    guard = gate.gate(arguments.listen, arguments.token_file)
    with contextlib.ExitStack() as stack:
        make = _prepare(arguments, stack)
        server = gate.serve(guard)
        stack.callback(server.stop)
        run = make(server)
        url = guard.url(server.get_port())
        print(url, flush=True)
        if not arguments.no_browser and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            webbrowser.open(url)
        run(ended)


def _prepare(
    arguments: argparse.Namespace, stack: contextlib.ExitStack
) -> Callable[[viser.ViserServer], Callable[[threading.Event], None]]:
    """Opens the log, or starts or connects to the flight.

    Returns a function that makes the page, and then shows it until the end.
    """
    path = arguments.config
    if path is not None and not arguments.sim:
        raise ValueError(
            f"--config {path} is for --sim; a log and a running flight have their own configuration"
        )
    if arguments.log is not None:
        from tilthex.log import Log
        from tilthex.view.replay import Replay
        from tilthex.view.sample import Flown

        flown = Flown(Log(arguments.log))
        return lambda server: Replay(server, flown, arguments.log.name).run
    from tilthex.view.live import Live

    address, title, push_port = arguments.control, f"flight at {arguments.control}", None
    if arguments.sim:
        from tilthex.view import simulated

        ports = stack.enter_context(simulated.flight([] if path is None else ["--config", str(path)]))
        address, title, push_port = f"127.0.0.1:{ports.control}", "simulated flight", ports.pushes
    connection = connector(address, arguments.control_token_file)
    return lambda server: Live(server, connection, title, push_port).run
