"""Every command of the pages does what a reader expects: it ends well where the page shows it.

The commands of a page run in their order in a folder of their own. What a test cannot run has a reason in
`commands.RULES`, and what takes long is run by `make commands-test`.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from commands import PAGES, PROGRAM, ROOT, RULES, Rule, named, rule, shown
from test_programs import vehicle
from tilthex._programs import free_port

SLOW = bool(os.environ.get("TILTHEX_COMMANDS"))
PATIENCE = 900.0 if SLOW else 120.0
BINARIES = Path(sys.executable).parent
MINE = "tilthex-rt --print-config > mine.toml"
MY = "tilthex new vehicle my.toml"
EXPERIMENTS = {"docs/experiments.md", "docs/howto/experiment.md"}
"""Pages on which mine.toml is an experiment."""


def runs(command: str) -> bool:
    found = rule(command)
    return not found.not_here and (SLOW or not found.slow)


def flies(command: str) -> bool:
    return bool(re.match(r"tilthex(-rt|-sim)? .*(--port|--sim|--udp|--truth|--world|view)", command))


COMMANDS = {page: shown(page) for page in PAGES}
STORIES = [
    pytest.param(page, marks=[pytest.mark.real_time] if any(map(flies, filter(runs, commands))) else [])
    for page, commands in COMMANDS.items()
    if any(map(runs, commands))
]


class Reader:
    """Someone who types the commands of a page."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self.folder, self._stack = folder, stack
        self._places: dict[str, str] = {}
        self._typed = 0
        path = f"{BINARIES}{os.pathsep}{os.environ['PATH']}"
        self._environment = os.environ | {"PATH": path, "MPLBACKEND": "svg", "BROWSER": "true"}

    def types(self, command: str, how: Rule) -> None:
        """Runs a command, and says what it printed if it does not end as it should."""
        for pattern, instead in how.replace:
            command = re.sub(pattern, instead, command, count=1)
        if "{port}" in command:
            command = command.format(**self._at_a_vehicle())
        self._typed += 1
        place = self.folder / f"printed-{self._typed}.txt"
        output = self._stack.enter_context(place.open("w", encoding="utf-8"))
        process = subprocess.Popen(
            ["bash", "-c", command],
            cwd=self.folder,
            env=self._environment,
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self._stack.callback(self._kill, process)
        assert process.stdin is not None
        process.stdin.write(how.answers)
        process.stdin.close()

        def printed() -> str:
            return place.read_text(encoding="utf-8")

        def ends() -> None:
            try:
                process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                self._kill(process)
            said = f"{command} ended with {process.returncode}:\n{printed()}"
            assert process.returncode in how.status, said
            assert how.says in printed(), said

        if how.beside:
            self._stack.callback(lambda: (self._interrupt(process), ends()))
            # The next command finds it running.
            time.sleep(2.0)
            return
        if how.until:
            end = time.monotonic() + PATIENCE
            while not re.search(how.until, printed()) and process.poll() is None and time.monotonic() < end:
                time.sleep(0.1)
            assert re.search(how.until, printed()), f"{command} does not print {how.until}:\n{printed()}"
            self._interrupt(process)
        ends()

    def _at_a_vehicle(self) -> dict[str, str]:
        """The port and the poses of a simulated vehicle in place of a real one."""
        if not self._places:
            poses = f"natnet://127.0.0.1:{free_port()}/1"
            _, port = self._stack.enter_context(vehicle("--mocap", poses))
            self._places = {"port": port, "poses": poses}
        return self._places

    @staticmethod
    def _interrupt(process: subprocess.Popen[str]) -> None:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)

    @staticmethod
    def _kill(process: subprocess.Popen[str]) -> None:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@contextmanager
def reader(page: str, folder: Path, flight: Path | None) -> Iterator[Reader]:
    """A reader who has what the page takes for granted: the checkout, a log, files of their own."""
    for name in ("examples", "vehicles", "crates"):
        (folder / name).symlink_to(ROOT / name)
    text = (ROOT / page).read_text(encoding="utf-8")
    shown_files = re.findall(r"^ *```toml\n(.*?)^ *```", text, re.DOTALL | re.MULTILINE)
    with ExitStack() as stack:
        one = Reader(folder, stack)
        commands = COMMANDS[page]
        if flight is not None:
            shutil.copy(flight, folder / "flight.mcap")
        if page in EXPERIMENTS:
            shutil.copy(ROOT / "python/tilthex/experiments/sliding.toml", folder / "mine.toml")
        elif MINE not in commands and "tilthex new vehicle mine.toml" not in commands:
            one.types(MINE, Rule(MINE))
        if any("my.toml" in command for command in commands):
            one.types(MY, rule(MY))
        (folder / "my-truth.toml").write_text('[truth]\nlevel = "cad"\n', encoding="utf-8")
        for file in shown_files:
            if "mine.toml" in file:
                (folder / "my-flight.toml").write_text(file, encoding="utf-8")
        yield one


