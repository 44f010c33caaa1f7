"""`tilthex tune`: derives gains from a vehicle, with the reasons (docs/stability.md)."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tilthex import Config, LoopModel, _json
from tilthex.check import (
    DAMPING_TIME,
    LARGEST_PEAK,
    LEAST_PHASE_MARGIN,
    border,
    drawn,
    named,
)

DRAWS = 20
"""Number of vehicles that are drawn from *measured*."""


def add_parser(subparsers: Any) -> None:
    """Registers the command with the parsers of `tilthex`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "tune",
        help="derive gains from a vehicle",
        description="Derives the gains of pose control and observer from the rotors' lag, the delays and "
        "the vehicle's dynamics, and prints them as TOML with the reasons.",
    )
    parser.add_argument("config", help="a configuration, a vehicle's TOML file, or a preset")
    parser.add_argument("--out", type=Path, help="write the sections to this file")
    _json.add_option(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Prints the sections, or writes them."""
    config = named(arguments.config)
    config.check_hover()
    found = summary(config)
    if arguments.json:
        _json.say(found)
        if not arguments.out:
            return
    text = "\n".join(tuned(config, found)) + "\n"
    if arguments.out:
        arguments.out.write_text(text, encoding="utf-8")
    if not arguments.json:
        sys.stdout.write(f"written: {arguments.out}\n" if arguments.out else text)


def summary(config: Config) -> dict[str, Any]:
    """The derived sections, and the margins of each axis before, now, and at the worst of drawn vehicles."""
    sections = LoopModel(config).derive()
    result = config.replace(**sections)
    return {
        "sections": sections,
        "axes": LoopModel.axes,
        "before": LoopModel(config).hover(),
        "now": LoopModel(result).hover(),
        "drawn": drawn(result, "measured", DRAWS),
    }


def tuned(config: Config, found: dict[str, Any]) -> Iterator[str]:
    """The lines of the sections `pose_control` and `wrench_observer`, with the reasons for the gains."""
    sections, before, now, spread = found["sections"], found["before"], found["now"], found["drawn"]
    yield f"# Derived by `tilthex tune` for {config.vehicle.name}: the fastest critically damped loops with"
    yield f"# {LEAST_PHASE_MARGIN:g} degrees of phase margin and a sensitivity peak of {LARGEST_PEAK:g}."
    yield f"# axis   before        now           worst of {DRAWS} vehicles of measured"
    for i, axis in enumerate(found["axes"]):
        yield (
            f"# {axis:5} {before['phase_margin_deg'][i]:5.1f} {before['sensitivity_peak'][i]:5.2f}   "
            f"{now['phase_margin_deg'][i]:5.1f} {now['sensitivity_peak'][i]:5.2f}   "
            f"{spread.phase_margin_deg[i]:5.1f} {spread.sensitivity_peak[i]:5.2f}"
        )
    yield "[pose_control]"
    yield "# Squares and doubles of the loops' double poles; the rotors' lag and the loop's delay bound them."
    yield from (f"{key} = {value}" for key, value in sections["pose_control"].items())
    yield ""
    yield "[wrench_observer]"
    yield "# At most 30 1/s and 1/0.3 of the loop's pole; 4 1/s for force where tilting stands between."
    yield from (f"{key} = {value}" for key, value in sections["wrench_observer"].items())
    yield ""
    model = LoopModel(config.replace(**sections))
    yield f"# [admittance] as it is: contact with {1e3 * DAMPING_TIME:g} ms of damping is stable up to"
    for name, direction in zip("xyz", np.eye(3), strict=True):
        yield f"#   along {name}: {border(model.contact(along=direction, damping_time=DAMPING_TIME), 'N/m')}"
