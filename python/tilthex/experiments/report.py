"""The report of an experiment: one HTML file and its figures."""

from __future__ import annotations

import base64
import html
import platform
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial.transform import Rotation

from tilthex import __version__
from tilthex._colours import GREEN, RED, coloured
from tilthex.experiments.record import Check, Record
from tilthex.plot import mark

AXES = ("x", "y", "z")
COLOURS = ("tab:blue", "tab:red", "tab:orange")
SHADES = ("0.93", "#e3f4e3", "#e3ecfa", "#faf0dc", "#f7e1e1", "#ece4f5")
PANELS = (
    ("tool position x, m", "robot: roll, pitch, yaw, deg"),
    ("tool position y, m", "rotation error, deg"),
    ("tool position z, m", "tool force, N"),
    ("position error, mm", "tool torque, N m"),
    ("reference - set-point, mm", "reference - set-point, deg"),
)
PALE = 0.4
LEAST_SPAN = 0.02
"""Least height of a panel of the position, m."""
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 72em; margin: 2em auto; padding: 0 1em; color: #222 }
table { border-collapse: collapse }
td, th { border-bottom: 1px solid #ccc; padding: .25em .8em; text-align: left }
.pass { color: #187a2f } .short { color: #b3261e; font-weight: 600 } img { max-width: 100% }
pre { background: #f5f5f3; padding: 1em; overflow-x: auto; font-size: 13px }
"""


def shade(axes: Any, record: Record) -> None:
    """Marks the phases of a flight."""
    for i, (_, begin, end) in enumerate(record.spans()):
        axes.axvspan(begin, end, color=SHADES[i % len(SHADES)], lw=0, zorder=0)
    axes.margins(x=0)


def overview(record: Record) -> Any:
    """The panels of the paper's figures 8 and 12, in the words of `tilthex plot`; one panel an axis."""
    figure, grid = plt.subplots(5, 2, figsize=(13, 14), sharex=True, layout="constrained")
    every = slice(None, None, 5)
    t = record.time[every]
    entries: dict[str, Any] = {}
    for name, colour in zip(AXES, COLOURS, strict=True):
        (entries[name],) = grid[0, 1].plot([], [], color=colour)

    def lines(axes: Any, values: Any, line: str, of: str, alpha: float = 1.0) -> None:
        for one, colour, axis in zip(axes, COLOURS, values[every].T, strict=True):
            one.plot(t, axis, line, color=colour, lw=1.0, alpha=alpha)
        (entries[of],) = grid[0, 1].plot([], [], line, color="0.2", alpha=alpha)

    # The angles of the robot: those of a tool that points forward would jump.
    mounted = record.tool_rotation[0].T @ record.robot_rotation[0]
    tip = record.robot_rotation[0].T @ (record.tool_position[0] - record.robot_position[0])
    estimated = record.estimated_position + record.estimated_rotation @ tip
    poses = (
        (record.setpoint_position, record.setpoint_rotation @ mounted, ":", "set-point", 1.0),
        (record.reference_position, record.reference_rotation @ mounted, "--", "reference", 1.0),
        (record.tool_position, record.robot_rotation, "-", "true", PALE),
        (estimated, record.estimated_rotation, "-", "estimated", 1.0),
    )
    angles = {}
    for position, rotation, line, of, alpha in poses:
        lines(grid[:3, 0], position, line, of, alpha)
        angles[of] = Rotation.from_matrix(rotation).as_euler("xyz", degrees=True)
        lines([grid[0, 1]] * 3, angles[of], line, of, alpha)
    lines([grid[3, 0]] * 3, 1e3 * record.position_error, "-", "estimated")
    lines([grid[1, 1]] * 3, np.degrees(record.rotation_error), "-", "estimated")
    for axes, k in ((grid[2, 1], 0), (grid[3, 1], 3)):
        estimate = record.wrench_contact[:, k : k + 3]
        lines([axes] * 3, record.true_wrench[:, k : k + 3], "-", "true", PALE)
        lines([axes] * 3, estimate, "-", "estimated")
        size = 1.2 * float(np.percentile(np.abs(estimate), 99.9)) + 1e-3
        axes.set_ylim(-size, size)
    off = 1e3 * (record.reference_position - record.setpoint_position)
    lines([grid[4, 0]] * 3, off, "--", "reference")
    lines([grid[4, 1]] * 3, angles["reference"] - angles["set-point"], "--", "reference")
    for axes in grid[:3, 0]:
        low, high = axes.get_ylim()
        if high - low < LEAST_SPAN:
            axes.set_ylim(0.5 * (low + high - LEAST_SPAN), 0.5 * (low + high + LEAST_SPAN))
        axes.ticklabel_format(axis="y", useOffset=False)
    for row, names in zip(grid, PANELS, strict=True):
        for axes, name in zip(row, names, strict=True):
            axes.set_ylabel(name)
            room = 0.012 * float(t[-1]) if axes in grid[0] else np.inf
            for i, (phase, begin, end) in enumerate(record.spans()):
                mark(axes, phase, begin, end, SHADES[i % len(SHADES)], room, fontsize=9)
            axes.margins(x=0)
    for axes in grid[4]:
        axes.set_xlabel("time, s")
    phases = ", ".join(dict.fromkeys(name for name, _, _ in record.spans()))
    figure.suptitle(f"{record.run}: {phases}")
    figure.legend(
        entries.values(), entries, loc="outside lower center", ncols=len(entries), fontsize=10, frameon=False
    )
    return figure


NO_CHECKS = "no checks: a module beside the file judges its flights (docs/howto/experiment.md)"


def table(checks: Sequence[Check]) -> str:
    """The checks as an HTML table."""
    if not checks:
        return f"<p>{NO_CHECKS}</p>"
    head, shown = _columns(checks)
    rows = ["<tr>" + "".join(f"<th>{name}" for name in head) + "<th>"]
    for check, cells in zip(checks, shown, strict=True):
        mark = {True: '<td class="pass">pass', False: '<td class="short">falls short', None: "<td>"}[
            check.passed
        ]
        rows.append("<tr>" + "".join(f"<td>{html.escape(cell)}" for cell in cells) + mark)
    return "<table>" + "\n".join(rows) + "</table>"


def _columns(checks: Sequence[Check]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """The heads and the cells; without the paper's values if there are none."""
    names = ("what", "required", *(("paper",) if any(check.paper for check in checks) else ()), "measured")
    return names, [tuple(getattr(check, name) for name in names) for check in checks]


def text_table(checks: Sequence[Check]) -> str:
    """The checks for a terminal."""
    if not checks:
        return NO_CHECKS
    head, shown = _columns(checks)
    rows = [("", *head)]
    for check, texts in zip(checks, shown, strict=True):
        rows.append(({True: "pass", False: "FALLS SHORT", None: "-"}[check.passed], *texts))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        mark, *cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        colour = {"pass": GREEN, "FALLS SHORT": RED}.get(row[0])
        mark = mark if colour is None else coloured(mark, colour, sys.stdout)
        lines.append("  ".join([mark, *cells]).rstrip())
    return "\n".join(lines)


def commit() -> str:
    """The version, and the commit of the sources if this runs from a checkout."""
    call = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        found = subprocess.run(call, capture_output=True, text=True, check=False).stdout.strip()
    except OSError:
        found = ""
    return f"{__version__} ({found})" if found else __version__


def slug(name: str) -> str:
    """A name for files, without blanks and without characters that a shell interprets."""
    return re.sub(r"[^A-Za-z0-9.]+", "-", name).strip("-")


def write(
    out: Path,
    name: str,
    title: str,
    about: str,
    checks: Sequence[Check],
    figures: Mapping[str, Any],
    parameters: str,
    command: str,
    notes: Sequence[str] = (),
) -> Path:
    """Writes `name.html` and one PNG per figure into `out`; returns the path of the HTML file."""
    out.mkdir(parents=True, exist_ok=True)
    parts = [f"<h1>{html.escape(title)}</h1>"]
    parts += [f"<p>{html.escape(p.strip())}</p>" for p in about.split("\n\n") if p.strip()]
    parts += [table(checks)]
    parts += [f"<p>{note}</p>" for note in notes]
    for key, figure in figures.items():
        path = out / f"{name}-{slug(key)}.png"
        figure.savefig(path, dpi=110)
        plt.close(figure)
        image = base64.b64encode(path.read_bytes()).decode()
        parts.append(f'<h2>{html.escape(key)}</h2><img alt="{key}" src="data:image/png;base64,{image}">')
    import mujoco

    parts.append(
        f"<h2>How it was made</h2><p>tilthex {html.escape(commit())}, MuJoCo {mujoco.__version__}, "
        f"Python {platform.python_version()}, {platform.machine()}</p><pre>{html.escape(command)}</pre>"
        f"<h2>Parameters</h2><pre>{html.escape(parameters)}</pre>"
    )
    page = out / f"{name}.html"
    head = f"<!doctype html><meta charset=utf-8><title>{html.escape(title)}</title><style>{STYLE}</style>"
    page.write_text(head + "\n".join(parts), encoding="utf-8")
    return page
