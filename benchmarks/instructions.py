"""Counts the instructions of the core's step functions, and of a simulated control period, with valgrind;
the counts do not depend on the load.

    python -m benchmarks.instructions

Builds `examples/instructions.rs` of the core and `examples/instructions_of_flight.rs` of the simulation, and
runs each of their cases under callgrind, in two runs of different length. The difference of their counts
does not contain the set-up.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = ROOT / "target" / "release" / "examples"
PROGRAM = EXAMPLES / "instructions"
PROGRAMS = (("tilthex-core", PROGRAM), ("tilthex-sim", EXAMPLES / "instructions_of_flight"))
SHORT, LONG = 200, 700


def build() -> None:
    """Builds the programs in cargo's usual target directory."""
    for package, program in PROGRAMS:
        command = ["cargo", "build", "--release", "--locked", "--quiet", "-p", package, "--example"]
        subprocess.run([*command, program.name], cwd=ROOT, check=True)


def names(program: Path) -> list[str]:
    """The cases that a program knows."""
    return subprocess.run([program], check=True, capture_output=True, text=True).stdout.splitlines()


def counted(program: Path, name: str, count: int) -> int:
    """Instructions of one run."""
    valgrind = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
    run = subprocess.run([*valgrind, program, name, str(count)], check=True, capture_output=True, text=True)
    found = re.search(r"Collected : (\d+)", run.stderr)
    if found is None:
        raise SystemExit(f"callgrind printed no count: {run.stderr[-300:]}")
    return int(found[1])


def instructions(program: Path, name: str) -> float:
    """Instructions of one step."""
    return (counted(program, name, LONG) - counted(program, name, SHORT)) / (LONG - SHORT)


def microseconds(name: str, count: int = 200_000, rounds: int = 5) -> float:
    """Time of one step, us: the least of some rounds, without the set-up."""

    def least(number: int) -> float:
        times = []
        for _ in range(rounds):
            begin = time.perf_counter()
            subprocess.run([PROGRAM, name, str(number)], check=True)
            times.append(time.perf_counter() - begin)
        return min(times)

    return 1e6 * (least(2 * count) - least(count)) / count


def main() -> None:
    """Prints the table."""
    if shutil.which("valgrind") is None:
        print("valgrind is missing: sudo apt-get install valgrind", file=sys.stderr)
        sys.exit(2)
    build()
    print("| step | instructions |\n|---|---|")
    for _, program in PROGRAMS:
        for name in names(program):
            print(f"| {name} | {instructions(program, name):.0f} |")


if __name__ == "__main__":
    main()
