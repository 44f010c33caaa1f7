"""Writes `docs/troubleshooting.md`: what a person sees, and the faults and failures that cause it.

The faults are those of `docs/faults.md`, the exit statuses those of `tilthex-rt`. `SYMPTOMS` says which
faults a person meets where; a test wants every fault there, and the page as this program writes it.
"""

from __future__ import annotations

import re
import textwrap
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "troubleshooting.md"
FAULTS = ROOT / "docs" / "faults.md"
FAILURES = ROOT / "crates" / "tilthex-rt" / "src" / "failure.rs"
WIDTH = 110
"""Longest line outside of the tables."""
STATUS = re.compile(r"((?: +/// .+\n)+) +(\w+),")


class Fault(NamedTuple):
    """A row of the table of faults."""

    name: str
    seen_by: str
    on_ground: str
    in_flight: str
    remark: str


class Symptom(NamedTuple):
    """What a person sees, a sentence about it, and the faults that are behind it."""

    title: str
    about: str
    faults: tuple[str, ...]


SYMPTOMS = (
    Symptom(
        "The motors do not start, or they stop before the take-off",
        "On the ground every fault whose reaction there is *refuse* prevents the start. `tilthex-rt doctor` "
        "checks computer, vehicle and motion capture before a flight. The usual faults are:",
        (
            "start timeout",
            "motor check",
            "motor emergency",
            "battery low",
            "battery critical",
            "geofence",
            "reboot",
            "link garbage",
        ),
    ),
    Symptom(
        "Just after lift-off the vehicle turns or moves, and its motors stop",
        "The vehicle and its description do not agree. Do not start again before you have found out why.",
        ("motor order", "capture axes", "capture mirrored", "capture late", "lift-off"),
    ),
    Symptom(
        "The vehicle waits at its place and does not follow the mission",
        "It holds. The mission continues by itself when the cause is gone.",
        (
            "set-point stale",
            "set-point refused",
            "set-point infeasible",
            "excursion",
            "tool astray",
            "external wrench",
            "operator silent",
            "pose lost",
            "pose jumping",
            "pose frozen",
            "link garbage",
            "long loop overrun",
        ),
    ),
    Symptom(
        "The vehicle lands although nobody ordered it: sensors and poses",
        "The last lines of the program and `/flight` of the log name the fault.",
        (
            "IMU silent",
            "IMU frozen",
            "IMU saturated",
            "pose lost for long",
            "pose contradicts the IMU",
            "estimate inconsistent",
        ),
    ),
    Symptom(
        "The vehicle lands although nobody ordered it: motors and battery",
        "A rotor does not do what it was told, or the battery is empty.",
        (
            "motor data silent",
            "motor data wrong",
            "motor emergency",
            "motor not spinning",
            "motor at a wrong speed",
            "command not followed",
            "thrust lost",
            "battery low",
            "battery critical",
        ),
    ),
    Symptom(
        "The vehicle lands although nobody ordered it: motion, place and operator",
        "The vehicle is not where it should be, or nobody watches it.",
        (
            "tracking error",
            "tilt",
            "speed",
            "geofence",
            "operator gone",
            "operator",
            "reboot",
            "line late",
            "not finite",
        ),
    ),
    Symptom(
        "The vehicle sinks level and drifts",
        "It descends without knowing its place, or without enough rotors. Keep away from it.",
        ("pose lost for good", "estimate uncertain", "rotor lost", "link lost", "landing fails"),
    ),
    Symptom(
        "The tool reports or yields to a force that is not there",
        "The model is wrong, or the bias is. A calibration flight learns the model ([truth.md](truth.md)).",
        ("bias not learnt", "calibration refused", "external wrench", "excursion"),
    ),
    Symptom(
        "The flight goes on, but the summary names a fault",
        "Something was replaced or left out. One such line is no reason to worry, many are.",
        (
            "IMU late",
            "IMU out of range",
            "motor data stale",
            "pose late",
            "capture clock",
            "loop overrun",
            "log lost",
        ),
    ),
)

HEAD = """# Troubleshooting by symptom

Find what you see; the tables name the faults that cause it, as the program and the log name them.
[faults.md](faults.md) lists all faults by number, with their times, and says what the reactions mean. This
page is written by `python packaging/troubleshooting.py` from that table and from the exit statuses of
`tilthex-rt`.
"""
EXITS = """
## The program ended

The exit status says why (`echo $?`), and the last line on standard error says it in a sentence.
[loop.md](loop.md) has the cases.

| exit status | meaning |
|---|---|
| 0 | done |
"""


def faults() -> dict[str, Fault]:
    """The faults by their names."""
    rows = (line.strip("| \n") for line in FAULTS.read_text(encoding="utf-8").splitlines())
    cells = (re.split(r" ?\| ?", row) for row in rows if re.match(r"\d+ \|", row))
    # An empty remark disappears with the end of its row.
    full = ([*row, ""] if len(row) == 7 else row for row in cells)
    return {row[1]: Fault(row[1], row[2], row[5], row[6], row[7]) for row in full}


def statuses() -> list[tuple[int, str]]:
    """The exit statuses of `tilthex-rt` other than 0, and their meanings."""
    body = FAILURES.read_text(encoding="utf-8").partition("pub enum Kind {")[2].partition("\n}")[0]
    found = []
    for comment, _ in STATUS.findall(body):
        text = " ".join(line.strip(" /") for line in comment.strip().splitlines())
        meaning, _, number = text.rstrip(".").rpartition(": ")
        found.append((int(number), meaning[0].lower() + meaning[1:]))
    return found


def text() -> str:
    """The page."""
    known = faults()
    lines = [HEAD]
    for symptom in SYMPTOMS:
        lines += [f"## {symptom.title}", "", textwrap.fill(symptom.about, WIDTH), ""]
        lines += [
            "| the program names | because of | on the ground | in flight | remark |",
            "|---|---|---|---|---|",
        ]
        for name in symptom.faults:
            fault = known[name]
            lines.append(" | ".join(("| **" + fault.name + "**", *fault[1:])).rstrip() + " |")
        lines.append("")
    rows = [f"| {number} | {meaning} |" for number, meaning in statuses()]
    return "\n".join(lines).rstrip() + "\n" + EXITS + "\n".join(rows) + "\n"


if __name__ == "__main__":
    PAGE.write_text(text(), encoding="utf-8")
