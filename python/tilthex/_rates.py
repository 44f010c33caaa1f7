"""Angular rates of captured body and gyro: the rotation between both, and the delay of the poses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex import _core
from tilthex.recording import Recording

Array = NDArray[np.float64]

SPAN = 0.05
"""Rates are taken over about this time, so that they are larger than the noise of the capture system, s."""
TURNS = 0.05
"""Smallest rate about the second of the axes about which a recording turns, rad/s rms."""
STEP = 0.01
"""Step of the delays that are tried, s."""
FEWEST = 20
"""The smallest number of poses."""


class Rates:
    """Rates of the captured body, in its axes, and what is needed for those of the gyro."""

    def __init__(self, recording: Recording, config: _core.Config) -> None:
        from scipy.spatial.transform import Rotation

        time, kept = np.unique(recording.pose_time, return_index=True)
        if len(time) < FEWEST:
            raise ValueError(
                f"the recording has {len(time)} poses of different times; expected {FEWEST} or more to find "
                "how the body is mounted: record ten seconds of motion"
            )
        step = max(1, round(SPAN / float(np.median(np.diff(time)))))
        turned = Rotation.from_matrix(recording.rotation[kept])
        span = (time[step:] - time[:-step])[:, None]
        captured = (turned[:-step].inv() * turned[step:]).as_rotvec() / span
        self._used = (np.linalg.norm(captured, axis=1) < 20.0) & (span[:, 0] < 0.2)
        self._captured = captured - captured[self._used].mean(axis=0)
        self._time, self._step, self._span = time, step, span
        self._imu_time = recording.imu_time
        steps = np.diff(recording.imu_time)[:, None]
        self._integral = np.vstack([np.zeros(3), np.cumsum(steps * recording.gyro[1:], axis=0)])
        self._imu_rotation = config.vehicle.imu_rotation

    def gyro(self, delay: float) -> Array:
        """The gyro's rates without their mean, robot axes, over the times of the poses minus a delay."""
        at = self._time - delay
        angle = np.column_stack([np.interp(at, self._imu_time, column) for column in self._integral.T])
        rate = ((angle[self._step :] - angle[: -self._step]) / self._span)[self._used]
        turned: Array = (rate - rate.mean(axis=0)) @ self._imu_rotation.T
        return turned

    def delay(self, low: float, high: float) -> float:
        """The delay of the poses within bounds, s, with which any one rotation aligns both rates best."""
        delays = np.arange(low + 0.5 * STEP, high, STEP)
        captured = self._captured[self._used]
        fits = []
        for delay in delays:
            gyro = self.gyro(delay)
            u, size, v = np.linalg.svd(gyro.T @ captured)
            size[2] *= np.linalg.det(u @ v)
            fits.append(size.sum() / (np.linalg.norm(gyro) + 1e-9))
        return float(delays[int(np.argmax(fits))])

    def rotation(self, delay: float) -> Any:
        """The rotation from the captured body to the robot.

        Raises:
            ValueError: The recording turns about one axis only.
        """
        from scipy.spatial.transform import Rotation

        gyro = self.gyro(delay)
        second = float(np.sqrt(np.linalg.eigvalsh(np.cov(gyro.T))[1]))
        if second < TURNS:
            raise ValueError(
                f"the recording does not tell how the body is mounted: about a second axis it "
                f"turns with {second:.3f} rad/s rms; expected {TURNS} at least"
            )
        found, _ = Rotation.align_vectors(gyro, self._captured[self._used])
        return found
