"""The flight as `diagnostic_msgs/DiagnosticArray`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tilthex._logged import State

NAME = "tilthex: flight"
"""Name of the status."""
ALARMING = ("landing", "emergency")
"""Phases in which an active fault is an error."""


def level(state: State) -> int:
    """0: good; 1: a fault is active, the vehicle holds, or a rotor is at its limit; 2: a fault lands it."""
    if state["faults"] and state["phase"] in ALARMING:
        return 2
    return int(bool(state["faults"]) or state["phase"] == "holding" or state["saturated"])


def message(state: State) -> str:
    """The phase, and the active faults."""
    return ": ".join([state["phase"], ", ".join(state["faults"])] if state["faults"] else [state["phase"]])


def values(state: State, counts: Mapping[str, int]) -> dict[str, str]:
    """The values of the status, with units in the names. `counts` are the counters of the bridge."""
    battery, age, latency = state["battery"], state["pose_age"], state["latency"]
    return {
        "phase": state["phase"],
        "faults": ", ".join(state["faults"]),
        "controls": state["controls"] or "nobody",
        "battery (V)": _number(battery),
        "pose age (s)": _number(age),
        "pose latency (s)": _number(latency),
        "compliant": str(state["compliant"]),
        "rotor at its limit": str(state["saturated"]),
        "given up": state["given_up"] or "nothing",
        "contact likelihood": _number(state["contact_likelihood"]),
        "periods skipped": str(state["late"]),
        "requests refused": str(state["refused"]),
        **{name: str(count) for name, count in counts.items()},
    }


def _number(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.4g}"


def status(make: Any, state: State, counts: Mapping[str, int]) -> Any:
    """The status. `make(kind, *fields)` makes a message from its fields in their order."""
    listed = [make("diagnostic_msgs/msg/KeyValue", *pair) for pair in values(state, counts).items()]
    return make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        bytes([level(state)]),
        NAME,
        message(state),
        state["controls"] or "",
        listed,
    )
