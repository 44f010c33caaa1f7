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
    """Prints the sections."""
    if arguments.json:
        config = named(arguments.config)
        sections = LoopModel(config).derive()
        margins = {
            name: LoopModel(one).hover()
            for name, one in (("before", config), ("now", config.replace(**sections)))
        }
        _json.say({"sections": sections, "axes": LoopModel.axes} | margins)
        return
    text = "\n".join(tuned(named(arguments.config))) + "\n"
    if arguments.out:
        arguments.out.write_text(text, encoding="utf-8")
        print(f"written: {arguments.out}")
    else:
        sys.stdout.write(text)


def tuned(config: Config) -> Iterator[str]:
    """The lines of the sections `pose_control` and `wrench_observer`, with the reasons for the gains."""
    sections = LoopModel(config).derive()
    result = config.replace(**sections)
    model, before = LoopModel(result), LoopModel(config).hover()
    found, spread = model.hover(), drawn(result, "measured", DRAWS)
    yield f"# Derived by `tilthex tune` for {config.vehicle.name}: the fastest critically damped loops with"
    yield f"# {LEAST_PHASE_MARGIN:g} degrees of phase margin and a sensitivity peak of {LARGEST_PEAK:g}."
    yield f"# axis   before        now           worst of {DRAWS} vehicles of measured"
    for i, axis in enumerate(model.axes):
        yield (
            f"# {axis:5} {before['phase_margin_deg'][i]:5.1f} {before['sensitivity_peak'][i]:5.2f}   "
            f"{found['phase_margin_deg'][i]:5.1f} {found['sensitivity_peak'][i]:5.2f}   "
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
    yield f"# [admittance] as it is: contact with {1e3 * DAMPING_TIME:g} ms of damping is stable up to"
    for name, direction in zip("xyz", np.eye(3), strict=True):
        yield f"#   along {name}: {border(model.contact(along=direction, damping_time=DAMPING_TIME), 'N/m')}"
