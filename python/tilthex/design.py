"""`tilthex design`: what a vehicle can do, over ranges of the keys of its file.

Sweeps one or two keys of the vehicle file. For each point it reports how well the rotors reach the six
directions of the wrench, what hovering costs, how much lateral force is left, and what a moderate lateral
force costs. A larger tilt makes lateral force cheaper and hovering more expensive; the paper's vehicles
have 30 to 35 deg.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex import Vehicle, _json, polytope

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Figures:
    """The figures of one vehicle.

    Attributes: conditioning: Smallest divided by largest singular value of the allocation matrix, with
    torques divided by the arm length. 0 to 1; 0 if a direction is missing. hover_efficiency: Weight
    divided by the sum of the rotors' thrusts in a level hover; 0 to 1. lateral_efficiency: Sum of squared
    inputs of a hover on upright rotors, divided by that of a hover that pushes sideways with `LATERAL` of
    the weight; mean over all directions; 0 to 1. lateral_reach: Horizontal force that is possible in
    every direction in a level hover, N; NaN without such a hover. payload: Mass that can be added, kg;
    NaN without a level hover.
    """

    conditioning: float
    hover_efficiency: float
    lateral_efficiency: float
    lateral_reach: float
    payload: float


LATERAL = 0.3
"""Lateral force of `lateral_efficiency`, as a part of the weight."""
METRICS = tuple(field.name for field in fields(Figures))


def figures(vehicle: Vehicle) -> Figures:
    """The figures of a vehicle."""
    matrix = vehicle.allocation
    thrusts = np.linalg.norm(matrix[:3], axis=0)
    levers = np.linalg.norm(matrix[3:], axis=0) / thrusts
    values = np.linalg.svd(matrix / np.repeat([1.0, levers.mean()], 3)[:, None], compute_uv=False)
    speeds = vehicle.hover_speeds()
    spent = float(thrusts @ speeds**2)
    try:
        reach, mass = polytope.lateral_reach(vehicle), polytope.payload(vehicle)
    except ValueError:
        reach = mass = float("nan")
    return Figures(
        float(values[5] / values[0]) if len(values) == 6 else 0.0,
        vehicle.weight / spent,
        _lateral_efficiency(matrix, thrusts, vehicle.weight),
        reach if np.isfinite(reach) else float("nan"),
        mass if np.isfinite(mass) else float("nan"),
    )


def _lateral_efficiency(matrix: Array, thrusts: Array, weight: float) -> float:
    if np.linalg.matrix_rank(matrix) < 6:
        return 0.0
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    wrenches = np.zeros((24, 6))
    wrenches[:, :3] = weight * np.column_stack(
        [LATERAL * np.cos(angles), LATERAL * np.sin(angles), np.ones(24)]
    )
    inputs = wrenches @ np.linalg.pinv(matrix).T
    upright = weight**2 / float(thrusts @ thrusts)
    return upright / float(np.mean((inputs**2).sum(axis=1)))


@dataclass(frozen=True)
class Sweep:
    """Figures over a grid: `values[metric]` has the shape of the axes' lengths."""

    axes: Mapping[str, Array]
    values: Mapping[str, Array]

    def best(self, metric: str) -> dict[str, float]:
        """The point at which a metric is largest: the value of each key, and the metric."""
        table = self.values[metric]
        if np.isnan(table).all():
            raise ValueError(
                f"{metric} is not defined at any point of this sweep; expected a vehicle that can hover"
            )
        at = np.unravel_index(np.nanargmax(table), table.shape)
        found = {key: float(axis[i]) for (key, axis), i in zip(self.axes.items(), at, strict=True)}
        return found | {metric: float(table[at])}


def sweep(base: Mapping[str, Any], axes: Mapping[str, Array]) -> Sweep:
    """Figures of a vehicle whose keys take all values of a grid.

    Args:
        base: Keys of a `[vehicle]` section, such as `{"preset": "tilt-hex"}`.
        axes: Keys ("mass", "tilted_hexarotor.alpha_deg") and their values.
    """
    tables = {name: np.full([len(v) for v in axes.values()], np.nan) for name in METRICS}
    for at in itertools.product(*[range(len(v)) for v in axes.values()]):
        chosen = {key: float(values[i]) for (key, values), i in zip(axes.items(), at, strict=True)}
        found = figures(Vehicle.from_dict(_with_keys(base, chosen)))
        for name in METRICS:
            tables[name][at] = getattr(found, name)
    return Sweep(dict(axes), tables)


