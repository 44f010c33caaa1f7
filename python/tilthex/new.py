"""`tilthex new vehicle|experiment FILE.toml`: asks what the file needs, and writes it with comments."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from tilthex import Vehicle
from tilthex._mounted import mounted_rpy_deg

SCENES = ("free", "plane")
"""The scenes that need no more than an experiment's questions."""
TOOLS = {"down": [0.0, 0.0, 0.0], "forward": [0.0, -90.0, 0.0], "up": [180.0, 0.0, 0.0]}
"""Where a tool points from the vehicle, and its `tool_rotation_deg`: z points back along the rod."""


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


def number(question: str, default: float) -> float:
    """The same for a number. It asks again on a terminal.

    Raises:
        ValueError: The answer is no number, and nobody is there who could be asked again.
    """
    while True:
        answer = ask(question, f"{default:g}")
        try:
            return float(answer)
        except ValueError:
            sentence = f"the answer to '{question}' is {answer!r}; expected a number"
            if not sys.stdin.isatty():
                raise ValueError(sentence) from None
            print(sentence, file=sys.stderr)


def choice(question: str, known: Sequence[str], default: str) -> str:
    """The same for one of several words.

    Raises:
        ValueError: The answer is none of them.
    """
    answer = ask(f"{question}: {', '.join(known[:-1])} or {known[-1]}", default)
    if answer not in known:
        raise ValueError(f"{question} is {answer!r}; expected one of {', '.join(known)}")
    return answer


def vehicle(path: Path) -> str:
    """The file of a vehicle: a hexarotor with tilted rotors."""
    stem, base = path.stem, Vehicle.preset("tilt-hex")
    keys: dict[str, Any] = {
        "name": ask("name", stem),
        "mass": number("mass of the vehicle with its tool, kg", base.mass),
        "inertia": [
            number(f"inertia about {axis} through the centre of mass, kg m^2", float(base.inertia[k, k]))
            for k, axis in enumerate("xyz")
        ],
        "rotor_time_constant": number("time constant of the rotors' speed, s", base.rotor_time_constant),
        "tool_position": [
            number(f"{axis} of the tool tip from the centre of mass, m", float(base.tool_position[k]))
            for k, axis in enumerate("xyz")
        ],
        "tool_rotation_deg": TOOLS[choice("where the tool points", tuple(TOOLS), "down")],
    }
    low, high = base.rotor_speed_limits[0].tolist()
    first = base.rotors[0]
    keys["tilted_hexarotor"] = {
        "arm": number("from the centre to a rotor, m", 0.4),
        "alpha_deg": number("tilt of the rotors about their arms, degrees, one up, one down", 35.0),
        "beta_deg": number("tilt of the rotors towards the centre, degrees", 25.0),
        "thrust_coefficient": number("thrust of a rotor, N/Hz^2", first["thrust_coefficient"]),
        "drag_coefficient": number("drag moment of a rotor, N m/Hz^2", first["drag_coefficient"]),
        "min_speed": number("lowest speed of a rotor, Hz", low),
        "max_speed": number("highest speed of a rotor, Hz", high),
    }
    made = Vehicle.from_dict(keys)
    speeds = made.hover_speeds()
    return (
        f"# Written by `tilthex new vehicle`. It hovers at {speeds.min():.1f} to {speeds.max():.1f} Hz.\n"
        f"# Its margins: tilthex check {stem}.toml; how to fly it, and other arrangements of rotors:\n"
        "# docs/howto/vehicle.md.\n\n" + made.to_toml()
    )


def experiment(path: Path) -> str:
    """The file of an experiment: a hover, or a press on a board."""
    stem = path.stem
    title = ask("title", stem)
    flown = ask("vehicle: a preset or a TOML file", "tilt-hex")
    named = Vehicle.named(str(path.parent / flown) if flown.endswith(".toml") else flown)
    turned = list(mounted_rpy_deg(named))
    scene = ask(f"scene: {', '.join(SCENES)}, or a file of your own (.xml, .py)", "plane")
    if scene not in SCENES and not scene.endswith((".xml", ".py")):
        raise ValueError(f"scene is {scene!r}; expected {', '.join(SCENES)}, or a file .xml or .py")
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


KINDS: dict[str, Callable[[Path], str]] = {"vehicle": vehicle, "experiment": experiment}
"""What can be written, and the function that asks for it."""
