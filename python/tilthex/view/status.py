"""The words and numbers of the page: phase, faults with their reactions, battery, ages, margins."""

from __future__ import annotations

import math
from html import escape

import numpy as np

from tilthex._faults import FAULTS
from tilthex.log import GROUNDED
from tilthex.view.geometry import Reach
from tilthex.view.sample import Sample

COLOURS = {
    "flying": "#2b8a3e",
    "holding": "#e67700",
    "landing": "#e67700",
    "emergency": "#c92a2a",
}
"""Colour of a phase; the others are grey."""
FOUND = {fault.name: fault for fault in FAULTS}
LATE = 0.5
"""A state older than this is shown as old, s."""


def html(sample: Sample, reach: Reach, link_age: float | None = None) -> str:
    """The panel of a moment.

    Args:
        sample: The values.
        reach: The attainable forces of the vehicle.
        link_age: Time since the last message of the flight, s; None for a log.
    """
    rows = [("battery", _unit(sample.battery, "V", 1)), ("newest pose", _milliseconds(sample.pose_age))]
    if link_age is not None:
        rows.insert(0, ("newest state", _milliseconds(link_age)))
        rows.append(("controls", sample.controls or "nobody"))
    force, torque = float(np.linalg.norm(sample.force)), float(np.linalg.norm(sample.torque))
    rows += [
        ("tool wrench", f"{_unit(force, 'N', 2)}, {_unit(torque, 'N m', 2)}"),
        ("contact moves the tool", "yes" if sample.compliant else "no"),
        *_margins(sample, reach),
        ("not given by the rotors", sample.given_up or "nothing"),
    ]
    colour = COLOURS.get(sample.phase, "#868e96")
    head = (
        f'<div id="tilthex-phase" style="background:{colour};color:white;font-size:1.4em;font-weight:bold;'
        f'text-align:center;border-radius:4px;padding:2px">{escape(sample.phase)}</div>'
    )
    if link_age is not None and link_age > LATE:
        head += _banner(f"no message from the flight for {link_age:.1f} s: the values are old")
    faults = "".join(_fault(name, sample.phase) for name in sample.faults)
    table = "".join(f"<tr><td>{name}&ensp;</td><td><b>{escape(text)}</b></td></tr>" for name, text in rows)
    return (
        f'<div style="font-size:0.8em;padding:0 0.7em">{head}<div id="tilthex-faults">{faults}</div>'
        f"<table>{table}</table></div>"
    )


def _margins(sample: Sample, reach: Reach) -> list[tuple[str, str]]:
    if sample.phase in GROUNDED or not np.isfinite(sample.rotor_speeds).all():
        return [("margin of force", "-"), ("rotor loads", "-")]
    loads = reach.loads(sample.rotor_speeds)
    margin = reach.margin(sample.rotor_speeds)
    shown = "none sideways" if math.isinf(margin) else _unit(margin, "N", 1)
    return [
        ("margin of force", shown),
        ("rotor loads", f"{100 * loads.min():.0f} to {100 * loads.max():.0f} %"),
    ]


def _fault(name: str, phase: str) -> str:
    fault = FOUND.get(name)
    if fault is None:
        return _banner(name)
    reaction = fault.on_ground if phase in GROUNDED else fault.in_flight
    remark = f": {fault.remark}" if fault.remark else ""
    return _banner(f"{name} - {reaction}{remark}")


def _banner(text: str) -> str:
    style = "background:#ffe3e3;color:#862e2e;border-radius:4px;margin:2px 0;padding:1px 4px"
    return f'<div style="{style}">{escape(text)}</div>'


def _unit(value: float, unit: str, digits: int) -> str:
    return f"{value:.{digits}f} {unit}" if math.isfinite(value) else "unknown"


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms ago" if math.isfinite(seconds) else "none yet"
