"""`tilthex plot`: draws a flight's log."""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tilthex import Config, Vehicle, log
from tilthex._quaternions import rotations_from_quaternions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[Any]
OUT = "picture to write: .png, or .pdf or .svg for vector graphics (default: LOG with .png instead of .mcap)"
PANELS = (
    "tool position, m",
    "robot: roll, pitch, yaw, deg",
    "position error, mm",
    "rotation error $e_R$, 1",
    "tool force, N",
    "tool torque, N m",
    "reference - set-point, mm",
    "rotor speed, Hz",
)
COLOURS = ("tab:blue", "tab:red", "tab:orange")
SHADES = {"flying": "#e3f4e3", "holding": "#e3ecfa", "landing": "#faf0dc", "emergency": "#f7e1e1"}
"""Phases in the air. On the ground the paper is white."""
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
        drawn.savefig(out, dpi=160)
    print(out)


def figure(path: str | Path) -> Figure:
    """The panels of the paper's figures 8 and 12, as wide as a page, for the flight of a log.

    Errors, force and torque are scaled to what they are in free flight: the ground at a landing exerts more.
    """
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise ImportError(
            "drawing needs matplotlib, which is not installed: pip install 'tilthex[analysis]'"
        ) from error

    flight = log.Log(path)
    # A simulated vehicle has true values in its log; a real one has none.
    topics = {name: flight.columns(name) for name in (*TOPICS, *({"/truth"} & set(flight.topics)))}
    begin = topics["/flight"]["log_time"][0]
    free = np.isin(topics["/flight"]["phase"], log.FREE_FLIGHT)
    with plt.rc_context({"font.size": 8, "axes.labelsize": 8, "lines.linewidth": 0.8}):
        drawn, axes = plt.subplots(4, 2, figsize=(7.2, 8.0), sharex=True, layout="constrained")
        for name, panel in zip(PANELS, axes.flat, strict=True):
            panel.set_ylabel(name)
        entries: dict[str, Any] = {}
        for letter, colour in zip("xyz", COLOURS, strict=True):
            (entries[letter],) = axes[0, 0].plot([], [], color=colour)

        def lines(panel: Any, topic: str, values: Array, style: str, of: str, pale: float = 1.0) -> None:
            time = topics[topic]["log_time"] - begin
            for colour, column in zip(COLOURS, values.T, strict=True):
                panel.plot(time, column, style, color=colour, alpha=pale)
            (entries[of],) = panel.plot([], [], style, color="0.2", alpha=pale)

        poses = _poses(topics, Config.from_text(flight.configuration).vehicle)
        for (topic, (position, rotation)), style, of in zip(
            poses.items(), (":", "--", "-"), ("set-point", "reference", "estimated"), strict=True
        ):
            lines(axes[0, 0], topic, position, style, of)
            lines(axes[0, 1], topic, _angles(rotation), style, of)
        control, wrench = topics["/control"], topics["/wrench"]
        lines(axes[1, 0], "/control", 1e3 * control["position_error_w"], "-", "estimated")
        lines(axes[1, 1], "/control", control["rotation_error_r"], "-", "estimated")
        for panel, of in zip(axes[2], ("force", "torque"), strict=True):
            if "/truth" in topics:
                lines(panel, "/truth", topics["/truth"][f"tool_wrench_w.{of}"], "-", "true", pale=0.4)
            lines(panel, "/wrench", wrench[f"tool_w.{of}"], "-", "estimated")
        off = poses["/reference"][0] - poses["/setpoint"][0]
        lines(axes[3, 0], "/reference", 1e3 * off, "--", "reference")
        rotors = topics["/rotors"]["measured"]
        shades = plt.get_cmap("viridis")(np.linspace(0.0, 0.9, rotors.shape[1]))
        time = topics["/rotors"]["log_time"] - begin
        for speeds, colour in zip(rotors.T, shades, strict=True):
            axes[3, 1].plot(time, speeds, color=colour)
        for k in (0, len(shades) - 1):
            (entries[f"rotor {k + 1}"],) = axes[3, 1].plot([], [], color=shades[k])
        for panel, values in (
            (axes[1, 0], 1e3 * control["position_error_w"]),
            (axes[1, 1], control["rotation_error_r"]),
            (axes[2, 0], wrench["tool_w.force"]),
            (axes[2, 1], wrench["tool_w.torque"]),
        ):
            _scale(panel, values[free])
        for panel in axes.flat:
            _phases(panel, topics["/flight"], begin, named=panel in axes[0])
        for panel in axes[3]:
            panel.set_xlabel("time, s")
        drawn.legend(
            entries.values(),
            entries,
            loc="outside upper center",
            ncols=len(entries),
            columnspacing=1.2,
            handlelength=1.6,
            frameon=False,
        )
    return drawn


def _poses(topics: dict[str, log.Columns], vehicle: Vehicle) -> dict[str, tuple[Array, Array]]:
    """Positions of the tool, W, and orientations of the robot, by their topic. NaN where there are none.

    Targets are only in the air. Until a pose is applied, its age is the whole time of the clock.
    """
    unknown = dict.fromkeys(("/setpoint", "/reference"), ~log.flying(topics["/flight"]["phase"]))
    unknown["/state"] = topics["/state"]["pose_age"] >= topics["/state"]["time"]
    found = {}
    for topic, none in unknown.items():
        columns = topics[topic]
        position, rotation = columns["position_w"], rotations_from_quaternions(columns["orientation"])
        if topic == "/state":
            position = position + rotation @ vehicle.tool_position
        else:
            rotation = rotation @ vehicle.tool_rotation.T
        found[topic] = (
            np.where(none[:, None], np.nan, position),
            np.where(none[:, None, None], np.nan, rotation),
        )
    return found


def _angles(rotations: Array) -> Array:
    """Roll, pitch and yaw, degrees; NaN where there is no orientation."""
    from scipy.spatial.transform import Rotation

    found = np.full((len(rotations), 3), np.nan)
    known = np.isfinite(rotations).all(axis=(1, 2))
    found[known] = Rotation.from_matrix(rotations[known]).as_euler("xyz", degrees=True)
    return found


def _scale(panel: Any, values: Array) -> None:
    """Scales a panel to some values, if there are any."""
    values = values[np.isfinite(values).all(axis=1)]
    if len(values) and np.ptp(values) > 0.0:
        margin = 0.1 * float(np.ptp(values))
        panel.set_ylim(values.min() - margin, values.max() + margin)


def _phases(panel: Any, flight: log.Columns, begin: float, *, named: bool) -> None:
    """Marks the phases of a flight, with their names if they are long enough for it."""
    time, phase = flight["log_time"] - begin, flight["phase"]
    edges = [0, *(np.flatnonzero(phase[1:] != phase[:-1]) + 1).tolist(), len(time) - 1]
    for first, last in itertools.pairwise(edges):
        name = str(phase[first])
        room = 0.017 * time[-1] if named else np.inf
        mark(panel, name, time[first], time[last], SHADES.get(name, "1.0"), room, fontsize=7)
    panel.margins(x=0)


def mark(panel: Any, name: str, begin: float, end: float, shade: str, room: float, fontsize: float) -> None:
    """Shades a phase, and names it above the panel if every letter gets `room`, s."""
    panel.axvspan(begin, end, color=shade, lw=0, zorder=0)
    if end - begin > room * len(name):
        middle, above = 0.5 * (begin + end), panel.get_xaxis_transform()
        panel.text(middle, 1.02, name, transform=above, ha="center", fontsize=fontsize, color="0.3")


__all__ = ["add_parser", "figure"]
