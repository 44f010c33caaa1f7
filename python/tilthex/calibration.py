"""Finds the captured body's place, the latency, and scale and misalignment of the inertial sensors."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex import _core
from tilthex._rates import Rates
from tilthex._scatter import spread
from tilthex.recording import Recording

Array = NDArray[np.float64]

SETTLE = 1.0
"""Innovations and errors of the first time of a recording do not count, s."""
LATENCIES = (-0.05, 0.5)
"""The range of latencies in which `calibrate` searches, s: that of the key."""
NEAR = 0.045
"""The search begins this close to the latency, s: angular rates show it before."""
FARTHEST = 3.0
"""Largest distance of the captured body from the robot's origin along each axis, m."""
EDGE = 1e-3
"""A latency this close to the range's end is at its bound, s."""
USUAL = 0.05, 0.02
"""Standard deviations of the entries of the gyro's and of the accelerometer's matrix without a recording."""
MATRIX_OFF = 0.29
"""Largest difference of an entry from the identity that is searched; the estimator takes 0.3."""
TELLS = 4.0
"""A matrix is written if one of its entries is this many deviations of noise from the configured one."""
MATRICES = "gyro_matrix", "accelerometer_matrix"
"""Their keys."""
STEP = 1e-3
"""Step of the derivatives, in parameters that are about 1."""


@dataclass(frozen=True)
class Calibration:
    """The captured body on the robot, the latency, and the matrices of the inertial sensors.

    Attributes:
        body_position: Origin of the captured body, m, robot, (3,).
        body_rotation_deg: Roll, pitch, yaw of the captured body, degrees, (3,).
        latency: What is subtracted from the time of every pose, s. A lag of the IMU makes it smaller.
        deviation: Standard deviations of these seven values, in the same units, (7,).
        gyro_matrix: The rate with its bias is this times the reading, IMU axes, (3, 3).
        accelerometer_scale: The specific force with its bias is this times the reading, IMU axes, (3,).
        gyro_deviation: Standard deviations of the entries of the gyro's matrix, (3, 3).
        accelerometer_deviation: Those of the accelerometer's scale, (3,).
        written: Names of the keys of matrices that differ from the configured ones. The others stay.
        history: The key `history` that the latency needs, s; None if the configured one suffices.
    """

    body_position: Array
    body_rotation_deg: Array
    latency: float
    deviation: Array
    gyro_matrix: Array
    accelerometer_scale: Array
    gyro_deviation: Array
    accelerometer_deviation: Array
    written: tuple[str, ...]
    history: float | None

    def config(self, config: _core.Config) -> _core.Config:
        """A configuration with this place, latency, and the matrices that differ from the configured ones."""
        keys: dict[str, Any] = {
            "body_position": self.body_position.tolist(),
            "body_rotation_deg": self.body_rotation_deg.tolist(),
            "latency": self.latency,
        }
        if self.history is not None:
            keys["history"] = self.history
        matrices = {
            "gyro_matrix": self.gyro_matrix.tolist(),
            "accelerometer_matrix": self.accelerometer_scale.tolist(),
        }
        return config.replace(estimator=keys | {key: matrices[key] for key in self.written})

    def __str__(self) -> str:
        """The keys of a configuration, with the deviations as comments."""

        def several(values: Array, digits: int = 3) -> str:
            return ", ".join(f"{value:.{digits}g}" for value in values)

        rows = ", ".join(f"[{', '.join(f'{value:.5f}' for value in row)}]" for row in self.gyro_matrix)
        scale = ", ".join(f"{value:.5f}" for value in self.accelerometer_scale)
        found = {
            "gyro_matrix": f"[{rows}]  # each within {self.gyro_deviation.max():.2g}",
            "accelerometer_matrix": f"[{scale}]  # +- {several(self.accelerometer_deviation)}",
        }
        kept = "as configured, within what the recording tells"
        return "\n".join(
            [
                "[estimator]",
                f"body_position = [{several(self.body_position, 5)}]  # +- {several(self.deviation[:3])} m",
                f"body_rotation_deg = [{several(self.body_rotation_deg, 6)}]"
                f"  # +- {several(self.deviation[3:6])} degrees",
                f"latency = {self.latency:.5g}  # +- {self.deviation[6]:.3g} s",
                *(
                    []
                    if self.history is None
                    else [f"history = {self.history}  # s, twice the latency at least"]
                ),
                *(
                    f"{key} = {text}" if key in self.written else f"# {key} = {text}: {kept}"
                    for key, text in found.items()
                ),
            ]
        )


