"""The command line of benchmarks that fly drawn vehicles."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import tilthex


@dataclass(frozen=True)
class Drawn:
    """The vehicles that fly: a model, the truth levels from which they are drawn, and seeds."""

    vehicle: tilthex.Vehicle
    truths: list[str]
    seeds: range


def drawn(description: str | None) -> Drawn:
    """Parses the command line."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--vehicle", default="tilt-hex", help="a preset or a TOML file")
    parser.add_argument("--truth", action="append", help="a level, any number of times")
    parser.add_argument("--seeds", type=int, default=40, help="how many vehicles of each level")
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    arguments = parser.parse_args()
    return Drawn(
        tilthex.Vehicle.named(arguments.vehicle),
        arguments.truth or ["exact", "measured", "cad"],
        range(arguments.first, arguments.first + arguments.seeds),
    )