def add_parser(subparsers: Any) -> None:
    """Registers the command with the parsers of `tilthex`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "design",
        help="plot what a vehicle can do over ranges of its keys",
        description="Sweeps one or two keys of a vehicle file and plots conditioning, hover efficiency, "
        "lateral reach and payload.",
    )
    parser.add_argument("--vehicle", default="tilt-hex", help="a preset or a TOML file (default: tilt-hex)")
    parser.add_argument(
        "--sweep",
        action="append",
        metavar="KEY=START:STOP:COUNT",
        help="a key of the vehicle file and its range, once or twice; default: the tilt angles "
        "tilted_hexarotor.alpha_deg=0:60:31 and tilted_hexarotor.beta_deg=-30:30:31",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/design"), help="folder of the plot and the table"
    )
    _json.add_option(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Sweeps, prints the point at which each metric is largest, writes `design.csv` and `design.png`."""
    axes_texts = arguments.sweep or [
        "tilted_hexarotor.alpha_deg=0:60:31",
        "tilted_hexarotor.beta_deg=-30:30:31",
    ]
    axes = dict(_axis(text) for text in axes_texts)
    if len(axes) > 2:
        raise ValueError(f"{len(axes)} keys to sweep; expected one or two")
    for key, values in axes.items():
        if len(axes) == 2 and len(values) < 2:
            raise ValueError(f"--sweep {key} has one value; expected 2 or more of each key, or one key alone")
    name = arguments.vehicle
    base = {"preset": name} if name in Vehicle.presets() else {"file": str(Path(name).resolve())}
    found = sweep(base, axes)
    arguments.out.mkdir(parents=True, exist_ok=True)
    _write_table(found, arguments.out / "design.csv")
    _plot(found, arguments.out / "design.png")
    largest = {metric: found.best(metric) for metric in METRICS}
    if arguments.json:
        _json.say({"largest": largest, "files": [arguments.out / "design.csv", arguments.out / "design.png"]})
        return
    for metric, best in largest.items():
        place = ", ".join(f"{key} = {value:.4g}" for key, value in best.items() if key != metric)
        print(f"{metric}: largest {best[metric]:.4g} at {place}", file=sys.stdout)
    print(f"written: {arguments.out / 'design.csv'}, {arguments.out / 'design.png'}")


def _axis(text: str) -> tuple[str, Array]:
    try:
        key, grid = text.split("=")
        start, stop, count = grid.split(":")
        values = np.linspace(float(start), float(stop), int(count))
    except ValueError:
        raise ValueError(f"--sweep {text}; expected KEY=START:STOP:COUNT, such as mass=2:4:21") from None
    if not len(values):
        raise ValueError(f"--sweep {text} has no values; expected a count of at least 1")
    return key, values


def _with_keys(base: Mapping[str, Any], chosen: Mapping[str, float]) -> dict[str, Any]:
    """The base with each dotted key written into its table."""
    keys: dict[str, Any] = dict(base)
    for dotted, value in chosen.items():
        table = keys
        *tables, last = dotted.split(".")
        for name in tables:
            table[name] = dict(table.get(name, {}))
            table = table[name]
        table[last] = value
    return keys


def _write_table(found: Sweep, path: Path) -> None:
    grid = np.meshgrid(*found.axes.values(), indexing="ij")
    columns = [*grid, *found.values.values()]
    header = ",".join([*found.axes, *found.values])
    np.savetxt(path, np.column_stack([c.ravel() for c in columns]), "%.6g", ",", header=header, comments="")


def _plot(found: Sweep, path: Path) -> None:
    from matplotlib.figure import Figure

    labels = ("conditioning", "hover efficiency", "lateral efficiency", "lateral reach [N]", "payload [kg]")
    figure = Figure(figsize=(16, 8), layout="constrained")
    keys = list(found.axes)
    for place, (metric, label) in enumerate(zip(METRICS, labels, strict=True), start=1):
        axes = figure.add_subplot(2, 3, place)
        table = found.values[metric]
        if len(keys) == 2:
            drawn = axes.contourf(found.axes[keys[0]], found.axes[keys[1]], table.T, levels=20)
            figure.colorbar(drawn, ax=axes)
            axes.set_ylabel(keys[1])
            if not np.isnan(table).all():
                best = found.best(metric)
                axes.plot(best[keys[0]], best[keys[1]], "r*", label="largest")
            if keys == ["tilted_hexarotor.alpha_deg", "tilted_hexarotor.beta_deg"]:
                axes.plot([30, 35], [10, 10], "wo", markeredgecolor="k", label="the paper's two")
            axes.legend(loc="lower right")
        else:
            axes.plot(found.axes[keys[0]], table)
            axes.grid(visible=True)
        axes.set_xlabel(keys[0])
        axes.set_title(label)
    figure.savefig(path, dpi=110)
