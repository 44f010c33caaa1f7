"""Counts the instructions of the core's step functions with valgrind; the counts do not depend on the
load.

    python -m benchmarks.instructions

Builds `examples/instructions.rs` of the core and runs each step function under callgrind, in two runs of
different length. The difference of their counts does not contain the set-up.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = ROOT / "target" / "release" / "examples" / "instructions"
SHORT, LONG = 200, 700


def build() -> None:
    """Builds the program in cargo's usual target directory."""
    command = ["cargo", "build", "--release", "--locked", "--quiet", "-p", "tilthex-core", "--example"]
    subprocess.run([*command, "instructions"], cwd=ROOT, check=True)


def names() -> list[str]:
    """The step functions that the program knows."""
    return subprocess.run([PROGRAM], check=True, capture_output=True, text=True).stdout.splitlines()


def counted(name: str, count: int) -> int:
    """Instructions of one run."""
    valgrind = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
    run = subprocess.run([*valgrind, PROGRAM, name, str(count)], check=True, capture_output=True, text=True)
    found = re.search(r"Collected : (\d+)", run.stderr)
    if found is None:
        raise SystemExit(f"callgrind printed no count: {run.stderr[-300:]}")
    return int(found[1])


def instructions(name: str) -> float:
    """Instructions of one step."""
    return (counted(name, LONG) - counted(name, SHORT)) / (LONG - SHORT)


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
    for name in names():
        print(f"| {name} | {instructions(name):.0f} |")


if __name__ == "__main__":
    main()
