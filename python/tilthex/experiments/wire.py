"""Flies a run with the real programs: `tilthex-rt` against `tilthex-sim --world`, in real time."""

from __future__ import annotations

import json
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

import tilthex
from tilthex._mounted import mounted_rpy_deg
from tilthex._programs import Program, free_port
from tilthex.experiments import stand
from tilthex.experiments.plan import trajectory_of
from tilthex.experiments.spec import LIMITS, Experiment, Run, Waypoint

CLEARANCE = 0.25
"""The motions from and to the stand pass this far above the ends of the trajectory, m."""
TAKE_OFF = 0.6
"""Height of the first hover above the stand, m."""
CALIBRATION = 30.0
"""Approximate duration of a calibration flight, s."""
PATIENCE = 40.0
"""If a flight takes longer than expected by this much, its vehicle is lost, s."""
AROUND = 20.0
"""Approximate time of start, take-off, learning of the bias and landing, s."""


@dataclass(frozen=True)
class Route:
    """The way-points of a flight: from above the stand, through those of the run, and back."""

    waypoints: tuple[Waypoint, ...]
    first: int
    """Index of the run's first way-point."""
    limits: Mapping[str, float]

    @property
    def trajectory(self) -> tilthex.Trajectory:
        """The trajectory from the first hover on, as the controller plays it."""
        return trajectory_of(self.waypoints, self.limits)


@dataclass(frozen=True)
class Files:
    """The files that a flight reads and writes."""

    config: Path
    trajectory: Path
    world: Path
    truth: Path
    log: Path
    summary: Path

    @classmethod
    def beside(cls, stem: Path) -> Files:
        """Files whose names begin with a stem."""
        ends = ("-config.toml", "-trajectory.toml", "-world.toml", "-truth.npz", ".mcap", "-summary.txt")
        return cls(*(stem.with_name(stem.name + end) for end in ends))


def check(experiment: Experiment) -> None:
    """Refuses an experiment that `--wire` cannot fly.

    Raises:
        ValueError: The message names the experiments that it can fly.
    """
    if not experiment.wire:
        raise ValueError(
            f"--wire cannot fly {experiment.kind}; expected an experiment whose file has `wire = true`"
        )


def route(run: Run) -> Route:
    """The way-points of the flight of a run. The motions of the run last as long as without `--wire`."""
    flown = trajectory_of(run.waypoints, run.limits)
    begins = [*flown.begins, flown.duration]
    ways = [
        point if k == 0 else _lasting(point, begins[k] - begins[k - 1] - point.hold)
        for k, point in enumerate(run.waypoints)
    ]
    vehicle = run.model()
    above = stand.start(vehicle) + vehicle.tool_position + np.array([0.0, 0.0, TAKE_OFF])
    # As the tool is mounted: the vehicle is level there.
    home = Waypoint("home", tuple(above.tolist()), mounted_rpy_deg(vehicle), 0.0, 0.0, (0.0,) * 6)
    there, back = _over(ways[0]), _over(ways[-1])
    limits = {key: max(value, run.limits[key]) for key, value in LIMITS.items()}
    return Route((home, there, *ways, back, home), 2, limits)


def _lasting(point: Waypoint, duration: float) -> Waypoint:
    return Waypoint(**(asdict(point) | {"duration": duration}))


def _over(point: Waypoint) -> Waypoint:
    x, y, z = point.position
    place = (x, y, z + CLEARANCE)
    return Waypoint("transit", place, point.rpy_deg, 0.0, 0.0, (0.0,) * 6)