def has_limits(path: Path) -> None:
    """The reader writes the limits of the battery, as the README says."""
    if path.exists():
        text = path.read_text(encoding="utf-8")
        text = text.replace("battery_low = 0.0", "battery_low = 14.0")
        path.write_text(text.replace("battery_critical = 0.0", "battery_critical = 13.0"), encoding="utf-8")


@pytest.mark.parametrize("page", STORIES)
def test_the_commands_of_a_page(page, tmp_path, request):
    commands = [command for command in COMMANDS[page] if runs(command)]
    needs = any("flight.mcap" in command for command in commands)
    makes = any("--log flight.mcap" in command for command in commands)
    flight = None
    if needs and not makes:
        flight = tmp_path / "before.mcap"
        flight.write_bytes(request.getfixturevalue("flight"))
    folder = tmp_path / "reader"
    folder.mkdir()
    with reader(page, folder, flight) as one:
        for command in commands:
            # A rerun of `new` is a new file.
            if command.startswith("tilthex new "):
                (folder / command.split()[-1]).unlink(missing_ok=True)
            one.types(command, rule(command))
            has_limits(folder / "mine.toml")


def test_every_rule_is_needed_and_names_tests_that_exist():
    commands = {command for page in COMMANDS.values() for command in page}
    used = {id(rule(command)) for command in commands}
    assert [one.pattern for one in RULES if id(one) not in used] == []
    for one in RULES:
        for test in re.findall(r"[\w/-]+/tests/\w+\.rs|tests/\w+\.py", one.not_here):
            assert (ROOT / test).is_file(), one.not_here
        for target in re.findall(r"`make ([\w-]+)`", one.not_here):
            assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.MULTILINE), target
    assert sum(map(len, COMMANDS.values())) > 80


def help_of(*command: str) -> str:
    done = subprocess.run([*command, "--help"], capture_output=True, text=True, check=False)
    return done.stdout if done.returncode == 0 else ""


def test_every_command_in_a_sentence_exists_with_its_options():
    helps: dict[tuple[str, ...], str] = {}
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    wrong = []
    for page in PAGES:
        for command in named(page):
            words = command.split()
            if words[0] == "make" and len(words) > 1 and words[1] not in targets:
                wrong.append(f"{page}: {command}: no target {words[1]}")
            if words[0] not in ("tilthex", "tilthex-rt", "tilthex-sim"):
                continue
            sub = [word for word in words[1:2] if re.fullmatch(r"[a-z][a-z-]+", word)]
            if sub and words[:2] == ["tilthex-rt", "campaign"] and words[2:3] == ["merge"]:
                sub.append("merge")
            name = "tilthex-rt" if sub == ["doctor"] else words[0]
            call = (str(BINARIES / name), *sub)
            text = helps.setdefault(call, help_of(*call))
            if not text:
                wrong.append(f"{page}: {command}: no such command")
            wrong += [
                f"{page}: {command}: no option {option}"
                for option in re.findall(r"(?<!\S)--?[a-z][\w-]*", command)
                if not re.search(rf"(?<![\w-]){re.escape(option)}(?![\w-])", text)
            ]
    assert not wrong, "\n".join(wrong)


def test_every_command_of_a_block_is_found():
    """A line that begins with one of the programs of the package is a command of the table above."""
    assert PROGRAM.match("tilthex check mine.toml") and not PROGRAM.match("tilthex.simulate(config)")
    assert PROGRAM.match("SBATCH_PARTITION=short tilthex experiment sliding")
    assert "tilthex plot flight.mcap" in COMMANDS["README.md"]
    two_lines = [c for c in COMMANDS["docs/howto/px4.md"] if c.endswith("--duration 10 --no-battery-limits")]
    assert len(two_lines) == 1