def calibrate(recording: Recording, config: _core.Config, *, settle: float = SETTLE) -> Calibration:
    """Finds the captured body's pose on the robot, the latency of the poses, and the sensors' matrices.

    They are the ones that minimise the innovations. The search starts with the latency within `LATENCIES` and
    the rotation that align both angular velocities (Wahba's problem), so that any rotation can be found. The
    matrices are searched last, together with the place; what a recording does not tell of them stays near the
    configured values. The flight must turn about at least two axes. The deviations show what the flight does
    not determine; they are from the scatter between blocks of a second, and between three and four pieces of
    the recording.

    Args:
        recording: A flight of about ten seconds.
        config: The configuration; its IMU mounting, noises and matrices are where the search begins.
        settle: Innovations before this time do not count, s.

    Returns:
        The calibration; a matrix that does not differ from the configured one is not in its keys.

    Raises:
        ValueError: The recording does not tell how the body is mounted, or a value comes out at its bound.
    """
    from scipy.optimize import least_squares

    search = _Search(recording.tracked(), config, settle)
    # A filter that hardly trusts the poses leads near to the result; the configured filter then
    # finds it.
    coarse = search.config.replace(estimator={"position_noise": 0.05, "rotation_noise_deg": 5.0})
    low, high = search.bounds()
    bounds = low[:7], high[:7]
    place: dict[str, Any] = {"jac": search.jacobian, "bounds": bounds, "max_nfev": 40}
    search.weigh(np.ones(7), coarse)
    near = least_squares(search.residuals, np.ones(7), args=(coarse,), **place)
    search.weigh(near.x, search.config)
    found = least_squares(search.residuals, near.x, args=(search.config,), loss="soft_l1", **place)
    at_bound = np.minimum(abs(found.x - bounds[0]), abs(found.x - bounds[1])) < 0.1
    if at_bound.any():
        _refuse(search.calibration(found.x), bool(at_bound[6]))
    search.weigh(found.x, search.config)
    all_of_it = least_squares(
        search.residuals,
        np.r_[found.x, np.ones(12)],
        jac=search.jacobian,
        args=(search.config,),
        loss="soft_l1",
        bounds=(low, high),
        max_nfev=8,
    )
    whole = search.with_deviations(all_of_it)
    if whole.written:
        return whole
    return replace(
        search.with_deviations(found),
        gyro_matrix=whole.gyro_matrix,
        accelerometer_scale=whole.accelerometer_scale,
        gyro_deviation=whole.gyro_deviation,
        accelerometer_deviation=whole.accelerometer_deviation,
    )


def _history(latency: float, configured: float) -> float | None:
    """The key `history` that a latency needs, s, twice the latency; None if the configured one suffices."""
    needed = min(math.ceil(100 * (2 * latency + 0.02)) / 100, 1.0)
    return needed if needed > configured else None


def _refuse(best: Calibration, latency: bool) -> None:
    """Says which value is at its bound, and what to do."""
    if latency and not LATENCIES[0] + EDGE < best.latency < LATENCIES[1] - EDGE:
        raise ValueError(
            f"the latency comes out at its bound, {best.latency:.3f} s; expected {LATENCIES[0]} to "
            f"{LATENCIES[1]} s: the clocks of poses and samples differ by more; move the times of the poses"
        )
    if latency:
        raise ValueError(
            f"the recording does not tell the latency: the poses show {best.latency:.3f} s, and the angular "
            f"rates differ from it by {NEAR:g} s or more; expected less: record turns about all axes"
        )
    raise ValueError(
        f"the place of the captured body comes out at its bound, {np.round(best.body_position, 2).tolist()} "
        f"m; expected up to {FARTHEST:g} m from the robot's origin along each axis: check the unit of the "
        "positions, and that this body is on this vehicle"
    )


