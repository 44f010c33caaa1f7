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
"""What the command line's `--truth` is."""


class Run(dict[str, NDArray[np.float64]]):
    """Named arrays, (N, k), one row a control period of 2 ms.

    `time` s; `position`, `velocity`, `rotation` (row by row), `angular_velocity`
    of the robot as it truly moves; `tool_position`, `tool_rotation`;
    `estimated_position`, `estimated_velocity`, `estimated_rotation` as the
    controller is given them; `setpoint_position`, `setpoint_rotation`,
    `reference_position`, `reference_rotation` of the tool; `position_error`,
    `rotation_error` of the pose controller; `wrench_robot`, `wrench_tool` as
    observed, `wrench_true` at the tool; `wind` m/s and `contact_likelihood` 0 to 1
    as estimated (with `[contact] discrimination`); `rotor_speeds`, `rotor_command` Hz;
    `gyro` rad/s, `specific_force` m/s^2 and `measured_rotor_speeds` Hz as the sensors gave them, IMU axes;
    `saturated` 0 or 1; `phase` 0 disarmed, 1 starting, 2 grounded, 3 flying,
    4 holding, 5 landing, 6 emergency.
    """

    def to_dataframe(self) -> pd.DataFrame:
        """One column a number, named `position_0`, ...; indexed by time. Needs pandas."""
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
        config: The configuration; its vehicle is flown.
        duration: Length, s.
        setpoint: A tool pose to hold. Either this or
        trajectory: A way of the tool.
        pushes: What pushes the tool: dicts with `at` and `duration`, s, and
            `force`, N, or `torque`, N m, or both, (3,), world, at the tip. `at` counts from the begin
            in the air, or from the motors' start.
        noise: Times the noise of the experiments: 1 sigma of 0.3 mm, 2 mrad, 5 mrad/s,
            0.15 m/s^2 and 0.1 Hz; 0 for ideal sensors.
        gyro_bias: Constant bias of the gyroscope, rad/s, IMU axes, (3,).
        accelerometer_bias: Likewise of the accelerometer, m/s^2.
        seed: The same seed gives the same flight.
        estimator: Whether the controller is given the estimator's state, from
            inertial samples at 500 Hz and poses at 100 Hz; otherwise the true pose and twist.
        pose_delay: Age of a captured pose when it arrives, s.
        start: "air" begins at rest with the tool on its first set-point; "ground" begins with the motors off,
            takes off, hovers and then flies to the set-point or along the trajectory.
        truth: In what the vehicle differs from `config`'s, which the controller never sees: a level
            ("exact", "measured", "cad", "outdoors"), a TOML file with a `[truth]` table, or its keys.
            Drawn with `seed`; `Truth(config.vehicle, truth).draw(seed)` is what was flown.
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