def fly(run: Run, files: Files, *, progress: Callable[[float], object] | None = None) -> list[str]:
    """Flies a run, and writes its log, its true values and the summary of `tilthex-rt`.

    Args:
        run: The run.
        files: The files that are written, and those that are read.
        progress: Called with the seconds since its last call.

    Returns:
        How far the world was behind the clock, and the warnings of `tilthex-rt`.

    Raises:
        OSError: A program is missing, or did not end as it should; with the program's own sentence.
    """
    flown = route(run)
    config = {"vehicle": run.vehicle} | dict(run.config)
    mission = {"take_off_height": TAKE_OFF, "calibration": run.calibration}
    config["mission"] = mission | config.get("mission", {})
    files.config.write_text(toml_text(config), encoding="utf-8")
    # At the first way-point, take-off ends.
    points = [
        {
            "position": point.position,
            "yaw_pitch_roll_deg": point.rpy_deg[::-1],
            "force": point.wrench[:3],
            "torque": point.wrench[3:],
            "force_axes": list(point.force_axes),
            "duration": point.duration,
            "hold": point.hold,
        }
        for point in flown.waypoints[1:]
    ]
    text = toml_text({"limits": dict(flown.limits), "waypoint": points})
    files.trajectory.write_text(text, encoding="utf-8")
    files.world.write_text(toml_text(world_table(run)), encoding="utf-8")
    for path in (files.log, files.truth):
        path.unlink(missing_ok=True)
    mocap = f"natnet://127.0.0.1:{free_port()}/TILTHEX"
    common = ["--config", str(files.config), "--mocap", mocap]
    world = ["--world", str(files.world), "--world-truth", str(files.truth), "--seed", str(run.seed)]
    with ExitStack() as stack:
        # A socket with a short path. The bytes of a pseudo-terminal would wait for a work queue of
        # the kernel.
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="tilthex-"))
        line = Path(folder) / "vehicle"
        world += ["--socket", str(line)]
        simulated = Program(stack, "tilthex-sim", [*common, *world], subprocess.PIPE)
        assert simulated.process.stdout is not None
        simulated.ready()
        summary = stack.enter_context(files.summary.open("w", encoding="utf-8"))
        start = ["--take-off", "--no-battery-limits", "--trajectory", str(files.trajectory)]
        link = ["--port", f"unix:{line}", "--baud", "0", "--log", str(files.log), *start]
        controller = Program(stack, "tilthex-rt", [*common, *link], summary)
        _watch(controller.process, expected(run) + PATIENCE, files, progress)
        if simulated.process.poll() is not None:
            raise OSError(simulated.sentence())
        if controller.process.returncode != 0:
            raise OSError(f"{controller.sentence()} (the log is {files.log})")
        simulated.process.send_signal(signal.SIGINT)
        lag = simulated.process.stdout.read().strip()
        if simulated.process.wait() != 0:
            raise OSError(simulated.sentence())
        return [lag, *controller.warnings()]


def expected(run: Run) -> float:
    """The approximate duration of a flight, s."""
    calibration = CALIBRATION if run.calibration != "none" else 0.0
    return AROUND + calibration + route(run).trajectory.duration


def toml_text(table: Mapping[str, Any], path: str = "") -> str:
    """A table as TOML: numbers, strings, lists of them, tables and lists of tables."""
    lines, below = [], []
    for key, value in table.items():
        name = f"{path}{key}"
        if isinstance(value, Mapping):
            below.append(f"\n[{name}]\n{toml_text(value, name + '.')}")
        elif isinstance(value, (list, tuple)) and value and isinstance(value[0], Mapping):
            below += [f"\n[[{name}]]\n{toml_text(item, name + '.')}" for item in value]
        else:
            # JSON and TOML write numbers, strings and lists of them in the same way.
            lines.append(f"{key} = {json.dumps(value)}\n")
    return "".join(lines + below)


def world_table(run: Run) -> dict[str, Any]:
    """An experiment's file with only this run."""
    points = [asdict(point) for point in run.waypoints]
    return {
        "experiment": run.experiment,
        "vehicle": run.vehicle,
        "truth": run.truth,
        "seed": run.seed,
        "config": run.config,
        "world": run.world,
        "noise": asdict(run.noise),
        "trajectory": {**run.limits, "waypoint": points},
        "judge": run.judge,
        "run": [{"name": run.name}],
    }


def _watch(
    process: subprocess.Popen[str],
    patience: float,
    files: Files,
    progress: Callable[[float], object] | None,
) -> None:
    """Waits for the end of the flight. If the vehicle ends first, the controller ends by itself."""
    begun = last = time.monotonic()
    while process.poll() is None:
        time.sleep(0.1)
        now = time.monotonic()
        if progress is not None:
            progress(now - last)
        if now - begun > patience:
            raise OSError(
                f"the flight did not end within {patience:.0f} s: the vehicle is lost; {files.summary} says "
                "how many ticks were late, and a machine that stops in flight for 0.2 s is enough"
            )
        last = now
