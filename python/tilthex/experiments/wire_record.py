"""A flight with the real programs as a record: the log of `tilthex-rt` and the true values of the world.

Both have times of the monotonic clock of the same machine. Each tick gets the true values of the nearest
cycle, which is at most half a millisecond away.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tilthex import log
from tilthex._faults import FAULTS
from tilthex._quaternions import rotations_from_quaternions
from tilthex.experiments.record import COLUMNS, Check, Record, below
from tilthex.experiments.spec import Run
from tilthex.experiments.wire import Files, Route

Vector = NDArray[np.float64]

TOPICS = ("/flight", "/state", "/setpoint", "/reference", "/wrench", "/control", "/timing")
FLYING = "flying"
"""The phase in which nothing holds the flight back."""
ORDERED = "operator"
"""The fault that an order to land counts as."""
BESIDE = 0.1
"""Largest distance between the places on the stand where a flight begins and ends, m."""
APART = 3e-3
"""Largest distance of the logged set-point from the planned one, m: the motion in a tick, and a
margin."""


def read(run: Run, route: Route, files: Files) -> tuple[Record, list[str]]:
    """The run's part of a flight, and notes on the whole flight.

    Raises:
        ValueError: The log or the true values are not complete, or belong to another route.
    """
    columns = log.read(files.log, TOPICS)
    lengths = {len(found["log_time"]) for found in columns.values()}
    if len(lengths) != 1:
        raise ValueError(
            f"{files.log} has topics of {len(lengths)} lengths; expected one message each a tick"
        )
    time = columns["/flight"]["time"]
    begin = _begin(columns, files.log)
    trajectory = route.trajectory
    _check_way(route, columns, begin, files.log)
    begins = np.array(trajectory.begins)
    # From the stay at the run's first way-point to the end of the stay at its last.
    count = len(run.waypoints)
    arrival = begins[route.first] - route.waypoints[route.first].hold
    leave = begins[route.first + count - 1]
    rows = np.flatnonzero((time >= begin + arrival) & (time < begin + leave))
    record = Record(_truth(files.truth, time[rows]), list(dict.fromkeys(p.phase for p in run.waypoints)))
    record.run = run.name
    record.columns["time"] = time[rows] - begin - arrival
    chain = {name: values[rows] for name, values in _chain(columns).items()}
    record.take(chain, run.model().tool_rotation)
    record.seconds = float(leave - arrival)
    # For each row, the run's way-point to which the tool moves, or at which it stays.
    on_way = np.searchsorted(begins[route.first :], time[rows] - begin, side="right")
    owner = np.array([record.phases.index(point.phase) for point in run.waypoints])
    record.phase = owner[np.minimum(on_way, count - 1)]
    if np.any(columns["/flight"]["phase"][rows] != FLYING):
        record.ended = "the supervisor held the tool back"
    return record, [*_notes(columns, rows), _off(record)]


def landing(run: Run, files: Files) -> list[Check]:
    """Whether the whole flight ended where it began, and without a fault that holds or lands the vehicle.

    What only holds does not count in a landing: the ground exerts a wrench.
    """
    flight = log.read(files.log, ["/flight"])["/flight"]
    with np.load(files.truth) as data:
        first, last = data["robot_position"][[0, -1]]
    phase, active = flight["phase"], flight["faults"].astype(np.int64)
    aloft, free = (_any(active[rows]) for rows in (log.flying(phase), np.isin(phase, log.FREE_FLIGHT)))
    found = [
        fault.name
        for bit, fault in enumerate(FAULTS)
        if (fault.in_flight in ("land", "descend") and aloft >> bit & 1 and fault.name != ORDERED)
        or (fault.in_flight == "hold" and free >> bit & 1)
    ]
    away = float(np.linalg.norm(last - first))
    return [
        below(f"{run.name}: distance between landing and start", away, BESIDE, "mm", scale=1e3),
        Check(f"{run.name}: faults in flight", "none", "", ", ".join(found) or "none", not found),
    ]


def _any(bits: NDArray[np.int64]) -> int:
    return int(np.bitwise_or.reduce(bits, initial=0))


def _begin(columns: dict[str, log.Columns], path: Path) -> float:
    """The time at which the route began: the first set-point that moves after the bias was learnt."""
    compliant = columns["/control"]["compliant"] > 0.0
    moves = np.linalg.norm(columns["/setpoint"]["velocity_w"], axis=1) > 0.0
    found = np.flatnonzero(compliant & moves)
    if not len(found):
        raise ValueError(f"{path} holds no flight that reached its trajectory")
    return float(columns["/flight"]["time"][found[0] - 1])


def _check_way(route: Route, columns: dict[str, log.Columns], begin: float, path: Path) -> None:
    """The set-points of the log must be those of the route; otherwise phases and times mean nothing."""
    time, trajectory = columns["/flight"]["time"] - begin, route.trajectory
    rows = np.flatnonzero((time > trajectory.begins[0]) & (time < trajectory.duration))[::50]
    planned = np.array([trajectory.sample(float(t)).position for t in time[rows]])
    # The route begins where take-off ended.
    later = time[rows] > trajectory.begins[1]
    apart = np.linalg.norm(columns["/setpoint"]["position_w"][rows] - planned, axis=1)[later]
    if not len(apart) or np.max(apart) > APART:
        worst = np.max(apart) if len(apart) else float("nan")
        raise ValueError(
            f"{path}: its set-points are up to {1e3 * worst:.1f} mm off the trajectory; expected at most "
            f"{1e3 * APART:g} mm: the flight was held back, or is another one"
        )


def _truth(path: Path, times: Vector) -> dict[str, Vector]:
    with np.load(path) as data:
        at = 1e-9 * data["at"]
        if not len(at) or times[0] < at[0] or times[-1] > at[-1] + 0.1:
            raise ValueError(f"{path} does not cover the flight; expected the truth of the same one")
        after = np.clip(np.searchsorted(at, times), 1, len(at) - 1)
        nearest = np.where(times - at[after - 1] < at[after] - times, after - 1, after)
        return {name: data[name][nearest] for name in COLUMNS}


def _chain(columns: dict[str, log.Columns]) -> dict[str, Vector]:
    """The columns of `tilthex.Loop.record`."""
    state, wrench, control = columns["/state"], columns["/wrench"], columns["/control"]
    found = {
        "estimated_position": state["position_w"],
        "estimated_velocity": state["velocity_w"],
        "estimated_rotation": rotations_from_quaternions(state["orientation"]),
        "position_error": control["position_error_w"],
        "rotation_error": control["rotation_error_r"],
        "saturated": control["saturated"][:, None],
    }
    for name in ("setpoint", "reference"):
        target = columns[f"/{name}"]
        found[f"{name}_position"] = target["position_w"]
        found[f"{name}_rotation"] = rotations_from_quaternions(target["orientation"])
    for name in ("robot", "tool", "contact", "admittance"):
        field = name if name == "robot" else f"{name}_w"
        found[f"wrench_{name}"] = np.hstack([wrench[f"{field}.force"], wrench[f"{field}.torque"]])
    return found


def _notes(columns: dict[str, log.Columns], rows: NDArray[np.int64]) -> list[str]:
    """The timing of the loop, over the whole flight and in the run's part of it."""
    timing = columns["/timing"]
    flying = log.flying(columns["/flight"]["phase"])
    latency = timing["imu_to_command"][flying & (timing["imu_to_command"] > 0.0)]
    return [
        f"{len(timing['skipped'])} ticks, {int(np.sum(timing['skipped']))} periods skipped, of them "
        f"{int(np.sum(timing['skipped'][rows]))} in the run",
        f"wake-up {_quantiles(timing['wake_latency'])} late",
        f"command {_quantiles(latency)} after its IMU sample was found",
    ]


def _off(record: Record) -> str:
    """Distance of the true tool from the pose that the controller wanted."""
    off = np.linalg.norm(record.tool_position - record.reference_position, axis=1)
    return f"true tool {1e3 * np.max(off):.2f} mm at most from its reference"


def _quantiles(nanoseconds: Vector) -> str:
    half, most, worst = 1e-3 * np.percentile(nanoseconds, [50.0, 99.0, 100.0])
    return f"{half:.0f} us (median), {most:.0f} us (99 %), {worst:.0f} us (largest)"
