"""Recordings, `tilthex estimate` and `tilthex calibrate`."""

import argparse
import json
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
import tilthex
from scipy.spatial.transform import Rotation
from tilthex.__main__ import main
from tilthex._toml import tomllib
from tilthex.estimate import calibrate, configured
from tilthex.estimate_figures import pose_errors
from tilthex.log import Log
from tilthex.noises import find_noises
from tilthex.recording import Recording
from ukf_reference import recording as simulated

pytestmark = pytest.mark.real_time


@pytest.fixture
def config():
    default = tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex"))
    return default.replace(vehicle={"imu_position": [0, 0, 0]}, estimator={"initial_velocity": 3.0})


def recorded(samples=1500, offset=(0, 0, 0), turn=None, late=0.0):
    """Poses of a body that sits at `offset`, turned, stamped `late` after they were taken."""
    t, gyro, force, taken, measured, turned, _ = simulated(3, samples)
    turn = np.eye(3) if turn is None else turn
    stamp = t[taken] + late
    return Recording(t, gyro, force, stamp, measured + turned @ np.asarray(offset), turned @ turn, stamp)


def write_csv(path, recording, arrival=True):
    names = ["time", "gyro_x", "gyro_y", "gyro_z", "force_x", "force_y", "force_z"]
    names += ["position_x", "position_y", "position_z"]
    names += [f"quaternion_{axis}" for axis in "xyzw"] + (["arrival"] if arrival else [])
    lines = [",".join(names)]
    for k, t in enumerate(recording.imu_time):
        numbers = [t, *recording.gyro[k], *recording.specific_force[k]]
        lines.append(",".join(f"{x!r}" for x in map(float, numbers)) + "," * (len(names) - 7))
    quaternions = Rotation.from_matrix(recording.rotation).as_quat()
    for k, t in enumerate(recording.pose_time):
        numbers = [*recording.position[k], *quaternions[k]]
        numbers += [recording.pose_arrival_time[k]] if arrival else []
        lines.append(f"{float(t)!r}" + "," * 7 + ",".join(f"{x!r}" for x in map(float, numbers)))
    path.write_text("\n".join(lines) + "\n")


def test_a_table_gives_the_recording_again(tmp_path, config):
    recording = recorded(300)
    write_csv(tmp_path / "r.csv", recording)
    back = Recording.from_file(tmp_path / "r.csv", config)
    for name in ("imu_time", "gyro", "specific_force", "pose_time", "position", "pose_arrival_time"):
        np.testing.assert_array_equal(getattr(back, name), getattr(recording, name))
    np.testing.assert_allclose(back.rotation, recording.rotation, atol=1e-14)


def test_estimate_prints_plots_and_writes(tmp_path, config, capsys):
    write_csv(tmp_path / "r.csv", recorded(), arrival=False)
    (tmp_path / "c.toml").write_text(config.to_toml())
    arguments = ["--config", tmp_path / "c.toml", "--plot", tmp_path / "p.png", "--out", tmp_path / "o.csv"]
    arguments = ["estimate", tmp_path / "r.csv", "--every", 2, *arguments]
    assert main([str(a) for a in arguments]) == 0
    printed = capsys.readouterr().out
    assert "1500 inertial samples over 3.00 s" in printed
    assert "150 poses: 150 accepted" in printed
    assert "errors at the withheld poses: " in printed
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
    table = np.genfromtxt(tmp_path / "o.csv", delimiter=",", names=True)
    assert len(table) == 1500
    assert len(table.dtype.names) == 22


