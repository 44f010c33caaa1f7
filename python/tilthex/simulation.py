"""A whole flight, simulated in Rust."""

from __future__ import annotations

import inspect
import operator
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tilthex import _core

if TYPE_CHECKING:
    import pandas as pd


TRUTH_HELP = (
    "how the simulated vehicle differs from the controller's model, drawn for each seed: exact, measured, "
    "cad, outdoors, or a TOML file with a [truth] table"
)
"""The help text of the option `--truth`."""


Truth = _core.Truth | str | os.PathLike[str] | dict[str, Any] | None
"""How a true vehicle differs from that of the controller; `simulate` explains each form."""


class FaultChange(NamedTuple):
    """A fault that begins or ends."""

    time: float
    """When, s."""
    name: str
    """The name of the fault, as in docs/faults.md."""
    begins: bool
    """Whether it begins."""


class Run(dict[str, NDArray[np.float64]]):
    """Named arrays, (N, k), one row per control period of 2 ms.

    True values of the robot: `time` s; `position`, `velocity`, `rotation` (row by row),
    `angular_velocity`; `tool_position`, `tool_rotation`. The state that the controller gets:
    `estimated_position`, `estimated_velocity`, `estimated_rotation`. Of the tool: `setpoint_position`,
    `setpoint_rotation`, `reference_position`, `reference_rotation`. Of the pose controller:
    `position_error`, `rotation_error`. Observed wrenches: `wrench_robot`, `wrench_tool`; the true one at
    the tool: `wrench_true`. Estimated (with `[contact] discrimination`): `wrench_contact`, the part of
    `wrench_tool` that is no drag of the wind, `wind` m/s and `contact_likelihood` 0 to 1. `rotor_speeds`,
    `rotor_command` Hz. Values of the sensors: `gyro` rad/s and `specific_force` m/s^2, IMU axes, and
    `measured_rotor_speeds` Hz. `saturated` 0 or 1. `phase` 0
    disarmed, 1 starting, 2 grounded, 3 flying, 4 holding, 5 landing, 6 emergency.
    """

    faults: list[FaultChange]
    """The faults of the flight that began and ended, in the order of their times."""

    def to_dataframe(self) -> pd.DataFrame:
        """A table with one column per number, named `position_0`, ..., indexed by a recorded time.

        Needs pandas.
        """
        import pandas as pd

        columns = {
            name if array.shape[1] == 1 else f"{name}_{k}": array[:, k]
            for name, array in self.items()
            for k in range(array.shape[1])
        }
        frame: pd.DataFrame = pd.DataFrame(columns)
        if "time" in frame:
            frame = frame.set_index("time")
        return frame


def simulate(
    config: _core.Config,
    *,
    duration: float,
    setpoint: _core.Setpoint | None = None,
    trajectory: _core.Trajectory | None = None,
    pushes: Sequence[dict[str, Any]] = (),
    noise: float = 1.0,
    gyro_bias: ArrayLike | None = None,
    accelerometer_bias: ArrayLike | None = None,
    seed: int = 0,
    estimator: bool = True,
    pose_delay: float = 0.015,
    start: str = "air",
    truth: Truth = None,
    record: Sequence[str] | None = None,
) -> Run:
    """Flies the flight of `tilthex-rt` on the simulated vehicle, in Rust and without the GIL.

    Args:
        config: The configuration; its vehicle flies.
        duration: Duration, s.
        setpoint: A tool pose to hold. Give either this or a trajectory.
        trajectory: A trajectory of the tool.
        pushes: Pushes on the tool: dicts with `at` and `duration`, s, and `force`, N, or `torque`, N m,
            or both, (3,), world, at the tip. `at` counts from the begin in the air, or from the motors'
            start.
        noise: Factor of the noise of the experiments, whose standard deviations are 0.3 mm, 2 mrad, 5
            mrad/s, 0.15 m/s^2 and 0.1 Hz; 0 for ideal sensors.
        gyro_bias: Constant bias of the gyroscope, rad/s, IMU axes, (3,).
        accelerometer_bias: Constant bias of the accelerometer, m/s^2, IMU axes, (3,).
        seed: The same seed gives the same flight.
        estimator: Whether the controller gets the estimator's state, from inertial samples at 500 Hz and
            poses at 100 Hz. Otherwise it gets the true pose and twist.
        pose_delay: Age of a captured pose when it arrives, s.
        start: "air" begins at rest with the tool on its first set-point. "ground" begins with the motors
            off, takes off, hovers and then flies to the set-point or along the trajectory.
        truth: How the true vehicle differs from the vehicle of `config`, which the controller uses: a
            level ("exact", "measured", "cad", "outdoors"), a TOML file with a `[truth]` table, or its
            keys. The vehicle is drawn with `seed`; `Truth(config.vehicle, truth).draw(seed)` returns it.
        record: The columns of `Run` that are kept; all if it is not given.
    """
    flight = {
        "duration": duration,
        "setpoint": setpoint,
        "trajectory": trajectory,
        "pushes": list(pushes),
        "noise": noise,
        "gyro_bias": gyro_bias,
        "accelerometer_bias": accelerometer_bias,
        "estimator": estimator,
        "pose_delay": pose_delay,
        "start": start,
    }
    _check_kinds(flight)
    columns, faults = _core.simulate(config, truth, seed, flight, None if record is None else list(record))
    run = Run(columns)
    run.faults = [FaultChange(*fault) for fault in faults]
    return run


