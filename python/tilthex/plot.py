"""`tilthex plot`: draws a flight's log."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tilthex import log

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OUT = "picture to write: .png, or .pdf or .svg for vector graphics (default: LOG with .png instead of .mcap)"
TOPICS = ("/setpoint", "/reference", "/state", "/wrench", "/rotors", "/control", "/flight")


def add_parser(commands: Any) -> None:
    """Adds the subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "plot", help="draw a flight's log", description=__doc__
    )
    parser.add_argument("log", type=Path, metavar="LOG", help="MCAP file of tilthex-rt")
    parser.add_argument("--out", type=Path, help=OUT)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> None:
    out = arguments.out or arguments.log.with_suffix(".png")
    drawn = figure(arguments.log)
    import matplotlib

    # Letters stay letters, which can be searched and changed.
    with matplotlib.rc_context({"pdf.fonttype": 42, "svg.fonttype": "none"}):
        drawn.savefig(out, dpi=120)
    print(out)


def figure(path: str | Path) -> Figure:
    """Tool position, errors, wrenches and rotor speeds over time."""
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise ImportError(
            "drawing needs matplotlib, which is not installed: pip install 'tilthex[analysis]'"
        ) from error

    flight = log.Log(path)
    topics = {topic: flight.columns(topic) for topic in TOPICS}
    begin = topics["/flight"]["log_time"][0]
    rows = 6
    drawn, axes = plt.subplots(rows, 1, figsize=(9, 2.1 * rows), sharex=True, layout="constrained")

    def lines(row: int, topic: str, name: str, style: str, label: str, keep: slice = slice(None)) -> None:
        columns = topics[topic]
        axes[row].set_prop_cycle(None)
        for k, values in enumerate(columns[name].T[keep]):
            letter = "xyz"[k] if columns[name].shape[1] == 3 else str(k + 1)
            axes[row].plot(columns["log_time"] - begin, values, style, lw=1, label=f"{label} {letter}")

    lines(0, "/setpoint", "position_w", ":", "set-point")
    lines(0, "/reference", "position_w", "-", "reference")
    axes[0].set_ylabel("tool position, m")
    lines(1, "/control", "position_error_w", "-", "")
    axes[1].set_ylabel("position error, m")
    lines(2, "/control", "rotation_error_r", "-", "")
    axes[2].set_ylabel("rotation error")
    # A simulated vehicle has true values in its log; a real one has none.
    if "/truth" in flight.topics:
        topics["/truth"] = flight.columns("/truth")
        lines(3, "/truth", "tool_wrench_w.force", ":", "true")
        lines(4, "/truth", "tool_wrench_w.torque", ":", "true")
    lines(3, "/wrench", "tool_w.force", "-", "observed")
    axes[3].set_ylabel("tool force, N")
    lines(4, "/wrench", "tool_w.torque", "-", "observed")
    axes[4].set_ylabel("tool torque, N m")
    lines(5, "/rotors", "measured", "-", "rotor")
    axes[5].set_ylabel("rotor speed, Hz")
    axes[5].set_xlabel("time, s")
    aloft = log.flying(topics["/flight"]["phase"])
    for ax in axes:
        ax.fill_between(
            topics["/flight"]["log_time"] - begin,
            0,
            1,
            where=aloft,
            transform=ax.get_xaxis_transform(),
            color="0.94",
            lw=0,
        )
        ax.legend(fontsize=6, ncols=6, loc="lower right", bbox_to_anchor=(1, 1), frameon=False, borderpad=0)
        ax.margins(x=0)
    return drawn


__all__ = ["add_parser", "figure"]