def test_estimate_and_calibrate_as_json(tmp_path, config, capsys):
    recording = recorded()
    write_csv(tmp_path / "r.csv", recording)
    (tmp_path / "c.toml").write_text(config.to_toml())
    which = [str(tmp_path / "r.csv"), "--config", str(tmp_path / "c.toml"), "--json"]
    assert main(["estimate", *which, "--every", "2"]) == 0
    found = json.loads(capsys.readouterr().out)
    run = recording.select(np.arange(len(recording.pose_time)) % 2 == 0).estimate(tilthex.Ukf(config))
    assert found["outcomes"] == {"accepted": 150} and found["poses"] == 150
    assert found["nis"]["mean"] == pytest.approx(np.nanmean(run.nis))
    assert found["gyro_bias"] == pytest.approx(run.gyro_bias[-1])
    errors = found["withheld"]["position"]
    assert 0 < errors["rms"] < errors["percentile_95"] < errors["largest"]
    assert main(["calibrate", *which, "--out", str(tmp_path / "found.toml")]) == 0
    found = json.loads(capsys.readouterr().out)
    place, noises = calibrate(recording, config), found["noises"]
    assert list(found["withheld"]) == ["before", "with_place_latency_and_matrices", "with_all_keys"]
    before, *_, after = (each["position"]["rms"] for each in found["withheld"].values())
    assert 0 < after < before < 0.1 and found["withheld"]["before"]["nis"] > 0
    written = tomllib.loads((tmp_path / "found.toml").read_text())["estimator"]
    assert written["position_noise"] == pytest.approx(found["noises"]["values"]["position_noise"], rel=1e-3)
    assert config.replace(estimator=written).pose_latency == written["latency"]
    assert found["place"]["latency"] == pytest.approx(place.latency)
    assert found["place"]["body_position"] == pytest.approx(place.body_position)
    assert noises["values"].keys() == noises["deviation"].keys() and "position_noise" in noises["values"]


