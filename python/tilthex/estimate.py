"""`tilthex estimate` runs the estimator over a recording; `tilthex calibrate` finds its parameters."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex import _core, _json
from tilthex._speed_age import SpeedAge, find_speed_age
from tilthex.calibration import SETTLE, calibrate
from tilthex.estimate_figures import figures, pose_errors, summary
from tilthex.log import Log
from tilthex.noises import find_noises
from tilthex.recording import Recording, own_log

Array = NDArray[np.float64]


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


def _estimate(arguments: argparse.Namespace) -> None:
    if arguments.every < 1:
        raise ValueError(f"--every is {arguments.every}; expected 1 or more")
    log = own_log(arguments.recording)
    config = configured(arguments, log)
    recording = _recording(arguments, config, log)
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
    log = own_log(arguments.recording)
    given = configured(arguments, log)
    recording = _recording(arguments, given, log).tracked()
    found = calibrate(recording, given)
    placed = found.config(given)
    if not arguments.json:
        print(found)
    # The noises are those of all poses, also of poses that would arrive too late in flight.
    captured = recording.pose_time - max(found.latency, 0.0)
    recording = replace(recording, pose_arrival_time=np.minimum(recording.pose_arrival_time, captured))
    noises = find_noises(recording, placed)
    speeds = _speed_age(log, placed) if log else None
    age = speeds if isinstance(speeds, SpeedAge) else None
    if not arguments.json:
        print(f"{noises}\n" + (f"\n{speeds}\n" if speeds else ""))
    if arguments.out:
        heading = f"# Found by tilthex calibrate in {arguments.recording.name}; keys of a configuration."
        keys = [heading, found, noises, *(["", speeds] if speeds else [])]
        arguments.out.write_text("\n".join(map(str, keys)) + "\n", encoding="utf-8")
    fed = np.arange(len(recording.pose_time)) % 2 == 0
    counted = recording.pose_time > recording.pose_time[0] + SETTLE
    errors: dict[str, Any] = {}
    for name, config in (
        ("before", given),
        ("with place, latency and matrices", placed),
        ("with all keys", noises.config(placed)),
    ):
        run = recording.select(fed).estimate(_core.Ukf(config))
        nis = float(np.nanmean(run.nis[counted[fed]]))
        errors[name] = pose_errors(recording.select(~fed & counted), run, config), nis
    if arguments.json:
        withheld = {
            name.replace(",", "").replace(" ", "_"): error.figures() | {"nis": nis}
            for name, (error, nis) in errors.items()
        }
        _json.say({"place": found, "noises": noises, "withheld": withheld, "rotor_speed_age": age})
        return
    print(f"errors at every second pose after {SETTLE:g} s, if the filter does not get it:")
    for name, (error, nis) in errors.items():
        print(f"  {name}: {error}; NIS {nis:.2f}")
    if age:
        print("\n".join(["not explained by the rotor speeds:", *age.table()]))
    if arguments.out:
        print(arguments.out)


def _speed_age(log: Log, config: _core.Config) -> SpeedAge | str:
    """The age of the rotor speeds; a comment that says why the log does not tell it."""
    try:
        return find_speed_age(log, config)
    except ValueError as error:
        return f"# rotor_speed_age in [link] was not searched: {error}"


def _recording(arguments: argparse.Namespace, config: _core.Config, log: Log | None) -> Recording:
    file = log or arguments.recording
    return Recording.from_file(file, config, imu=arguments.imu, poses=arguments.poses)


def configured(arguments: argparse.Namespace, log: Log | None) -> _core.Config:
    """The configuration: the named one, that of the log, or the default."""
    if arguments.config:
        return _core.Config.from_toml(arguments.config)
    if log:
        return _core.Config.from_text(log.configuration)
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
        "calibrate",
        help="find the captured body's place, the latency, the noises and the age of the rotor speeds",
    )
    calibration.set_defaults(run=_calibrate)
    calibration.add_argument(
        "--out", type=Path, metavar="FILE.toml", help="write the found keys, as a part of a configuration"
    )
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
            "--config",
            type=Path,
            metavar="FILE.toml",
            help="the configuration (default: that of the log, or tilt-hex)",
        )