_COMMON = {
    name: parameter.default
    for name, parameter in inspect.signature(simulate).parameters.items()
    if name not in ("config", "seed", "truth", "record")
}
"""The arguments that the flights of `simulate_many` have in common, and their defaults."""


class Runs(dict[str, NDArray[np.float64]]):
    """The figures of many flights: (N,) per figure, one row per flight.

    `seed`; `position_error_rms` and `position_error_largest`, m, of the pose controller;
    `rotation_error_largest`; `tool_deviation_largest`, m, of the true tool from its set-point;
    `tool_force_largest`, N, true; `tilt_largest`, rad, of the true robot; `saturated`, the part of the
    ticks in which a rotor was at a limit; `phase` at the end, as in `Run`.
    """

    record: dict[str, NDArray[np.float64]]
    """The recorded columns, (N, rows, k), with the names of `Run`."""

    def to_dataframe(self) -> pd.DataFrame:
        """A table with one row per flight. Needs pandas."""
        import pandas as pd

        frame: pd.DataFrame = pd.DataFrame(dict(self))
        return frame


def simulate_many(
    configs: _core.Config | Sequence[_core.Config],
    truths: Truth | Sequence[Truth] = None,
    seeds: int | Sequence[int] = 0,
    *,
    record: Sequence[str] = (),
    workers: int | None = None,
    progress: bool | Callable[[int, int], object] = False,
    **flight: Any,
) -> Runs:
    """Flies many flights in parallel, in Rust and without the GIL. Each flight equals that of `simulate`.

    Args:
        configs: One configuration, or one for each flight.
        truths: One truth as `simulate` takes it, or a sequence with one for each flight.
        seeds: One seed, or one for each flight: `range(100)` flies a hundred. Sequences have equal
            lengths.
        record: The columns of `Run` that are kept for every flight.
        workers: Number of flights at the same time; the number of processors if it is not given.
        progress: True for a bar on the terminal, or a function that gets the number of flights that have
            ended and the number of all flights.
        **flight: The other arguments of `simulate`, the same for all flights.

    Raises:
        ValueError: The sequences have different lengths, or a flight is refused; the sentence says which.
    """
    if unknown := flight.keys() - set(_COMMON):
        found, known = ", ".join(sorted(unknown)), ", ".join(_COMMON)
        raise TypeError(f"simulate_many got {found}; expected any of {known}")
    if "duration" not in flight:
        raise TypeError("simulate_many got no duration; expected a number of seconds")
    given: dict[str, Any] = {"configs": configs, "truths": truths, "seeds": seeds}
    several = {name: list(value) for name, value in given.items() if _is_several(value)}
    if len({len(value) for value in several.values()}) > 1:
        found = ", ".join(f"{len(value)} {name}" for name, value in several.items())
        raise ValueError(f"found {found}; expected equally many; give what all flights share without a list")
    count = next((len(value) for value in several.values()), 1)
    rows = {name: several.get(name, [value] * count) for name, value in given.items()}
    for number, config in enumerate(rows["configs"]):
        if not isinstance(config, _core.Config):
            kind = type(config).__name__
            raise TypeError(f"the config of flight {number} is a {kind}; expected a tilthex.Config")
    common = _COMMON | flight | {"pushes": list(flight.get("pushes", ()))}
    _check_kinds(common)
    figures, columns = _core.simulate_many(
        rows["configs"],
        rows["truths"],
        [operator.index(seed) for seed in rows["seeds"]],
        common,
        list(record),
        workers,
        _told(progress, count),
    )
    runs = Runs({"seed": np.array(rows["seeds"], float)} | figures)
    runs.record = columns
    return runs


_KINDS: dict[str, tuple[Any, str]] = {
    "duration": (Real, "a number of seconds"),
    "setpoint": (_core.Setpoint | None, "a tilthex.Setpoint"),
    "trajectory": (_core.Trajectory | None, "a tilthex.Trajectory"),
    "noise": (Real, "a number"),
    "estimator": (bool | np.bool_, "True or False"),
    "pose_delay": (Real, "a number of seconds"),
    "start": (str, "'air' or 'ground'"),
}
"""The kind of each argument, and how it is named."""


def _check_kinds(flight: Mapping[str, Any]) -> None:
    """Refuses an argument of the wrong kind by its name."""
    for name, (kind, expected) in _KINDS.items():
        if not isinstance(flight[name], kind):
            raise TypeError(f"{name} is a {type(flight[name]).__name__}; expected {expected}")
    for number, push in enumerate(flight["pushes"]):
        if not isinstance(push, dict):
            raise TypeError(f"pushes[{number}] is a {type(push).__name__}; expected a dict")


def _is_several(value: Any) -> bool:
    return isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)


def _told(progress: bool | Callable[[int, int], object], count: int) -> Callable[[int], object] | None:
    """The function that is called with the number of flights that have ended."""
    if callable(progress):
        return lambda ended: progress(ended, count)
    if not progress:
        return None

    def bar(ended: int) -> None:
        full = 40 * ended // max(count, 1)
        end = "\n" if ended == count else ""
        print(f"\r[{'#' * full}{'.' * (40 - full)}] {ended} of {count} flights", end=end, file=sys.stderr)

    return bar
