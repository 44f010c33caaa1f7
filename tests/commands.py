"""The commands of the pages: how they are found, and what differs where a test runs them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGES = sorted(
    page.relative_to(ROOT).as_posix()
    for pattern in ("*.md", "docs/*.md", "docs/howto/*.md", "docs/api/*.md", "examples/*.md")
    for page in ROOT.glob(pattern)
    # What a version had is no advice for this one.
    if page.name != "CHANGELOG.md"
)
OURS = r"tilthex|tilthex-rt|tilthex-sim"
PROGRAM = re.compile(
    rf"(?:[A-Z0-9_]+=\S+ )*(?:{OURS}|make|python3?|pip|pytest|cargo|gcc|dask|sbatch|ros2|source"
    r"|(?:\.venv|target)/\S+)(?: |$)"
)
# A command in a sentence with a file or a number has all its arguments; another one only names it.
COMPLETE = re.compile(r"\.(toml|mcap|csv|py)\b|--(duration|number) \d")
# What stands for something else.
STANDS_FOR = re.compile(r"\.\.\.|<|\[|\b(LOG|NAME|DIR|PATH|URI|PORT|FILE|DEV|LIST|N|S)\b")


def blocks(text: str) -> Iterator[str]:
    """The lines of the blocks of code, those of a shell that go on put together, without comments."""
    fence, kept = None, ""
    for line in text.splitlines():
        if found := re.match(r"\s*```+(\w*)", line):
            fence = found[1] if fence is None else None
            continue
        if fence not in (None, "", "sh", "bash") or (fence is None and not line.startswith("    ")):
            kept = ""
            continue
        kept += " " * bool(kept) + re.split(r"\s+#\s", line.strip())[0]
        if kept.endswith("\\"):
            kept = kept[:-1].strip()
            continue
        yield kept.strip()
        kept = ""


def shown(page: str) -> list[str]:
    """The commands that the blocks of a page show, and those in its sentences that have all arguments."""
    text = (ROOT / page).read_text(encoding="utf-8")
    found = [line for line in blocks(text) if PROGRAM.match(line)]
    return found + [line for line in named(page) if COMPLETE.search(line) and not STANDS_FOR.search(line)]


def named(page: str) -> list[str]:
    """The commands in the sentences of a page."""
    text = re.sub(r"^\s*```.*?^\s*```", "", (ROOT / page).read_text(encoding="utf-8"), flags=re.M | re.S)
    return [line for line in re.findall(r"`([^`\n]+)`", text) if PROGRAM.match(line)]


@dataclass(frozen=True)
class Rule:
    """What differs for the commands that a pattern matches."""

    pattern: str
    not_here: str = ""
    """Why no test of the pages runs it."""
    slow: bool = False
    """`make commands-test` runs it, because it takes long."""
    beside: bool = False
    """It runs beside the next commands, until the page ends."""
    until: str = ""
    """It runs until Ctrl-C, which comes when it has printed this."""
    status: tuple[int, ...] = (0,)
    says: str = ""
    """What it must print."""
    replace: tuple[tuple[str, str], ...] = ()
    """What the test replaces: the places of a vehicle and of motion capture, numbers of hours."""
    answers: str = ""
    """What it reads from its standard input."""


VEHICLE = ((r"/dev/ttyUSB0", "{port}"), (r"--mocap \S+", "--mocap {poses}"))
TESTS = "`make test` runs these tests"
INSTALLED = "the tests run in what `make install` has installed"
COMPILES = "it compiles the workspace, which takes minutes; "
ROS = "the wheels of ROS 2 have not this command; tests/test_ros2_flight.py gives such orders"
HOURS = "it takes an hour; tests/test_executors.py flies campaigns of fewer cases"
CLUSTER = "it needs several machines; `make cluster-test` flies on workers of this one"
OTHERS = "a recording of another program; tests/test_recordings.py makes and reads such"
SENSOR = "the data of a sensor; tests/test_compare.py makes and compares such"
LIVE = "it needs a flight beside it; tests/test_view_flight.py opens the page of one"
LANDED = (0, 130)

RULES = [
    Rule(r"make test|cargo test .*|(\.venv/bin/python -m )?pytest .*", not_here=TESTS),
    Rule(r"pip install .*|python3 -m venv .*", not_here=INSTALLED),
    Rule(r"make demo", not_here=COMPILES + "tests/test_programs.py flies such a flight"),
    Rule(r"make docs.*|make gallery", not_here="it takes minutes; the workflow `check` runs `make docs`"),
    Rule(r"make onboard|cargo rustc .*", not_here="it needs a target and an emulator that few have"),
    Rule(
        r"cargo build --release -p tilthex-c|gcc .*|target/hover_and_push",
        not_here=COMPILES + "crates/tilthex-c/tests/example.rs compiles and runs the example",
    ),
    Rule(r"cargo run .* --faults mine", not_here="the reader makes its fault"),
    Rule(r"python packaging/troubleshooting\.py", not_here="tests/test_site.py compares what it writes"),
    Rule(r"python -m benchmarks\.lexicographic .*", not_here="it takes an hour"),
    # A real vehicle: a simulated one takes its place.
    Rule(
        r"tilthex-rt --port /dev/ttyUSB0 .* --log flight\.mcap --take-off",
        until=r"flying.*\n.*flying",
        status=LANDED,
        replace=VEHICLE,
    ),
    Rule(r"tilthex-rt --port /dev/ttyUSB0 .* --trajectory .*", slow=True, replace=VEHICLE),
    Rule(r"python -m tilthex\.ros2 --pose-topic .*", not_here="it needs a tracking system in ROS 2"),
    Rule(r"tilthex-rt --port /dev/ttyUSB0 .* --control", not_here="it needs the bridge of the line before"),
    Rule(r"tilthex-rt .* --port \"px4:.*", not_here="it needs a PX4; the page flies a simulated one"),
    # Several machines.
    Rule(r"dask .*|tilthex .* --executor dask.*|SBATCH.* slurm .*", not_here=CLUSTER),
    Rule(r"sbatch .*|tilthex-rt campaign merge part-\*\.json", not_here="it needs SLURM"),
    Rule(r"tilthex-rt campaign --number 5000 .*", replace=((r"--number 5000", "--number 2"),)),
    Rule(r"tilthex-rt campaign --truth cad", replace=((r"$", " --number 2"),)),
    Rule(r"tilthex experiment peg-in-hole --random 100 (?!.*--case).*", not_here=HOURS),
    # ROS 2.
    Rule(r"ros2 .*|source /opt/ros/.*", not_here=ROS),
    Rule(r"tilthex-rt --sim --control|python -m tilthex\.ros2", slow=True, beside=True, status=LANDED),
    Rule(r"python examples/ros2_circle\.py", slow=True),
    # PX4.
    Rule(r"tilthex-sim --config examples/px4\.toml .*", slow=True, beside=True, says="udp:"),
    Rule(r"tilthex-rt --config examples/px4\.toml .*", slow=True),
    Rule(r"PX4_BUILD=.* python -m benchmarks\.px4_sitl", not_here="it needs a build of PX4"),
    Rule(r"tilthex px4 .* --check .*", replace=((r"saved\.params", "mine.params"),)),
    # A vehicle that flies itself.
    Rule(r"tilthex-sim --on-board .*", slow=True, beside=True, says="/dev/pts/"),
    Rule(r"tilthex-rt console --port \./.*", slow=True, until=r"flying.*\n.*flying", status=LANDED),
    Rule(r"tilthex-rt console .*", not_here="it needs such a vehicle; the page flies a simulated one"),
    # What asks, and what serves.
    Rule(r"tilthex new .*", answers="\n" * 20),
    Rule(r"tilthex view", not_here=LIVE),
    Rule(r"tilthex view .*", until=r"http://127\.0\.0\.1:\d+/", status=LANDED),
    Rule(r"tilthex-sim completion .*"),
    Rule(r"tilthex-sim .*", until=r"/dev/pts/\d+"),
    # What refuses the short hover of the test.
    Rule(r"tilthex fit flight\.mcap", status=(2,), says="expected at least 10"),
    Rule(r"tilthex calibrate flight\.mcap .*", status=(2,), says="the recording does not tell"),
    Rule(r"tilthex (estimate imu0/.*|calibrate bag .*)", not_here=OTHERS),
    Rule(r"tilthex compare .*", not_here=SENSOR),
    Rule(r"tilthex convert .* --to rerun", not_here="Rerun is large; tests/test_viewers.py reads its file"),
    # What takes long.
    Rule(r"tilthex-rt --sim --take-off --truth .*", slow=True, until=r"flying", status=LANDED),
    Rule(r"tilthex-rt --sim --take-off --duration .*", slow=True),
    Rule(r"tilthex (video|manoeuvres) .*", slow=True),
    # One flight stands for both.
    Rule(r"tilthex fit a\.mcap .*", slow=True, replace=((r"b\.mcap", "a.mcap"),)),
    Rule(r"tilthex experiment (?!mine\.toml --out).*", slow=True),
]


def rule(command: str) -> Rule:
    """The first rule that matches a command."""
    return next((one for one in RULES if re.fullmatch(one.pattern, command)), Rule(".*"))
