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

AXES = ("x", "y", "z")
COLOURS = ("tab:blue", "tab:red", "tab:orange")
SHADES = ("0.93", "#e3f4e3", "#e3ecfa", "#faf0dc", "#f7e1e1", "#ece4f5")
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
    """The eight panels of the paper's figures 8 and 12."""
    figure, grid = plt.subplots(4, 2, figsize=(13, 13), sharex=True, layout="constrained")
    t, every = record.time, slice(None, None, 5)
    # The angles of the robot: those of a tool that points forward would jump.
    mounted = record.tool_rotation[0].T @ record.robot_rotation[0]
    desired, reference, actual = (
        Rotation.from_matrix(m[every] @ mounted).as_euler("xyz", degrees=True)
        for m in (record.setpoint_rotation, record.reference_rotation, record.tool_rotation)
    )
    for i, (name, colour) in enumerate(zip(AXES, COLOURS, strict=True)):
        for axes, three in (
            (grid[0, 0], (record.setpoint_position, record.reference_position, record.tool_position)),
            (grid[0, 1], (desired, reference, actual)),
        ):
            for values, line, label in zip(
                three, (":", "--", "-"), ("desired", "reference", name), strict=True
            ):
                ticks = t[every] if len(values) != len(t) else t
                axes.plot(
                    ticks, values[:, i], line, color=colour, lw=1.2, label=label if line == "-" else None
                )
        grid[1, 0].plot(t, 1e3 * record.position_error[:, i], color=colour, lw=0.8)
        grid[1, 1].plot(t, np.degrees(record.rotation_error[:, i]), color=colour, lw=0.8)
        for axes, k in ((grid[2, 0], i), (grid[2, 1], 3 + i)):
            axes.plot(t, record.true_wrench[:, k], color=colour, lw=0.8, alpha=0.45)
            axes.plot(t, record.wrench_contact[:, k], color=colour, lw=1.0)
        off = record.reference_position - record.setpoint_position
        grid[3, 0].plot(t, off[:, i], color=colour)
        grid[3, 1].plot(t[every], (reference - desired)[:, i], color=colour)
    labels = (
        ("tool position (m): desired :, reference --, actual -", "roll, pitch, yaw of the robot (deg)"),
        ("position error (mm)", "orientation error (deg)"),
        ("tool force (N): estimated, true pale", "tool torque (N m): estimated, true pale"),
        ("reference - desired (m)", "reference - desired (deg)"),
    )
    for row, names in zip(grid, labels, strict=True):
        for axes, name in zip(row, names, strict=True):
            axes.set_title(name, fontsize=10, loc="left")
            shade(axes, record)
    grid[0, 0].legend(loc="upper right", ncols=3, fontsize=9)
    for axes, k in ((grid[2, 0], 0), (grid[2, 1], 3)):
        estimate = record.wrench_contact[:, k : k + 3]
        size = 1.2 * float(np.percentile(np.abs(estimate), 99.9)) + 1e-3
        axes.set_ylim(-size, size)
    for axes in grid[3]:
        axes.set_xlabel("time (s)")
    figure.suptitle(record.run + " - " + ", ".join(dict.fromkeys(name for name, _, _ in record.spans())))
    return figure


NO_CHECKS = "no checks: a module beside the file judges its flights (docs/howto/experiment.md)"


def table(checks: Sequence[Check]) -> str:
    """The checks as an HTML table."""
    if not checks:
        return f"<p>{NO_CHECKS}</p>"
    rows = ["<tr><th>what<th>required<th>paper<th>measured<th>"]
    for check in checks:
        mark = {True: '<td class="pass">pass', False: '<td class="short">falls short', None: "<td>"}[
            check.passed
        ]
        cells = (check.what, check.required, check.paper, check.measured)
        rows.append("<tr>" + "".join(f"<td>{html.escape(cell)}" for cell in cells) + mark)
    return "<table>" + "\n".join(rows) + "</table>"


def text_table(checks: Sequence[Check]) -> str:
    """The checks for a terminal."""
    if not checks:
        return NO_CHECKS
    rows = [("", "what", "required", "paper", "measured")]
    for check in checks:
        mark = {True: "pass", False: "FALLS SHORT", None: "-"}[check.passed]
        rows.append((mark, check.what, check.required, check.paper, check.measured))
    widths = [max(len(row[i]) for row in rows) for i in range(5)]
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
