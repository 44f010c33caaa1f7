"""`tilthex new vehicle|experiment FILE.toml`: asks what the file needs, and writes it with comments."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from tilthex import Config, Vehicle
from tilthex._mounted import mounted_rpy_deg

SCENES = ("free", "plane")
"""The scenes that need no more than an experiment's questions."""
TOOLS = {"down": [0.0, 0.0, 0.0], "forward": [0.0, -90.0, 0.0], "up": [180.0, 0.0, 0.0]}
"""Where a tool points from the vehicle, and its `tool_rotation_deg`: z points back along the rod."""

FASTEST = 1000.0
"""Fastest highest speed, Hz, beside which a lowest speed is checked before the highest is known."""
Answer = TypeVar("Answer")


def add_parser(commands: Any) -> None:
    """Registers the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "new",
        help="write the file of a vehicle or an experiment of your own",
        description="Asks what the file needs, on the terminal or from standard input, one answer a line. "
        "An empty answer takes the value in brackets. It writes the file with a comment for every key.",
    )
    parser.add_argument("kind", choices=tuple(KINDS))
    parser.add_argument("out", type=Path, metavar="FILE.toml")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Asks, and writes the file.

    Raises:
        ValueError: The file's name does not end in .toml, the file exists, or the answers do not fit.
    """
    path: Path = arguments.out
    if path.suffix != ".toml":
        raise ValueError(f"{path} does not end in .toml; expected a name such as mine.toml")
    if path.exists():
        raise ValueError(f"{path} exists; expected a new file, so that nothing is lost")
    text = KINDS[arguments.kind](path)
    path.write_text(text, encoding="utf-8")
    print(f"written: {path}")


