"""`make results`: runs what `docs/results` shows and writes it, with date, machine and commit.

Each page is the output of commands; nothing is typed by hand. `python -m benchmarks.results NAME ...`
writes some of the pages; `--list` lists their names. All of them take about three hours on two cores.
"""

from __future__ import annotations

import argparse
import datetime
import os
import platform
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from benchmarks import wind

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "docs" / "results"
TERMINAL = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")


@dataclass(frozen=True)
class Page:
    """A page of results: its name, its title, and the commands whose output it shows.

    A page whose environment variable `needs` is not set stays as it is.
    """

    name: str
    title: str
    commands: tuple[str, ...]
    needs: str | None = None


PAGES = (
    Page(
        "experiments",
        "The paper's experiments",
        tuple(
            f"tilthex experiment {name} --out out/results"
            for name in ("shaping", "sliding", "multi-contact", "chirp", "pressing")
        ),
    ),
    Page(
        "peg-in-hole",
        "Peg in hole, random cases",
        (
            "tilthex experiment peg-in-hole --random 100 --seed 4091 --out out/results",
            "tilthex experiment peg-in-hole --random 40 --seed 4092 --out out/results/steep "
            "--set 'random.tilt_deg=[18.0,28.0]' --set 'random.friction=[0.2,0.45]'",
        ),
    ),
    Page(
        "wire",
        "Experiments through the wire",
        tuple(
            f"tilthex experiment {name} --wire --out out/results/wire"
            for name in ("sliding", "multi-contact")
        ),
    ),
    Page(
        "contact_stability",
        "Predicted and flown borders of stable contact",
        ("python -m benchmarks.contact_stability --cases 100 --first 9000",),
    ),
    Page(
        "contact",
        "Wind or contact: touches told from gusts",
        ("python -m benchmarks.contact --seeds 40 --first 7000",),
    ),
    Page(
        "model",
        "Vehicles that are not their model, after the calibration flight",
        tuple(
            f"tilthex experiment {name} --truth {truth} --calibration tilts --out out/results/{truth}"
            for truth in ("measured", "cad")
            for name in (
                "shaping --seed 4051",
                "sliding --seed 4052",
                "multi-contact --seed 4053",
                "peg-in-hole --random 100 --seed 4054",
            )
        ),
    ),
    Page(
        "false_contact",
        "False contact of vehicles that are not their model",
        ("python -m benchmarks.false_contact --seeds 100 --first 3200",),
    ),
    Page(
        "free_air",
        "False contact in motion and the turn of a soft wrist, after the calibration flight",
        ("python -m benchmarks.free_air --truth measured --truth cad --seeds 20 --first 6521",),
    ),
    Page(
        "pull",
        "Error of the observed force under a pull, after the calibration flight (rms, mN)",
        ("python -m benchmarks.pull --truth measured --truth cad --seeds 24 --first 6231",),
    ),
    Page(
        "wind",
        "Vehicles from their drawings in a wind of 3 m/s with gusts, after the calibration flight",
        tuple(
            f"tilthex experiment {name} --truth benchmarks/{wind.FILE.name} --calibration tilts "
            f"{wind.options()} --out out/results/wind"
            for name in (
                "shaping --short --seed 4061 --set config.contact.point_contact=true",
                "sliding --seed 4062 --set config.contact.point_contact=true",
                "multi-contact --seed 4063 --set config.contact.point_contact=true",
                "peg-in-hole --random 100 --seed 4064",
            )
        ),
    ),
    Page(
        "consistency",
        "Consistency of the estimator",
        (
            "TILTHEX_FLIGHTS=200 cargo test --release --locked -p tilthex-core --test consistency "
            "-- --nocapture",
        ),
    ),
    Page(
        "recordings",
        "The estimator on recordings",
        ("python -m benchmarks.broad", "python -m benchmarks.ungated"),
    ),
    Page(
        "identification",
        "What fit finds in the flight of excite",
        ("python -m benchmarks.identify 30001 200",),
    ),
    Page(
        "speed",
        "Processor time of the estimator",
        ("python -m benchmarks.ukf", "cargo bench --locked --quiet -p tilthex-core --bench ukf"),
    ),
    Page("bench", "The laws and the closed loop beside NumPy and numba", ("python -m benchmarks",)),
    Page(
        "margins",
        "Margins of the default and the derived gains",
        tuple(
            f"tilthex tune {name}"
            for name in ("tilt-hex", "omnidirectional-octorotor", "hexarotor", "quadrotor")
        ),
    ),
    Page(
        "manoeuvres", "Manoeuvres at the rotors' limits", ("tilthex manoeuvres --out out/results/manoeuvres",)
    ),
    Page(
        "allocation",
        "The allocator against quadprog",
        ("python -m benchmarks.lexicographic --number 10000 --seed 5001",),
    ),
    Page("instructions", "Instructions of a step", ("python -m benchmarks.instructions",)),
    Page("onboard", "On board: a Cortex-M7", ("make --silent onboard",)),
    Page("px4", "PX4's own firmware in software", ("python -m benchmarks.px4_sitl",), needs="PX4_BUILD"),
    Page("timing", "The loop's timing beside other load", ("benchmarks/rt.sh 600 stress compile",)),
    Page(
        "campaign",
        "The fault campaign",
        ("target/release/tilthex-rt campaign --number 10000 --seed 2480001",),
    ),
)


def main() -> None:
    """Writes the pages with the given names, or all pages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", nargs="*", help="pages to write (default: all)")
    parser.add_argument("--list", action="store_true", help="name the pages and end")
    arguments = parser.parse_args()
    if arguments.list:
        print("\n".join(page.name for page in PAGES))
        return
    known = {page.name: page for page in PAGES}
    unknown = [name for name in arguments.name if name not in known]
    if unknown:
        parser.error(f"no page is named {unknown[0]}; expected one of {', '.join(known)}")
    RESULTS.mkdir(parents=True, exist_ok=True)
    for name in arguments.name or known:
        if known[name].needs and not os.environ.get(known[name].needs):
            print(f"{name}: left as it is, because {known[name].needs} is not set")
            continue
        print(f"{name} ...", flush=True)
        (RESULTS / f"{name}.md").write_text(page_text(known[name]))


def page_text(page: Page) -> str:
    """A page in Markdown."""
    lines = [f"# {page.title}", "", f"Written by `make results`. {_circumstances()}", ""]
    for command in page.commands:
        lines += [f"    {command}", "", "```text", _output(command), "```", ""]
    return "\n".join(lines)


def _circumstances() -> str:
    commit = _git("rev-parse", "--short", "HEAD")
    changed = ", with uncommitted changes" if _git("status", "--porcelain", "--untracked-files=no") else ""
    date = datetime.datetime.now(datetime.timezone.utc).date()
    return f"{date}, {platform.machine()} with {os.cpu_count()} processors, commit {commit}{changed}."


def _git(*arguments: str) -> str:
    return subprocess.run(
        ["git", *arguments], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.strip()


def _output(command: str) -> str:
    """The output of a command, without progress bars, and its exit status if that is not 0."""
    path = str(Path(sys.executable).parent) + os.pathsep + os.environ.get("PATH", "")
    done = subprocess.run(
        command,
        shell=True,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=os.environ | {"PATH": path},
    )
    text = TERMINAL.sub("", done.stdout).rstrip()
    return text if done.returncode == 0 else f"{text}\n(exit status {done.returncode})"


if __name__ == "__main__":
    main()
