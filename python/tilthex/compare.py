"""`tilthex compare`: the observed wrench of a flight beside an external six-axis force-torque sensor."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex import _json
from tilthex._sensed import ToolPath, Wrenches, observed, read_sensor, sensed
from tilthex.wrenches import NAMES, components, norms, without_phase

Array = NDArray[np.float64]

RATE = 100.0
"""Both signals are compared at this rate, Hz."""
COMMON = 0.3
"""The two signals must have this part of the shorter one in common."""
CONTACT = 0.1
"""The parts in common must hold this part of each signal's energy; otherwise the correlation is
reduced."""
ALIKE = 0.5
"""Signals with a lower correlation do not show the same contact."""
IN_NEWTON = np.array([1.0, 1.0, 1.0, 4.0, 4.0, 4.0])
"""Lever arm, m, by which a torque is divided when signals are correlated."""


@dataclass(frozen=True)
class Comparison:
    """Both wrenches on one clock, after a low-pass.

    `time`, s since take-off, (n,); wrenches (n, 6).

    `offset`, s, was added to the sensor's times; `correlation`, -1 to 1, is that of the two signals.
    """

    time: Array
    observed: Array
    sensor: Array
    offset: float
    correlation: float

    def __str__(self) -> str:
        """Mean and rms of the difference of each component, and the sensor's rms about its mean."""
        lines = [
            f"from {self.time[0]:.1f} to {self.time[-1]:.1f} s since take-off",
            f"sensor's times moved by {self.offset:.4f} s; correlation {self.correlation:.3f}",
            f"{'':10s} {'mean off':>10s} {'rms off':>10s} {'sensor rms':>10s} {'off/sensor':>10s}",
        ]
        for k, (name, found) in enumerate(self.components().items()):
            mean, spread, swing = found["mean_off"], found["std_off"], found["sensor_std"]
            part = f"{spread / swing:10.1%}" if swing > 0 else f"{'-':>10s}"
            unit = "N" if k < 3 else "N m"
            lines.append(f"{name:10s} {mean:10.4f} {spread:10.4f} {swing:10.4f} {part} {unit}")
        return "\n".join(lines)

    def components(self) -> dict[str, dict[str, float]]:
        """For each component mean and standard deviation of the difference, and the sensor's, N or N m.

        Their names are `mean_off`, `std_off` and `sensor_std`.
        """
        off = self.observed - self.sensor
        return {
            name: {
                "mean_off": float(off[:, k].mean()),
                "std_off": float(np.std(off[:, k])),
                "sensor_std": float(np.std(self.sensor[:, k])),
            }
            for k, name in enumerate(NAMES)
        }


@dataclass(frozen=True)
class Mounting:
    """The mounting of the sensor.

    `on_tool` true: the sensor is fixed to the tool, and `position` (m) and `rotation` map from sensor to
    tool axes. Otherwise it is fixed to the world, and both map from sensor to world axes. `reads_robot`
    true: it measures the wrench of the robot on the sensor, as a sensor behind a work piece does.
    Otherwise it measures the wrench on the robot.
    """

    on_tool: bool = False
    position: Array | None = None
    """None: the sensor's torque is already about the tip of the tool."""
    rotation: Array | None = None
    reads_robot: bool = True


