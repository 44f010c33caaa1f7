"""`tilthex check`: how far a configuration is from instability, in hover and contact (docs/stability.md)."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex import Config, LoopModel, Vehicle, _json, polytope
from tilthex._colours import YELLOW, coloured
from tilthex._toml import tomllib

Array = NDArray[np.float64]
LEAST_PHASE_MARGIN = LoopModel.least_phase_margin_deg
"""Smallest phase margin of every axis of the nominal vehicle, degrees."""
LARGEST_PEAK = LoopModel.largest_peak
"""Largest sensitivity peak of every axis of the nominal vehicle."""
LEAST_DRAWN_PHASE_MARGIN = 30.0
"""Smallest phase margin of every axis of every drawn vehicle, degrees."""
DAMPING_TIME = 1e-3
"""Damping of the touched body divided by its stiffness, s."""
STIFFNESS = 5e3
"""Stiffness of the touched body, N/m, for which the apparent mass is computed."""
ANY = 1e6
"""From this stiffness on, a range counts as open."""


@dataclass(frozen=True)
class Spread:
    """The worst values of many drawn vehicles, (6,) each."""

    phase_margin_deg: Array
    sensitivity_peak: Array
    unstable: int


def drawn(config: Config, truth: str, draws: int, first: int = 0) -> Spread:
    """Margins of vehicles that are drawn from `truth`, a level or a TOML file.

    Their seeds are `first`, `first + 1`, ...
    """
    phase, peak, unstable = np.full(6, np.inf), np.zeros(6), 0
    for seed in range(first, first + draws):
        found = LoopModel(config, truth=truth, seed=seed).hover()
        phase = np.minimum(phase, found["phase_margin_deg"])
        peak = np.maximum(peak, found["sensitivity_peak"])
        unstable += not found["stable"]
    return Spread(phase, peak, unstable)


def named(name: str) -> Config:
    """The configuration in a TOML file (also a vehicle's file), or the default one of a preset.

    Raises:
        ValueError: The file cannot be read, or is none; it says so of an experiment's file.
    """
    if name in Vehicle.presets():
        return Config.default(Vehicle.preset(name))
    try:
        return Config.from_toml(name)
    except ValueError as error:
        if _is_experiment(Path(name)):
            raise ValueError(
                f"{name} is the file of an experiment; expected a configuration, a vehicle's file or a "
                "preset: take the vehicle that its key `vehicle` names"
            ) from error
        raise


def _is_experiment(path: Path) -> bool:
    try:
        return "trajectory" in tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False


def add_parser(subparsers: Any) -> None:
    """Registers the command with the parsers of `tilthex`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "check",
        help="stability margins of a configuration",
        description="Prints each axis' margins in hover, the stiffnesses at which contact is stable, the "
        "apparent mass below which contact is unstable, and the largest force of the tool.",
    )
    parser.add_argument("config", help="a TOML file, or a preset for its default configuration")
    parser.add_argument(
        "--truth",
        default="measured",
        help="how the drawn vehicles differ from the model: a level or a TOML file (default: %(default)s)",
    )
    parser.add_argument(
        "--draws", type=int, default=20, help="number of drawn vehicles (default: %(default)s)"
    )
    parser.add_argument(
        "--stiffness",
        type=float,
        default=STIFFNESS,
        help=f"stiffness of the touched body, N/m, for the apparent mass (default: {STIFFNESS:g})",
    )
    parser.add_argument(
        "--damping-time",
        type=float,
        default=DAMPING_TIME,
        help=f"damping of the touched body divided by its stiffness, s (default: {DAMPING_TIME:g})",
    )
    _json.add_option(parser)
    parser.add_argument("--plot", type=Path, help="draw the frequency response of the loops into this file")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Prints the result, and plots it on request."""
    config = named(arguments.config)
    config.check_hover()
    model = LoopModel(config)
    spread = drawn(config, arguments.truth, arguments.draws) if arguments.draws > 0 else None
    found = summary(config.vehicle, model, spread, arguments)
    if arguments.json:
        _json.say(found)
    else:
        print("\n".join(report(found)))
    if arguments.plot:
        _plot(model, arguments.plot)
        if not arguments.json:
            print(f"written: {arguments.plot}")


def summary(
    vehicle: Vehicle, model: LoopModel, spread: Spread | None, arguments: argparse.Namespace
) -> dict[str, Any]:
    """What is reported, by names. Ranges of stiffness are pairs; 1e6 stands for any stiffness."""
    found, damping_time = model.hover(), arguments.damping_time
    stable = found.pop("stable")
    axes = {axis: {name: values[i] for name, values in found.items()} for i, axis in enumerate(model.axes)}
    if spread:
        for i, axis in enumerate(model.axes):
            axes[axis]["drawn_phase_margin_deg"] = spread.phase_margin_deg[i]
            axes[axis]["drawn_sensitivity_peak"] = spread.sensitivity_peak[i]
    named_axes = list(zip("xyz", np.eye(3), strict=True))
    worst, stiffnesses = model.worst_contact(damping_time=damping_time)
    return {
        "vehicle": vehicle.name,
        "stable": stable,
        "axes": axes,
        "drawn": {"truth": arguments.truth, "draws": arguments.draws, "unstable": spread.unstable}
        if spread
        else None,
        "contact": {
            "damping_time": damping_time,
            "along": {name: model.contact(along=a, damping_time=damping_time) for name, a in named_axes},
            "along_undamped": {name: model.contact(along=a) for name, a in named_axes},
            "worst": {"direction": worst, "stable": stiffnesses},
            "about": {name: model.contact(about=a, damping_time=damping_time) for name, a in named_axes},
            "stiffness": arguments.stiffness,
            "least_apparent_mass": {
                name: model.least_apparent_mass(k, arguments.stiffness, damping_time=damping_time)
                for k, name in enumerate("xyz")
            },
        },
        "reach": _reach(vehicle),
    }


def _reach(vehicle: Vehicle) -> dict[str, Any]:
    """Forces in a level hover, N, or why there are none."""
    ways = zip(("x", "y", "down", "up"), [*np.eye(3)[:2], [0, 0, -1], [0, 0, 1]], strict=True)
    try:
        return {
            "sideways": polytope.lateral_reach(vehicle),
            "push": {name: polytope.push(vehicle, direction) for name, direction in ways},
        }
    except ValueError as error:
        return {"refused": str(error)}


def report(found: dict[str, Any]) -> Iterator[str]:
    """The lines for a person, of a `summary`."""
    drawn = found["drawn"]
    worst = f"; worst of {drawn['draws']} vehicles of {drawn['truth']}" if drawn else ""
    any_low = False
    yield f"hover{'' if found['stable'] else ', UNSTABLE'}: phase margin, sensitivity peak{worst}"
    for axis, margins in found["axes"].items():
        phase, peak = margins["phase_margin_deg"], margins["sensitivity_peak"]
        good = phase >= LEAST_PHASE_MARGIN and peak <= LARGEST_PEAK
        line = (
            f"  {axis:5} {phase:5.1f} deg, {peak:4.2f}; gains times {margins['gain_margin']:.3g} and "
            f"{1e3 * margins['delay_margin']:.0f} ms more are the limits; "
            f"crosses at {margins['crossover']:.1f} rad/s"
        )
        if drawn:
            least = margins["drawn_phase_margin_deg"]
            line += f"; drawn {least:.1f} deg, {margins['drawn_sensitivity_peak']:.2f}"
            good = good and least >= LEAST_DRAWN_PHASE_MARGIN
        any_low = any_low or not good
        yield line + ("" if good else coloured("  <- low", YELLOW, sys.stdout))
    if any_low:
        of_drawn = f", or of a drawn vehicle below {LEAST_DRAWN_PHASE_MARGIN:g} deg" if drawn else ""
        yield (
            f"  low: a phase margin below {LEAST_PHASE_MARGIN:g} deg, a sensitivity peak above "
            f"{LARGEST_PEAK:g}{of_drawn}; `tilthex tune` derives gains with more"
        )
    if drawn and drawn["unstable"]:
        yield f"  {drawn['unstable']} of the drawn vehicles are unstable"
    yield from _contact(found["contact"])
    reach = found["reach"]
    if "refused" in reach:
        yield f"rotors: {reach['refused']}"
        return
    sideways = f"{reach['sideways']:.1f} N sideways at the centre of mass"
    pushes = ", ".join(f"{name} {force:.1f}" for name, force in reach["push"].items())
    yield f"rotors, in a level hover: {sideways}; the tip pushes [N]: {pushes}"


def _contact(contact: dict[str, Any]) -> Iterator[str]:
    yield f"contact with an environment that has {1e3 * contact['damping_time']:g} ms of damping"
    for name, ranges in contact["along"].items():
        undamped = _ranges(contact["along_undamped"][name], "N/m")
        yield f"  along {name}: {_ranges(ranges, 'N/m')}; without damping: {undamped}"
    worst = contact["worst"]
    yield f"  worst, along {np.round(worst['direction'], 2).tolist()}: {_ranges(worst['stable'], 'N/m')}"
    for name, ranges in contact["about"].items():
        yield f"  tip held, about {name}: {_ranges(ranges, 'N m/rad')}"
    for name, least in contact["least_apparent_mass"].items():
        meaning = (
            f"unstable below an apparent mass of {least:.3g} kg"
            if math.isfinite(least)
            else "not stable with these values; a larger damping of [admittance] helps"
        )
        yield f"  along {name}, up to {contact['stiffness']:g} N/m: {meaning}"


def _number(stiffness: float) -> str:
    return f"{float(f'{stiffness:.3g}'):g}"


def _ranges(found: list[tuple[float, float]], unit: str) -> str:
    """The ranges of stable stiffness, in words."""
    if not found:
        return "no stiffness is stable"
    words = []
    for low, high in found:
        if high < ANY:
            words.append((f"from {_number(low)} to " if low > 0.0 else "up to ") + f"{_number(high)} {unit}")
        else:
            words.append(f"above {_number(low)} {unit}" if low > 0.0 else "at any stiffness")
    return f"stable {' and '.join(words)}"


def border(found: list[tuple[float, float]], unit: str) -> str:
    """Up to which stiffness all contact is stable, in words."""
    if not found or found[0][0] > 0.0:
        return "no stiffness"
    return "any stiffness" if found[0][1] >= ANY else f"{_number(found[0][1])} {unit}"


def _plot(model: LoopModel, path: Path) -> None:
    from matplotlib.figure import Figure

    loops = model.loops()
    gains = loops["real"] + 1j * loops["imaginary"]
    figure = Figure(figsize=(12, 4.2), layout="constrained")
    nyquist, peak = figure.subplots(1, 2)
    for name, gain in zip(model.axes, gains, strict=True):
        nyquist.plot(gain.real, gain.imag, label=name)
        peak.loglog(loops["frequency"], 1.0 / np.abs(1.0 + gain), label=name)
    circle = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 200))
    nyquist.plot((-1 + circle / LARGEST_PEAK).real, (-1 + circle / LARGEST_PEAK).imag, "k:", lw=1)
    nyquist.plot(circle.real, circle.imag, "k--", lw=0.6)
    nyquist.plot([-1.0], [0.0], "k+")
    nyquist.set(xlim=(-3, 1), ylim=(-2, 2), aspect="equal", xlabel="real", ylabel="imaginary")
    nyquist.set_title("loop gain; dotted: sensitivity 2", fontsize=10, loc="left")
    peak.axhline(LARGEST_PEAK, color="k", ls=":", lw=1)
    peak.set(xlabel="rad/s", ylabel="sensitivity", xlim=(0.3, 1000), ylim=(1e-2, 10))
    peak.legend(loc="lower right")
    figure.savefig(path, dpi=110)