def test_every_zeroth_pose_is_refused(tmp_path, capsys):
    assert main(["estimate", str(tmp_path / "r.csv"), "--every", "0"]) == 2
    assert capsys.readouterr().err == "tilthex: --every is 0; expected 1 or more\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,gyro_x\n0,0\n", "no column 'gyro_y'"),
        (None, "ends in '.txt'; expected a log"),
    ],
)
def test_what_is_no_recording_is_one_sentence(tmp_path, capsys, text, message):
    path = tmp_path / ("r.csv" if text else "r.txt")
    path.write_text(text or "")
    assert main(["estimate", str(path)]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_bad_number_is_named_with_its_line(tmp_path, capsys):
    write_csv(tmp_path / "r.csv", recorded(10))
    lines = (tmp_path / "r.csv").read_text().splitlines()
    lines[4] = lines[4].replace(lines[4].split(",")[2], "fast")
    (tmp_path / "r.csv").write_text("\n".join(lines))
    assert main(["estimate", str(tmp_path / "r.csv")]) == 2
    assert "line 5: could not convert string to float: 'fast'" in capsys.readouterr().err


def test_calibration_finds_offset_turn_and_latency(config):
    offset = np.array([0.06, -0.03, 0.11])
    turn = Rotation.from_euler("ZYX", [70, -25, 160], degrees=True)
    recording = recorded(4000, offset, turn.as_matrix(), late=0.012)
    found = calibrate(recording, config)
    # The noise of a measured rotation moves this body, which makes the lever arm seem 1 % shorter.
    np.testing.assert_allclose(found.body_position, offset, atol=2e-3)
    body = Rotation.from_euler("ZYX", found.body_rotation_deg[::-1], degrees=True)
    assert np.degrees((turn.inv() * body).magnitude()) < 0.1
    assert abs(found.latency - 0.012) < 1e-3
    # Eight seconds are few: their pieces differ by more than their noise explains.
    assert np.all(found.deviation[:3] < 3e-3)
    # With it, the poses are where the estimate has the body.
    known = found.config(config)
    errors = pose_errors(recording, recording.estimate(tilthex.Ukf(known)), known)
    assert np.sqrt(np.mean(errors.position[50:] ** 2)) < 1e-3


def test_a_latency_above_the_history_is_found(config):
    """The configuration with it applies the poses."""
    recording = recorded(2000, late=0.2)
    found = calibrate(recording, config)
    assert abs(found.latency - 0.2) < 1e-3
    known = tilthex.Config.from_text(found.config(config).to_toml())
    outcomes = recording.estimate(tilthex.Ukf(known)).outcome
    assert list(outcomes).count("accepted") > 0.8 * len(outcomes)
    assert "history = 0.43  # " in str(found)


def test_what_changes_during_a_recording_is_in_the_deviations(config):
    """The captured body turns by 1 deg on the robot: no result is exact, and noise does not show it."""
    recording = recorded(3000)
    angle = np.where(recording.pose_time < recording.pose_time.mean(), 0.5, -0.5)
    turn = Rotation.from_rotvec(np.radians(angle)[:, None] * [1.0, 0.0, 0.0])
    turned = Rotation.from_matrix(recording.rotation) * turn
    found = calibrate(replace(recording, rotation=turned.as_matrix()), config)
    assert found.deviation[3] > 0.25
    assert calibrate(recording, config).deviation[3] < 0.25


def test_the_noises_of_a_recording_are_found(config):
    """Those of `ukf_reference.recording`; white noise of s at 500 Hz has the density s / sqrt(500 Hz)."""
    t, gyro, force, taken, measured, turned, _ = simulated(3, 1200)
    stamp = t[taken]
    recording = Recording(t, gyro, force, stamp, measured, turned, stamp)
    true = {
        "position_noise": 0.3e-3,
        "rotation_noise_deg": np.degrees(2e-3),
        "gyro_noise": 0.005 / np.sqrt(500),
        "accelerometer_noise": 0.15 / np.sqrt(500),
    }
    wrong = {key: value * factor for (key, value), factor in zip(true.items(), (5, 0.3, 4, 0.3), strict=True)}
    found = find_noises(recording, config.replace(estimator=wrong))
    for key, value in true.items():
        off = abs(np.log(found.values[key] / value))
        assert off < 4 * found.deviation[key], (key, value, found)
    # The gyro is so good that these poses do not show its noise.
    assert max(found.deviation[key] for key in true if key != "gyro_noise") < 0.5, found
    assert tilthex.Config.from_text(found.config(config).to_toml()) == found.config(config)
    with pytest.raises(ValueError, match="99 poses; expected 100"):
        find_noises(recording.select(np.arange(99)), config)


def test_a_calibration_that_is_none_is_refused(config):
    """Clocks apart by more than is searched, and a body that turns about one axis only."""
    with pytest.raises(
        ValueError, match=r"latency comes out at its bound, 0\.500 s; expected -0\.05 to 0\.5 s"
    ):
        calibrate(recorded(1500, late=0.6), config)
    with pytest.raises(
        ValueError, match=r"place of the captured body .* expected up to 3 m from the robot's"
    ):
        calibrate(recorded(1500, offset=(3.3, 0.0, 0.0)), config)
    t = np.arange(0, 3, 0.002)
    rng = np.random.default_rng(3)
    turn = Rotation.from_rotvec(np.outer(0.5 * np.sin(2 * t), [0, 0, 1]))
    gyro = np.outer(np.cos(2 * t), [0, 0, 1]) + rng.normal(scale=5e-4, size=(len(t), 3))
    force = [0, 0, tilthex.GRAVITY] + rng.normal(scale=1e-2, size=(len(t), 3))  # noqa: RUF005
    stamp, rotation = t[::5], turn[::5] * Rotation.from_rotvec(rng.normal(scale=1e-3, size=(len(t[::5]), 3)))
    place = rng.normal(scale=3e-4, size=(len(stamp), 3))
    with pytest.raises(ValueError, match="does not tell how the body is mounted"):
        calibrate(Recording(t, gyro, force, stamp, place, rotation.as_matrix(), stamp), config)


@pytest.mark.skipif(shutil.which("tilthex-rt") is None, reason="tilthex-rt is not installed")
def test_estimates_from_a_log(tmp_path, capsys):
    log = tmp_path / "flight.mcap"
    flight = ["tilthex-rt", "--sim", "--take-off", "--duration", "6", "--log", str(log)]
    subprocess.run(flight, check=True, capture_output=True, timeout=120)
    assert main(["estimate", str(log), "--plot", str(tmp_path / "p.png")]) == 0
    printed = capsys.readouterr().out
    assert "inertial samples over" in printed
    assert "accepted" in printed
    # The configuration is that of the log, not that of the default vehicle.
    (tmp_path / "other.toml").write_text('[vehicle]\npreset = "tilt-hex"\n[estimator]\nhistory = 0.4\n')
    other = tmp_path / "other.mcap"
    flight = ["tilthex-rt", "--sim", "--take-off", "--duration", "1", "--log", str(other), "--config"]
    subprocess.run([*flight, str(tmp_path / "other.toml")], check=True, capture_output=True, timeout=120)
    of_log = configured(argparse.Namespace(config=None), Log(other))
    assert of_log.to_dict()["estimator"]["history"] == 0.4
    given = argparse.Namespace(config=tmp_path / "third.toml")
    given.config.write_text('[vehicle]\npreset = "quadrotor"\n')
    assert configured(given, Log(other)).to_dict()["estimator"]["history"] == 0.3
