"""`tilthex estimate` runs the estimator over a recording; `tilthex calibrate` finds its parameters."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex import _core, _json
from tilthex.estimate_figures import figures, pose_errors, summary
from tilthex.noises import find_noises
from tilthex.recording import Recording

Array = NDArray[np.float64]

LATENCIES = (-0.049, 0.1)
"""The range of latencies in which `calibrate` searches, s: the history of the filter."""
FARTHEST = 3.0
"""Largest distance of the captured body from the robot's origin along each axis, m."""
BLOCK = 1.0
"""Innovations that are further apart than this count as independent, s."""
TURNS = 0.05
"""Smallest rate about the second of the axes about which a recording turns, rad/s rms."""


def plot_innovations(recording: Recording, run: _core.UkfRun, path: Path) -> None:
    """Writes a figure of the innovations with three predicted standard deviations, and their NIS."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(3, 1, sharex=True, figsize=(9, 8), layout="constrained")
    time = recording.pose_time - recording.imu_time[0]
    for row, (first, scale, name) in enumerate([(0, 1e3, "position, mm"), (3, 1e3, "rotation, mrad")]):
        for axis in range(3):
            axes[row].plot(time, scale * run.innovation[:, first + axis], ".", ms=2, label="xyz"[axis])
        bound = 3 * scale * run.innovation_deviation[:, first : first + 3].max(axis=1)
        axes[row].plot(time, bound, "k-", lw=0.7)
        axes[row].plot(time, -bound, "k-", lw=0.7, label="3 sigma")
        # The innovations of the first poses are so large that the others would not be visible.
        largest = np.nanmax(
            [
                np.nanpercentile(np.abs(scale * run.innovation[:, first : first + 3]), 99.9),
                1.2 * np.nanmedian(bound),
            ]
        )
        axes[row].set_ylim(-1.3 * largest, 1.3 * largest)
        axes[row].set_ylabel(f"innovation of the {name}")
        axes[row].legend(loc="upper right", ncols=4)
    axes[2].semilogy(time, run.nis, ".", ms=2)
    axes[2].axhline(6.0, color="k", lw=0.7)
    axes[2].set_ylabel("NIS (6 expected)")
    axes[2].set_xlabel("time, s")
    figure.savefig(path, dpi=130)
    plt.close(figure)


def write_states(recording: Recording, run: _core.UkfRun, path: Path) -> None:
    """Writes a table of states, one row per inertial sample."""
    columns = {
        "position": run.position,
        "velocity": run.velocity,
        "rotation": run.rotation.reshape(-1, 9),
        "gyro_bias": run.gyro_bias,
        "accelerometer_bias": run.accelerometer_bias,
    }
    names = [f"{name}_{k}" for name, array in columns.items() for k in range(array.shape[1])]
    table = np.column_stack([recording.imu_time, *columns.values()])
    np.savetxt(path, table, delimiter=",", header=",".join(["time", *names]), comments="", fmt="%.9g")


@dataclass(frozen=True)
class Calibration:
    """The captured body on the robot: position in m (3,), roll, pitch, yaw in degrees (3,), latency in s.

    `deviation` holds the standard deviations of these seven values, in the same units.
    """

    body_position: Array
    body_rotation_deg: Array
    latency: float
    deviation: Array

    def config(self, config: _core.Config) -> _core.Config:
        """A configuration with this offset."""
        keys = {
            "body_position": self.body_position.tolist(),
            "body_rotation_deg": self.body_rotation_deg.tolist(),
            "latency": self.latency,
        }
        return config.replace(estimator=keys)

    def __str__(self) -> str:
        """The keys of a configuration, with the deviations as comments."""
        numbers, off = (
            [", ".join(f"{value:.4g}" for value in part) for part in parts]
            for parts in (
                (self.body_position, self.body_rotation_deg),
                (self.deviation[:3], self.deviation[3:6]),
            )
        )
        return (
            f"[estimator]\nbody_position = [{numbers[0]}]  # +- {off[0]} m\n"
            f"body_rotation_deg = [{numbers[1]}]  # +- {off[1]} degrees\n"
            f"latency = {self.latency:.4g}  # +- {self.deviation[6]:.4g} s"
        )


def calibrate(recording: Recording, config: _core.Config, *, settle: float = 1.0) -> Calibration:
    """Finds the pose of the captured body on the robot, and the latency of the poses.

    They are the ones that minimise the innovations.

    The search starts with the rotation that aligns both angular velocities (Wahba's problem), so that any
    rotation can be found. The latency is between -50 and 100 ms. The flight must turn about at least two
    axes. The deviations show what the flight does not determine.

    Args:
        recording: A flight of about ten seconds.
        config: The configuration; its IMU mounting and noises are used.
        settle: Innovations before this time do not count, s.
    """
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    recording = recording.tracked()
    config = config.replace(estimator={"gate_probability": 1.0})
    counts = recording.pose_time > recording.pose_time[0] + settle
    start = _aligned_by_rate(recording, config)
    # Parameters are about 1, so that a relative step is an absolute step.
    scale = np.r_[[0.05] * 3, [0.02] * 3, 0.005]

    def offset(parameters: Array) -> Calibration:
        x = scale * (parameters - 1)
        yaw_pitch_roll = (start * Rotation.from_rotvec(x[3:6])).as_euler("ZYX", degrees=True)
        return Calibration(x[:3], yaw_pitch_roll[::-1], float(x[6]), np.zeros(7))

    def residuals(parameters: Array, base: _core.Config) -> Array:
        run = recording.estimate(_core.Ukf(offset(parameters).config(base)))
        whitened = (run.innovation / run.innovation_deviation)[counts]
        flat: Array = np.nan_to_num(whitened, nan=10.0).ravel()
        return flat

    bounds = np.full(7, -np.inf), np.full(7, np.inf)
    bounds[0][:3], bounds[1][:3] = 1 - FARTHEST / scale[:3], 1 + FARTHEST / scale[:3]
    bounds[0][6], bounds[1][6] = (1 + latency / scale[6] for latency in LATENCIES)
    # A filter that hardly trusts the poses leads near to the result; the configured filter then
    # finds it.
    coarse = config.replace(estimator={"position_noise": 0.05, "rotation_noise_deg": 5.0})
    settings: dict[str, Any] = {"diff_step": 1e-3, "bounds": bounds, "max_nfev": 40}
    near = least_squares(residuals, np.ones(7), args=(coarse,), **settings)
    found = least_squares(residuals, near.x, args=(config,), loss="soft_l1", **settings)
    jacobian = np.asarray(found.jac, dtype=float)
    white = np.linalg.pinv(jacobian.T @ jacobian) * 2 * found.cost / max(len(found.fun) - 7, 1)
    coloured = _block_covariance(found.fun, jacobian, recording.pose_time[counts])
    deviation = scale * np.sqrt(np.maximum(np.diag(white), np.diag(coloured)))
    best = offset(found.x)
    at_bound = np.minimum(abs(found.x - bounds[0]), abs(found.x - bounds[1])) < 0.1
    if at_bound.any():
        what = "latency" if at_bound[6] else "place of the body"
        raise ValueError(
            f"the {what} comes out at its bound (latency {best.latency:.3f} s, place "
            f"{np.round(best.body_position, 2).tolist()} m): the clocks of poses and samples differ by "
            f"more than {LATENCIES[0]} to {LATENCIES[1]} s; move the times of the poses"
        )
    deviation[3:6] = np.degrees(deviation[3:6])
    return Calibration(best.body_position, best.body_rotation_deg, best.latency, deviation)


def _block_covariance(residuals: Array, jacobian: Array, time: Array) -> Array:
    """Covariance of the parameters from the scatter between blocks of `BLOCK`, for residuals of any colour.

    `jacobian` is that of scipy for the loss soft_l1: each row is scaled by its part of the Hessian.
    """
    z = residuals**2
    # d = J^T r w with w = rho'; the scale of a row is the root of rho' + 2 z rho''.
    plain = jacobian * ((1 + z) ** 0.75)[:, None]
    score = plain * (residuals * (1 + z) ** -0.5)[:, None]
    block = np.repeat(np.floor((time - time[0]) / BLOCK).astype(int), len(residuals) // len(time))
    sums = np.zeros((block.max() + 1, jacobian.shape[1]))
    np.add.at(sums, block, score)
    count = len(np.unique(block))
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    covariance: Array = inverse @ (sums.T @ sums) @ inverse * count / max(count - 1, 1)
    return covariance


def _aligned_by_rate(recording: Recording, config: _core.Config) -> Any:
    """The rotation from the captured body to the robot that aligns its rate with the rate of the gyro."""
    from scipy.spatial.transform import Rotation

    time = recording.pose_time
    # The rate is taken over about 50 ms, so that it is larger than the noise of the capture system.
    step = max(1, round(0.05 / float(np.median(np.diff(time)))))
    turned = Rotation.from_matrix(recording.rotation)
    span = (time[step:] - time[:-step])[:, None]
    captured = (turned[:-step].inv() * turned[step:]).as_rotvec() / span
    integral = np.vstack(
        [np.zeros(3), np.cumsum(np.diff(recording.imu_time)[:, None] * recording.gyro[1:], axis=0)]
    )
    angle = np.column_stack([np.interp(time, recording.imu_time, column) for column in integral.T])
    gyro = (angle[step:] - angle[:-step]) / span
    used = (np.linalg.norm(captured, axis=1) < 20.0) & (span[:, 0] < 0.2)
    gyro_r = (gyro[used] - gyro[used].mean(axis=0)) @ config.vehicle.imu_rotation.T
    second = float(np.sqrt(np.linalg.eigvalsh(np.cov(gyro_r.T))[1]))
    if second < TURNS:
        raise ValueError(
            f"the recording does not tell how the body is mounted: about a second axis it "
            f"turns with {second:.3f} rad/s rms; expected {TURNS} at least"
        )
    found, _ = Rotation.align_vectors(gyro_r, captured[used] - captured[used].mean(axis=0))
    return found


def _estimate(arguments: argparse.Namespace) -> None:
    config = _config(arguments)
    recording = _recording(arguments, config)
    fed = recording
    if arguments.every > 1:
        fed = recording.select(np.arange(len(recording.pose_time)) % arguments.every == 0)
    run = fed.estimate(_core.Ukf(config))
    errors = None
    if arguments.every > 1:
        held = recording.select(np.arange(len(recording.pose_time)) % arguments.every != 0)
        errors = pose_errors(held, run, config)
    if arguments.json:
        _json.say(figures(fed, run) | ({"withheld": errors.figures()} if errors else {}))
    else:
        print(summary(fed, run))
        if errors:
            print(f"errors at the withheld poses: {errors}")
    if arguments.plot:
        plot_innovations(fed, run, arguments.plot)
    if arguments.out:
        write_states(fed, run, arguments.out)


def _calibrate(arguments: argparse.Namespace) -> None:
    given = _config(arguments)
    recording = _recording(arguments, given).tracked()
    found = calibrate(recording, given)
    placed = found.config(given)
    if arguments.json:
        _json.say({"place": found, "noises": find_noises(recording, placed)})
        return
    print(found)
    noises = find_noises(recording, placed)
    print(f"{noises}\n")
    print("errors at every second pose, if the filter does not get it:")
    fed = np.arange(len(recording.pose_time)) % 2 == 0
    for name, config in (
        ("before", given),
        ("with the place of the body", placed),
        ("with all keys", noises.config(placed)),
    ):
        run = recording.select(fed).estimate(_core.Ukf(config))
        print(f"  {name}: {pose_errors(recording.select(~fed), run, config)}; NIS {np.nanmean(run.nis):.2f}")


def _recording(arguments: argparse.Namespace, config: _core.Config) -> Recording:
    return Recording.from_file(arguments.recording, config, imu=arguments.imu, poses=arguments.poses)


def _config(arguments: argparse.Namespace) -> _core.Config:
    if arguments.config:
        return _core.Config.from_toml(arguments.config)
    return _core.Config.default(_core.Vehicle.preset("tilt-hex"))


def add_parser(commands: Any) -> None:
    """Adds `estimate` and `calibrate` to the `tilthex` command."""
    estimate = commands.add_parser("estimate", help="run the state estimator over a recording")
    estimate.add_argument(
        "--every",
        type=int,
        default=1,
        metavar="N",
        help="give the filter every Nth pose only, and print the errors at the others",
    )
    estimate.add_argument("--plot", type=Path, metavar="FILE.png", help="draw the innovations")
    estimate.add_argument("--out", type=Path, metavar="FILE.csv", help="write the states")
    _json.add_option(estimate)
    estimate.set_defaults(run=_estimate)
    calibration = commands.add_parser(
        "calibrate", help="find the captured body's place on the robot, the latency and the noises"
    )
    calibration.set_defaults(run=_calibrate)
    _json.add_option(calibration)
    for parser in (estimate, calibration):
        parser.add_argument(
            "recording",
            type=Path,
            help="a log of tilthex-rt, or another recording (.mcap, .csv, .mat, .ulg, a ROS 2 bag)",
        )
        parser.add_argument(
            "--imu", metavar="TOPIC", help="topic of the inertial samples, if there is more than one"
        )
        parser.add_argument(
            "--poses", metavar="TOPIC|FILE", help="topic or file of the poses, if there is more than one"
        )
        parser.add_argument(
            "--config", type=Path, metavar="FILE.toml", help="the configuration (default: tilt-hex)"
        )