def compare(
    flight: Wrenches,
    tool: ToolPath,
    sensor: Wrenches,
    mounting: Mounting,
    *,
    offset: float | None = None,
    tare: tuple[float, float] | None = None,
    begin: float | None = None,
    end: float | None = None,
) -> Comparison:
    """Puts both on one clock and into tool axes, and applies a low-pass to them.

    Without `offset`, the clocks are aligned at the largest correlation of the two signals. This hides the
    observer's lag.

    Args:
        flight: The observed wrench: on the robot, about the tip of the tool, world axes.
        tool: The motion of the tool.
        sensor: The readings of the sensor, about its origin, in its axes.
        mounting: The mounting of the sensor.
        offset: Time that is added to the sensor's times, s; None finds it.
        tare: A time without contact, s since the start of `flight`. The sensor's mean there is its zero.
        begin: The first time that counts, s since the start of `flight`; None: `flight.learnt`.
        end: The last one.

    Raises:
        ValueError: The two signals have no contact in common.
    """
    start = float(flight.time[0])
    grid = np.arange(start, flight.time[-1], 1.0 / RATE)
    counts = grid - start >= (flight.learnt if begin is None else begin)
    counts &= grid - start <= (np.inf if end is None else end)
    if counts.sum() < 2 * RATE:
        raise ValueError(
            f"{counts.sum() / RATE:.2f} s of the flight count; expected 2 s at least: see --begin"
        )
    turn = np.eye(3) if mounting.rotation is None else mounting.rotation
    sign = -1.0 if mounting.reads_robot else 1.0
    fixed = sign * np.hstack([sensor.wrench[:, :3] @ turn.T, sensor.wrench[:, 3:] @ turn.T])
    path = np.stack([_at(tool.time, column, grid) for column in tool.rotation.reshape(-1, 9).T], axis=1)
    rotation, tip = path.reshape(-1, 3, 3), _resampled(tool.time, tool.position, grid)
    in_world = _smooth(_resampled(flight.time, flight.wrench, grid))
    in_tool = _turned(np.swapaxes(rotation, 1, 2), in_world)
    if offset is None:
        # If the sensor is fixed to the world, one mean position of the tip is enough.
        about_tip = fixed
        if mounting.position is not None:
            lever = mounting.position - (0.0 if mounting.on_tool else tip.mean(axis=0))
            about_tip = _moved(fixed, lever)
        ours = in_tool if mounting.on_tool else in_world
        offset = _offset(grid[counts], ours[counts], Wrenches(sensor.time, about_tip))
    time = sensor.time + offset
    inside = (grid >= time[0]) & (grid <= time[-1])
    used = inside & counts
    if used.sum() < 2 * RATE:
        raise ValueError(
            f"flight and sensor share {used.sum() / RATE:.2f} s where the sensor's times are moved by "
            f"{offset:.3f} s; expected 2 s at least"
        )
    theirs = _resampled(time, fixed, grid)
    if mounting.position is not None:
        theirs = _moved(theirs, mounting.position - (0.0 if mounting.on_tool else tip))
    if not mounting.on_tool:
        theirs = _turned(np.swapaxes(rotation, 1, 2), theirs)
    theirs = _smooth(theirs)
    if tare is not None:
        still = (grid - start >= tare[0]) & (grid - start <= tare[1]) & inside
        if not still.any():
            raise ValueError(
                f"the sensor has no reading from {tare[0]} to {tare[1]} s; expected a time without contact"
            )
        theirs = theirs - theirs[still].mean(axis=0)
    ours, theirs = in_tool[used], theirs[used]
    return Comparison(grid[used] - start, ours, theirs, offset, _correlation(ours, theirs))


def _at(time: Array, values: Array, at: Array) -> Array:
    return np.asarray(np.interp(at, time, values))


def _resampled(time: Array, values: Array, at: Array) -> Array:
    """Means over the steps of `at` if the values are denser than that; otherwise linear interpolation."""
    step = float(np.median(np.diff(time)))
    width = max(1, round(1.0 / RATE / step))
    kernel = np.ones(width) / width
    columns = [
        np.convolve(np.pad(c, width, mode="edge"), kernel, mode="same")[width:-width] for c in values.T
    ]
    return np.stack([_at(time, column, at) for column in columns], axis=1)


def _smooth(values: Array) -> Array:
    return without_phase(values, RATE)


def _turned(rotation: Array, wrench: Array) -> Array:
    return np.hstack([np.einsum("nij,nj->ni", rotation, part) for part in (wrench[:, :3], wrench[:, 3:])])


def _moved(wrench: Array, lever: Array) -> Array:
    """The torque about a point from which the old reference point is at `lever`."""
    return np.hstack([wrench[:, :3], wrench[:, 3:] + np.cross(lever, wrench[:, :3])])


def _offset(grid: Array, ours: Array, sensor: Wrenches) -> float:
    """The time to add to the sensor's times: that of the largest correlation of all six components."""
    from scipy.signal import correlate

    theirs_at = np.arange(sensor.time[0], sensor.time[-1], 1.0 / RATE)
    if len(theirs_at) < 2 * RATE:
        raise ValueError(f"the sensor's readings last {len(theirs_at) / RATE:.2f} s; expected 2 s at least")
    theirs = _smooth(_resampled(sensor.time, sensor.wrench, theirs_at))
    a, b = ((signal - signal.mean(axis=0)) * IN_NEWTON for signal in (ours, theirs))
    shared = correlate(np.ones(len(a)), np.ones(len(b)))
    # The correlation of each lag is divided by the energies of the common part, so that a short one
    # does not win.
    power_a = correlate(np.sum(a**2, axis=1), np.ones(len(b)))
    power_b = correlate(np.ones(len(a)), np.sum(b**2, axis=1))
    product = np.sum([correlate(a[:, k], b[:, k]) for k in range(6)], axis=0)
    known = shared > COMMON * min(len(a), len(b))
    # A lag at which there is hardly a signal must not win either.
    power_a, power_b = (np.maximum(power, CONTACT * np.max(power)) for power in (power_a, power_b))
    alike = np.where(known, product / np.sqrt(power_a * power_b + 1e-12), 0.0)
    best = int(np.argmax(alike))
    if alike[best] < ALIKE:
        opposite = "; the opposite sign fits better: see --reads" if -alike[known].min() > ALIKE else ""
        raise ValueError(
            f"the sensor's readings are not like the observed wrench: largest correlation {alike[best]:.2f}, "
            f"expected {ALIKE} at least{opposite}"
        )
    part = 0.0
    if 0 < best < len(alike) - 1:
        before, at, after = alike[best - 1 : best + 2]
        part = 0.5 * (before - after) / (before - 2 * at + after)
    return float(grid[0] - theirs_at[0] + (best - (len(b) - 1) + part) / RATE)


