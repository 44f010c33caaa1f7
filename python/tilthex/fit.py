"""`tilthex fit`: corrects a vehicle's model with logs of flights (docs/identification.md)."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tilthex import _core, _json, _priors, log
from tilthex._battery import speeds_of
from tilthex._core import Config, Vehicle
from tilthex.identify import Flight, Identified, identify

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tilthex._identified import Figure as Found

AFTER = 0.5
"""Time after the start of free flight that is left out, s: the estimator still settles."""
ADVICE = {
    "mass": "a flight cannot determine it; weigh the vehicle and give --mass",
    "drag moment": "a flight cannot tell it from tilted rotor axes; measure the moment of one rotor on a "
    "test stand, or keep the model's value",
    "throttle exponent": "the battery's voltage moved too little; add the log of a flight until it is low",
}
"""What to do about parameters that no flight determines."""
LINK = {
    "age of rotor speeds": ("rotor_speed_age", 0.05),
    "throttle exponent": ("throttle_exponent", 3.0),
}
"""Figures that are keys of `[link]`, with their largest values."""
CORRELATED = 0.95
"""Above this correlation, two parameters can only be determined together."""


def read(path: str | Path | log.Log, begin: float | None = None, end: float | None = None) -> Flight:
    """The flight in a log, between two times since its start, s.

    Raises:
        ValueError: The log holds no free flight between these times.
    """
    from scipy.spatial.transform import Rotation

    flight = path if isinstance(path, log.Log) else log.Log(path)
    config = Config.from_text(flight.configuration)
    link = config.to_dict()["link"]
    state, rotors, phases = (flight.columns(topic) for topic in ("/state", "/rotors", "/flight"))
    count = min(len(topic["log_time"]) for topic in (state, rotors, phases))
    time = phases["time"][:count]
    since = time - time[0]
    used = np.isin(phases["phase"][:count], log.FREE_FLIGHT)
    begins = time[1:][used[1:] & ~used[:-1]]
    for start in begins:
        used &= ~((time >= start) & (time < start + AFTER))
    used &= (since >= (begin if begin is not None else 0.0)) & (since <= (end if end is not None else np.inf))
    if not used.any():
        raise ValueError(
            f"{flight.path}: the vehicle does not fly between these times; expected a part in flight"
        )
    # Constant steps: those of the loop vary a little, and some ticks are skipped.
    even = np.arange(time[0], time[-1], float(np.median(np.diff(time))))

    def column(values: Any) -> Any:
        return np.stack([np.interp(even, time, one) for one in values[:count].T], axis=1)

    rotation = Rotation.from_quat(state["orientation"][:count])
    return Flight(
        time=even,
        specific_force=column(state["specific_force_r"]),
        angular_velocity=column(state["angular_velocity_r"]),
        rotor_speeds=column(rotors["measured"]),
        rotor_command=column(rotors["command"]),
        velocity=column(rotation.inv().apply(state["velocity_w"][:count])),
        used=np.interp(even, time, used.astype(float)) > 0.999,
        speed_age=float(link["rotor_speed_age"]),
        **_throttles(flight, config, time, even),
    )


def _throttles(flight: log.Log, config: Config, time: Any, even: Any) -> dict[str, Any]:
    """What a flight with PX4 shows of the battery: what the throttles stand for, and the voltage."""
    link = config.to_dict()["link"]
    if link["protocol"] != "px4" or link["throttle_voltage"] == 0.0:
        return {}
    rows = _core.read_throttles(config, [bytes(tick.link) for _, tick in flight.messages("/output")])
    rows = rows[rows[:, 0] < len(time)]
    tick, first = np.unique(rows[:, 0].astype(int), return_index=True)
    if len(tick) < 2:
        return {}
    mapped = speeds_of(rows[first, 1:], link["throttle"])
    volts = flight.columns("/rotors")["battery"][: len(time)] / link["throttle_voltage"]
    return {
        "mapped_speeds": np.stack([np.interp(even, time[tick], one) for one in mapped.T], axis=1),
        "voltage": np.interp(even, time, volts),
        "exponent": float(link["throttle_exponent"]),
        "throttle_map": (*link["throttle"], link["throttle_voltage"]),
    }


def report(found: Identified) -> str:
    """The parameters, and what the flight did not determine."""
    lines = [
        f"{found.seconds:.1f} s of free flight; {found.left_out:.1f} s left out, which differ from the rest",
        f"not explained: {found.residual[0]:.3g} m/s^2 and {found.residual[1]:.3g} rad/s",
        *map(str, found.figures),
    ]
    names = [figure.name for figure in found.figures]
    pairs = [
        f"{names[i]} with {names[j]} ({found.correlation[i, j]:+.2f})"
        for i in range(len(found.correlation))
        for j in range(i)
        if abs(found.correlation[i, j]) > CORRELATED and found.figures[i].learnt and found.figures[j].learnt
    ]
    if pairs:
        lines.append("determined only together: " + ", ".join(pairs))
    unknown = [figure.name for figure in found.figures if not figure.known]
    lines += [f"{name}: {ADVICE[name]}" for name in unknown if name in ADVICE]
    rest = [name for name in unknown if name not in ADVICE]
    if rest:
        lines.append(f"not learnt: {', '.join(rest)}; fly the output of `tilthex excite`, and add its log")
    return "\n".join(lines)


def summary(found: Identified) -> dict[str, Any]:
    """What is reported, by names; the corrected vehicle as TOML."""
    figures = {one.name: _json.plain(one) | {"learnt": one.learnt} for one in found.figures}
    names = ("seconds", "left_out", "residual", "correlation", "vehicle")
    return {"figures": figures} | {name: _json.plain(getattr(found, name)) for name in names}


def toml(found: Identified) -> str:
    """The corrected vehicle, and the found keys of its link."""
    return f"{found.vehicle.to_toml()}\n{link_keys(found.figures)}"


def link_keys(figures: Sequence[Found]) -> str:
    """The section `[link]` with the figures that are keys of it, their deviations as comments."""
    lines, keys = [], False
    for one in figures:
        if one.name not in LINK:
            continue
        name, largest = LINK[one.name]
        what = f"# {one.name}, {one.unit}: {one.value:.3g} +- {one.deviation:.2g}"
        if not one.known:
            lines.append(f"{what}, not learnt")
        elif 0.0 <= one.value <= largest:
            lines += [what, f"{name} = {one.value:.6g}"]
            keys = True
        else:
            lines.append(f"{what}, outside of the range of {name} in [link]")
    return "\n".join((["[link]"] if keys else []) + lines) + "\n"


def figure(flights: list[Flight], found: Identified, names: list[str]) -> Figure:
    """Predicted and measured specific force and angular acceleration over time, a column for each flight."""
    import matplotlib.pyplot as plt

    size = (11 * len(flights), 12)
    drawn, axes = plt.subplots(
        6, len(flights), figsize=size, sharex="col", sharey="row", layout="constrained", squeeze=False
    )
    for column, flight, predicted, name in zip(axes.T, flights, found.predicted, names, strict=True):
        _draw(column, flight, *predicted)
        column[0].set_title(name, fontsize=9)
    axes[0, 0].legend(loc="upper right", ncols=2)
    return drawn


def _draw(axes: Any, flight: Flight, force: Any, alpha: Any) -> None:
    """Draws one flight into six axes."""
    time = flight.time - flight.time[0]
    measured = np.gradient(flight.angular_velocity, flight.time, axis=0)
    for k in range(6):
        pair = (flight.specific_force, force) if k < 3 else (_smooth(measured), _smooth(alpha))
        for values, style, label in zip(pair, ("0.6", "tab:blue"), ("measured", "predicted"), strict=True):
            shown = (
                np.where(flight.used, values[:, k % 3], np.nan)
                if flight.used is not None
                else values[:, k % 3]
            )
            axes[k].plot(time, shown, color=style, lw=0.8, label=label)
        what = "specific force {}, m/s$^2$" if k < 3 else "angular acceleration {}, rad/s$^2$"
        axes[k].set_ylabel(what.format("xyz"[k % 3]), fontsize=8)
    axes[-1].set_xlabel("time, s")


def _smooth(values: Any) -> Any:
    """Means over 21 samples, because the difference of a gyro is mostly noise."""
    kernel = np.ones(21) / 21
    return np.stack([np.convolve(column, kernel, mode="same") for column in values.T], axis=1)


def add_parser(commands: Any) -> None:
    """Adds the subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "fit", help="fit the vehicle's model to logs of flights", description=__doc__
    )
    parser.add_argument("log", type=Path, nargs="+", metavar="LOG", help="MCAP files of tilthex-rt")
    parser.add_argument(
        "--mass",
        type=float,
        metavar="KG",
        help="the weighed mass; a flight determines only the ratio of forces to mass",
    )
    parser.add_argument(
        "--prior",
        action="append",
        default=[],
        metavar=_priors.FORM.split(",")[0],
        help="what you know of a figure before the flight, by its name in the table and in its unit, "
        "inertia_zz=0.0196+-0.0004; repeat it for each figure",
    )
    parser.add_argument(
        "--begin", type=float, metavar="S", help="use each log from this time on, s since its start"
    )
    parser.add_argument(
        "--end", type=float, metavar="S", help="use each log up to this time, s since its start"
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE.toml",
        help="write the corrected vehicle, and what was learnt of its link",
    )
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="draw predicted and measured values")
    _json.add_option(parser)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> None:
    vehicles: list[Vehicle] = [Config.from_text(log.configuration(path)).vehicle for path in arguments.log]
    if any(vehicle != vehicles[0] for vehicle in vehicles):
        raise ValueError("the logs have different vehicles in their configurations; expected flights of one")
    if arguments.mass is not None and not 0.2 < arguments.mass / vehicles[0].mass < 5.0:
        raise ValueError(f"--mass is {arguments.mass} kg, the model's is {vehicles[0].mass} kg; expected kg")
    pairs = [_priors.parse(text) for text in arguments.prior]
    priors = dict(pairs)
    if len(priors) < len(pairs):
        raise ValueError("--prior gives one name twice; expected one prior for each figure")
    flights = [read(path, arguments.begin, arguments.end) for path in arguments.log]
    found = identify(flights, vehicles[0], mass=arguments.mass, priors=priors)
    if arguments.json:
        _json.say(summary(found))
    else:
        print(report(found))
    if arguments.out:
        arguments.out.write_text(toml(found), encoding="utf-8")
        _written(arguments, arguments.out)
    if arguments.plot:
        import matplotlib as mpl

        mpl.use("Agg")
        names = [path.name for path in arguments.log]
        figure(flights, found, names).savefig(arguments.plot, dpi=120)
        _written(arguments, arguments.plot)


def _written(arguments: argparse.Namespace, path: Path) -> None:
    """Says which file was written, where this does not disturb a script."""
    if not arguments.json:
        print(path)