def ask(question: str, default: str) -> str:
    """The answer to a question; the default if it is empty or if there is no more input."""
    print(f"{question} [{default}]: ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip() or default


def again(read: Callable[[], Answer]) -> Answer:
    """What `read` returns. If it refuses the answer, a terminal is asked again.

    Raises:
        ValueError: The answer is refused, and nobody is there who could be asked again.
    """
    while True:
        anybody = sys.stdin.isatty()
        try:
            return read()
        except ValueError as error:
            if not anybody:
                raise
            print(error, file=sys.stderr)


def number(question: str, default: float, fits: Callable[[float], object] | None = None) -> float:
    """The answer to a question that asks for a number; asked again like `again`.

    Args:
        question: The question, with the unit.
        default: The number that an empty answer stands for.
        fits: Raises `ValueError` for a number that is out of range.
    """

    def read() -> float:
        answer = ask(question, f"{default:g}")
        try:
            found = float(answer)
        except ValueError:
            raise ValueError(f"the answer to '{question}' is {answer!r}; expected a number") from None
        if fits is not None:
            fits(found)
        return found

    return again(read)


def choice(question: str, known: Sequence[str], default: str) -> str:
    """The same for one of several words."""

    def read() -> str:
        answer = ask(f"{question}: {', '.join(known[:-1])} or {known[-1]}", default)
        if answer not in known:
            raise ValueError(f"{question} is {answer!r}; expected one of {', '.join(known)}")
        return answer

    return again(read)


def vehicle(path: Path) -> str:
    """The file of a vehicle: a hexarotor with tilted rotors."""
    stem, base = path.stem, Vehicle.preset("tilt-hex")

    def key(name: str, question: str, default: float) -> float:
        return number(question, default, lambda found: _fits({name: found}))

    def inertia() -> list[float]:
        found = [
            number(f"inertia about {axis} through the centre of mass, kg m^2", float(base.inertia[k, k]))
            for k, axis in enumerate("xyz")
        ]
        _fits({"inertia": found})
        return found

    def tool_position() -> list[float]:
        found = [
            number(
                f"{axis} of the tool tip from the centre of mass, m",
                float(base.tool_position[k]),
                lambda found: _fits({"tool_position": [found, 0.0, 0.0]}),
            )
            for k, axis in enumerate("xyz")
        ]
        _fits({"tool_position": found})
        return found

    keys: dict[str, Any] = {
        "name": ask("name", stem),
        "mass": key("mass", "mass of the vehicle with its tool, kg", base.mass),
        "inertia": again(inertia),
        "rotor_time_constant": key(
            "rotor_time_constant", "time constant of the rotors' speed, s", base.rotor_time_constant
        ),
        "tool_position": again(tool_position),
        "tool_rotation_deg": TOOLS[choice("where the tool points", tuple(TOOLS), "down")],
    }
    low, high = base.rotor_speed_limits[0].tolist()
    first = base.rotors[0]
    rotors: dict[str, float] = {}
    for name, question, default in (
        ("arm", "from the centre to a rotor, m", 0.4),
        ("alpha_deg", "tilt of the rotors about their arms, degrees, one up, one down", 35.0),
        ("beta_deg", "tilt of the rotors towards the centre, degrees", 25.0),
        ("thrust_coefficient", "thrust of a rotor, N/Hz^2", first["thrust_coefficient"]),
        ("drag_coefficient", "drag moment of a rotor, N m/Hz^2", first["drag_coefficient"]),
        ("min_speed", "lowest speed of a rotor, Hz", low),
        ("max_speed", "highest speed of a rotor, Hz", high),
    ):

        def fits(found: float, name: str = name) -> None:
            if name == "arm" and not found > 0.0:
                raise ValueError(f"arm is {found:g}; expected a positive number, m")
            beside = {"max_speed": FASTEST} if name == "min_speed" else {}
            _fits({"tilted_hexarotor": rotors | beside | {name: found}})

        rotors[name] = number(question, default, fits)
    made = Vehicle.from_dict(keys | {"tilted_hexarotor": rotors})
    speeds = made.hover_speeds()
    hover = f"It hovers at {speeds.min():.1f} to {speeds.max():.1f} Hz"
    try:
        Config.default(made).check_hover()
    except ValueError as error:
        hover = "It cannot hover"
        print(f"warning: {error}", file=sys.stderr)
    return (
        f"# Written by `tilthex new vehicle`. {hover}.\n"
        f"# Its margins: tilthex check {stem}.toml; how to fly it, and other arrangements of rotors:\n"
        "# docs/howto/vehicle.md.\n\n" + made.to_toml()
    )


def _fits(keys: dict[str, Any]) -> None:
    """Refuses keys with which no vehicle exists, whatever its other keys are."""
    Vehicle.from_dict({"preset": "tilt-hex"} | keys)


def experiment(path: Path) -> str:
    """The file of an experiment: a hover, or a press on a board."""
    stem = path.stem
    title = ask("title", stem)
    flown, named = again(lambda: _flown(path))
    turned = list(mounted_rpy_deg(named))
    scene = again(_scene)
    world, tip = 'scene = "free"  # only a visible floor', 1.0
    if scene not in SCENES:
        world = f"scene = {json.dumps(scene)}  # in the folder of this file: docs/howto/experiment.md"
    if scene == "plane":
        tilt = number("tilt of the board about x, degrees", 0.0)
        friction = number("friction of the board", 0.2)
        depth = number("how far below the board the tool is sent, m", 0.05)
        tip = 0.46 - depth
        world = (
            'scene = "plane"  # a board; other scenes, and one of your own: docs/howto/experiment.md\n'
            "point = [0.0, 0.0, 0.457]  # m; the tip of 3 mm radius first touches at 0.46 m\n"
            f"tilt_deg = [{tilt:g}, 0.0]  # about x, then about y\n"
            f"friction = {friction:g}"
        )
    beyond = ""
    if scene != "free":
        what = "behind the surface" if scene == "plane" else "to change: a place behind a surface"
        beyond = f"  # {what}, so that the stiffness presses the tool on it"
    hold = number("how long the tool stays there, s", 5.0)
    seed = round(number("seed of the sensors' noise", 1.0))
    # A text of JSON is one of TOML.
    title, flown = (json.dumps(text, ensure_ascii=False) for text in (title, flown))
    return f"""# Written by `tilthex new experiment`. Fly it: tilthex experiment {stem}.toml --out out/{stem}
# Your own checks and figures: the module {stem.replace("-", "_")}.py beside it (docs/howto/experiment.md).
title = {title}
about = "What it shows."
vehicle = {flown}
seed = {seed}

# How the true vehicle differs from the controller's model (docs/truth.md): exact, measured, cad, outdoors.
truth = "exact"

# Any section of a configuration (docs/configuration.md); the rest has its defaults.
[config.admittance]
stiffness = [10.0, 10.0, 10.0, 10.0, 10.0, 5.0]  # N/m and N m/rad

[world]
{world}

# Each way-point is reached and left at rest: position of the tool's tip, m; rpy_deg of the tool, degrees;
# duration of the way to it, s; hold, s. What a way-point does not name stays as it was.
[[trajectory.waypoint]]
phase = "approach"
position = [0.0, 0.0, {0.6 if scene == "plane" else 1.0}]
rpy_deg = {turned}  # as the tool is mounted, so that the vehicle hovers level
hold = 2.0

[[trajectory.waypoint]]
phase = "{"hover" if scene == "free" else "contact"}"
position = [0.0, 0.0, {tip:g}]{beyond}
duration = 5.0
hold = {hold:g}

# What differs between the runs; each has all that stands above.
[[run]]
name = "as it is"
"""


def _flown(path: Path) -> tuple[str, Vehicle]:
    flown = ask("vehicle: a preset or a TOML file", "tilt-hex")
    return flown, Vehicle.named(str(path.parent / flown) if flown.endswith(".toml") else flown)


def _scene() -> str:
    scene = ask(f"scene: {', '.join(SCENES)}, or a file of your own (.xml, .py)", "plane")
    if scene not in SCENES and not scene.endswith((".xml", ".py")):
        raise ValueError(f"scene is {scene!r}; expected {', '.join(SCENES)}, or a file .xml or .py")
    return scene


KINDS: dict[str, Callable[[Path], str]] = {"vehicle": vehicle, "experiment": experiment}
"""What can be written, and the function that asks for it."""