def _correlation(a: Array, b: Array) -> float:
    a, b = ((signal - signal.mean(axis=0)) * IN_NEWTON for signal in (a, b))
    return float(np.sum(a * b) / np.sqrt(np.sum(a * a) * np.sum(b * b)))


def add_parser(commands: Any) -> None:
    """Adds the subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "compare", help="compare the observed wrench with a force-torque sensor", description=__doc__
    )
    parser.add_argument("log", type=Path, metavar="LOG", help="MCAP file of tilthex-rt")
    parser.add_argument(
        "sensor", type=Path, metavar="SENSOR", help="the sensor's table (.csv) or messages (.mcap)"
    )
    parser.add_argument("--topic", help="the sensor's topic, if the file has more than one")
    parser.add_argument(
        "--fixed-to",
        choices=("world", "tool"),
        default="world",
        help="the body to which the sensor is fixed (default: world)",
    )
    parser.add_argument(
        "--reads",
        choices=("robot", "environment"),
        default="robot",
        help="what exerts the wrench that it reads (default: robot, as behind a work piece)",
    )
    parser.add_argument(
        "--offset",
        type=float,
        metavar="S",
        help="time to add to the sensor's times (default: found by correlation)",
    )
    for name, words, meaning in (
        ("--rotation-deg", ("R", "P", "Y"), "the sensor's axes in the axes of the body to which it is fixed"),
        ("--position", ("X", "Y", "Z"), "the sensor's origin in the same axes, m (default: the tool's tip)"),
        (
            "--tare",
            ("BEGIN", "END"),
            "take the sensor's mean between two times without contact, s since take-off, as its zero",
        ),
    ):
        parser.add_argument(name, type=float, nargs=len(words), metavar=words, help=meaning)
    parser.add_argument(
        "--begin",
        type=float,
        metavar="S",
        help="first time that counts, s since take-off (default: the end of the hover for the bias)",
    )
    parser.add_argument("--end", type=float, metavar="S", help="last time that counts, s since take-off")
    parser.add_argument(
        "--out",
        type=Path,
        help="start of the names of the pictures: OUT-norms.png, OUT-components.png (default: LOG)",
    )
    _json.add_option(parser)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> None:
    import matplotlib as mpl
    from scipy.spatial.transform import Rotation

    mpl.use("Agg")
    turn = arguments.rotation_deg
    mounting = Mounting(
        on_tool=arguments.fixed_to == "tool",
        position=None if arguments.position is None else np.array(arguments.position),
        rotation=None if turn is None else Rotation.from_euler("ZYX", turn[::-1], degrees=True).as_matrix(),
        reads_robot=arguments.reads == "robot",
    )
    sensor = sensed(read_sensor(arguments.sensor, arguments.topic))
    options = {name: getattr(arguments, name) for name in ("offset", "tare", "begin", "end")}
    found = compare(*observed(arguments.log), sensor, mounting, **options)
    stem = arguments.out or arguments.log.with_suffix("")
    pictures = []
    for name, draw in (("norms", norms), ("components", components)):
        pictures.append(stem.with_name(f"{stem.name}-{name}.png"))
        draw(found.time, found.observed, found.sensor).savefig(pictures[-1], dpi=120)
    if arguments.json:
        figures = {"offset": found.offset, "correlation": found.correlation}
        _json.say(figures | {"components": found.components(), "pictures": pictures})
        return
    print(found, *pictures, sep="\n")


__all__ = ["Comparison", "Mounting", "ToolPath", "Wrenches", "compare", "observed", "read_sensor", "sensed"]