class _Search:
    """The search for a calibration. Parameters are about 1: the place's 7, or these and the matrices' 12."""

    def __init__(self, recording: Recording, config: _core.Config, settle: float) -> None:
        self.config = config.replace(estimator={"gate_probability": 1.0})
        rates = Rates(recording, config)
        # The filter gets poses that are late by a little only, however large the latency is.
        self._late = rates.delay(*LATENCIES)
        self._start = rates.rotation(self._late)
        self._recording = replace(
            recording,
            pose_time=recording.pose_time - self._late,
            pose_arrival_time=recording.pose_arrival_time - self._late,
        )
        self._counts = recording.pose_time > recording.pose_time[0] + settle
        keys = config.to_dict()["estimator"]
        self._history = float(keys["history"])
        matrices = [np.asarray(keys[f"{sensor}_matrix"], float) for sensor in ("gyro", "accelerometer")]
        self._gyro, force = (np.diag(each) if each.ndim == 1 else each for each in matrices)
        self._force = np.diag(force)
        if (force != np.diag(self._force)).any():
            raise ValueError(
                "[estimator] accelerometer_matrix has entries beside its diagonal; expected the three scales "
                "that calibrate can find"
            )
        self._scale = np.r_[[0.05] * 3, [0.02] * 3, 0.005, [USUAL[0]] * 9, [USUAL[1]] * 3]

    def bounds(self) -> tuple[Array, Array]:
        """The bounds of all parameters."""
        low, high = np.full(19, -np.inf), np.full(19, np.inf)
        scale = self._scale
        low[:3], high[:3] = 1 - FARTHEST / scale[:3], 1 + FARTHEST / scale[:3]
        near = np.clip(np.array(LATENCIES) - self._late, -NEAR, NEAR)
        low[6], high[6] = 1 + near / scale[6]
        configured = np.r_[(self._gyro - np.eye(3)).ravel(), self._force - 1]
        for bound, off in ((low, -MATRIX_OFF), (high, MATRIX_OFF)):
            # What is configured is inside.
            bound[7:] = 1 + np.sign(off) * np.maximum(np.sign(off) * (off - configured), 1e-3) / scale[7:]
        return low, high

    def calibration(self, parameters: Array) -> Calibration:
        """What parameters stand for, without deviations."""
        from scipy.spatial.transform import Rotation

        count = len(parameters)
        x = np.zeros(19)
        x[:count] = self._scale[:count] * (parameters - 1)
        yaw_pitch_roll = (self._start * Rotation.from_rotvec(x[3:6])).as_euler("ZYX", degrees=True)
        return Calibration(
            body_position=x[:3],
            body_rotation_deg=yaw_pitch_roll[::-1],
            latency=self._late + float(x[6]),
            deviation=np.zeros(7),
            gyro_matrix=self._gyro + x[7:16].reshape(3, 3),
            accelerometer_scale=self._force + x[16:],
            gyro_deviation=np.zeros((3, 3)),
            accelerometer_deviation=np.zeros(3),
            written=MATRICES if count > 7 else (),
            history=_history(self._late + float(x[6]), self._history),
        )

    def weigh(self, parameters: Array, base: _core.Config) -> None:
        """Takes the standard deviations of the innovations that these parameters predict.

        They stay the same in a search: a longer lever arm predicts larger innovations, so that the search
        would make it longer than it is.
        """
        self._deviation = self._run(parameters, base).innovation_deviation[self._counts]

    def residuals(self, parameters: Array, base: _core.Config) -> Array:
        """The innovations in standard deviations, and what is known of the matrices without a recording."""
        whitened = self._run(parameters, base).innovation[self._counts] / self._deviation
        innovations: Array = np.nan_to_num(whitened, nan=10.0).ravel()
        whole: Array = np.concatenate([innovations, parameters[7:] - 1])
        return whole

    def _run(self, parameters: Array, base: _core.Config) -> _core.UkfRun:
        tried = self.calibration(parameters)
        tried = replace(tried, latency=tried.latency - self._late, history=None)
        return self._recording.estimate(_core.Ukf(tried.config(base)))

    def jacobian(self, parameters: Array, base: _core.Config) -> Array:
        """Its derivatives, from runs on all processors."""
        moved = [parameters, *(parameters + STEP * np.eye(len(parameters)))]
        with ThreadPoolExecutor() as threads:
            centre, *each = threads.map(lambda p: self.residuals(p, base), moved)
        columns: Array = np.column_stack([(one - centre) / STEP for one in each])
        return columns

    def with_deviations(self, found: Any) -> Calibration:
        """The calibration of a search's result."""
        jacobian, count = np.asarray(found.jac, dtype=float), len(found.x)
        innovations = len(found.fun) - (count - 7)
        prior = np.zeros(count)
        prior[7:] = 1.0
        time = self._recording.pose_time[self._counts]
        noise, whole = (
            self._scale[:count] * each
            for each in spread(found.fun[:innovations], jacobian[:innovations], time, prior, found.cost)
        )
        deviation = whole.copy()
        deviation[3:6] = np.degrees(deviation[3:6])
        best = replace(self.calibration(found.x), deviation=deviation[:7])
        if count == 7:
            return best
        gyro, force = deviation[7:16].reshape(3, 3), deviation[16:]
        differs = (
            abs(best.gyro_matrix - self._gyro) > TELLS * noise[7:16].reshape(3, 3),
            abs(best.accelerometer_scale - self._force) > TELLS * noise[16:],
        )
        written = tuple(key for key, entries in zip(MATRICES, differs, strict=True) if entries.any())
        return replace(best, gyro_deviation=gyro, accelerometer_deviation=force, written=written)
