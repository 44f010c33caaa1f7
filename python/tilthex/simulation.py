"""A whole flight, simulated in Rust."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

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


class Run(dict[str, NDArray[np.float64]]):
    """Named arrays, (N, k), one row per control period of 2 ms.

    True values of the robot: `time` s; `position`, `velocity`, `rotation` (row by row),
    `angular_velocity`; `tool_position`, `tool_rotation`. The state that the controller gets:
    `estimated_position`, `estimated_velocity`, `estimated_rotation`. Of the tool: `setpoint_position`,
    `setpoint_rotation`, `reference_position`, `reference_rotation`. Of the pose controller:
    `position_error`, `rotation_error`. Observed wrenches: `wrench_robot`, `wrench_tool`; the true one at
    the tool: `wrench_true`. Estimated (with `[contact] discrimination`): `wind` m/s and
    `contact_likelihood` 0 to 1. `rotor_speeds`, `rotor_command` Hz. Values of the sensors: `gyro` rad/s
    and `specific_force` m/s^2, IMU axes, and `measured_rotor_speeds` Hz. `saturated` 0 or 1. `phase` 0
    disarmed, 1 starting, 2 grounded, 3 flying, 4 holding, 5 landing, 6 emergency.
    """

    def to_dataframe(self) -> pd.DataFrame:
        """A table with one column per number, named `position_0`, ..., and indexed by time.

        Needs pandas.
        """
        import pandas as pd

        columns = {
            name if array.shape[1] == 1 else f"{name}_{k}": array[:, k]
            for name, array in self.items()
            for k in range(array.shape[1])
        }
        frame: pd.DataFrame = pd.DataFrame(columns).set_index("time")
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
    truth: _core.Truth | str | os.PathLike[str] | dict[str, Any] | None = None,
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
    """
    return Run(
        _core.simulate(
            config,
            duration=duration,
            setpoint=setpoint,
            trajectory=trajectory,
            pushes=list(pushes),
            noise=noise,
            gyro_bias=gyro_bias,
            accelerometer_bias=accelerometer_bias,
            seed=seed,
            estimator=estimator,
            pose_delay=pose_delay,
            start=start,
            truth=truth,
        )
    )
