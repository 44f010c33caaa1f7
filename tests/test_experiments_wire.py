"""An experiment through the wire: tilthex-rt in real time against MuJoCo behind tilthex-sim."""

from __future__ import annotations

import contextlib
import os
import signal
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the experiments need MuJoCo: pip install 'tilthex[experiments]'")

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from mcap_protobuf.decoder import DecoderFactory
from tilthex import __main__ as command
from tilthex._faults import FAULTS
from tilthex._programs import program
from tilthex.experiments import spec, stand, wire, wire_record
from tilthex.experiments.found import judge_of
from tilthex.experiments.plan import trajectory_of
from tilthex.experiments.record import Check, Record, rms
from tilthex.experiments.world_process import MAX_ROTORS, STATE, Stepper

pytestmark = pytest.mark.real_time

# The slope of `sliding` in a third of its time.
BRIEF = {
    "trajectory": {
        "velocity": 0.6,
        "acceleration": 1.0,
        "waypoint": [
            {"phase": "approach", "position": [0.0, 0.0, 0.5], "rpy_deg": [0.0, 7.5, 0.0], "hold": 0.5},
            {"phase": "contact", "position": [0.0, 0.0, 0.38], "duration": 3.0},
            {"phase": "slide", "position": [0.15, 0.0, 0.38], "duration": 3.0},
            {"phase": "rest", "hold": 2.0},
            {"phase": "release", "position": [0.15, 0.0, 0.55], "duration": 3.0, "hold": 0.5},
        ],
    }
}

ORDERED = 1 << next(bit for bit, fault in enumerate(FAULTS) if fault.name == "operator")


def brief() -> spec.Run:
    return spec.load("sliding", changes=BRIEF).runs[0]


def fly(run: spec.Run, files: wire.Files, chances: int = 3) -> tuple[Record, list[str]]:
    """A flight that the machine left alone: one that is starved in flight gets more chances."""
    try:
        wire.fly(run, files)
        return wire_record.read(run, wire.route(run), files)
    except (ValueError, OSError):
        if chances == 1 or longest_silence(files.log) < 0.04:
            raise
    return fly(run, files, chances - 1)


def longest_silence(path: Path) -> float:
    """The longest time between two ticks with inertial samples, s; the log may break off."""
    times: list[float] = []
    samples: list[int] = []
    with path.open("rb") as file, contextlib.suppress(McapError):
        messages = NonSeekingReader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, said in messages.iter_decoded_messages(["/flight", "/link"], log_time_order=False):
            if channel.topic == "/flight":
                times.append(said.time)
            else:
                samples.append(said.imu_samples)
    heard = [time for time, count in zip(times, samples, strict=False) if count > 0]
    return float(np.max(np.diff(heard), initial=0.0))


def test_the_real_programs_slide_along_the_slope(tmp_path: Path) -> None:
    try:
        for end in os.openpty():
            os.close(end)
    except OSError:
        pytest.skip("there is no pseudo-terminal here")
    run = brief()
    record, notes = fly(run, wire.Files.beside(tmp_path / "flight"))
    duration = trajectory_of(run.waypoints, run.limits).duration
    assert record.time[0] == pytest.approx(0.0, abs=0.1)
    assert record.time[-1] == pytest.approx(duration, abs=0.1)
    assert len(record.time) > 0.5 * duration / 0.002
    assert "periods skipped" in notes[0]
    free, touching = record.during("approach"), record.during("slide", "rest")
    force = record.true_wrench[:, :3]
    normal = run.scene().rotation[:, 2]
    # Truth and estimate agree where there is contact and where there is none: in time, too.
    assert np.all(force[free] == 0.0)
    assert 0.4 < np.mean(force[touching] @ normal) < 2.5
    assert rms(record.wrench_tool[touching, :3] - force[touching]) < 0.4
    assert rms(record.wrench_tool[free, :3]) < 0.4
    assert np.max(np.linalg.norm(record.tool_position - record.reference_position, axis=1)) < 0.03
    assert np.max(np.linalg.norm(record.robot_position - record.estimated_position, axis=1)) < 0.02
    # The reference stays on the surface, behind which the desired path goes on.
    off = record.reference_position[touching] - record.setpoint_position[touching]
    assert np.all(off[:, 2] > 0.03)
    assert len(judge_of(spec.load("sliding")).checks(run, record)) > 3


def test_the_run_is_the_same_with_and_without_the_wire() -> None:
    flown = [one for one in map(spec.load, spec.built_in()) if one.wire]
    assert [one.kind for one in flown] == ["multi-contact", "pressing", "sliding"]
    for experiment in flown:
        for run in experiment.runs:
            route, alone = wire.route(run), trajectory_of(run.waypoints, run.limits)
            arrival = list(route.trajectory.begins)[route.first] - run.waypoints[0].hold
            for t in np.linspace(0.0, alone.duration, 200).tolist():
                one, other = alone.sample(t), route.trajectory.sample(arrival + t)
                assert np.allclose(one.position, other.position, atol=1e-9)
                assert np.allclose(one.rotation, other.rotation, atol=1e-9)
                assert np.allclose(one.wrench, other.wrench, atol=1e-9)
                assert one.force_axes == other.force_axes


def test_the_way_home_ends_level_above_the_stand() -> None:
    for rotation in ([0.0, 0.0, 0.0], [0.0, -90.0, 0.0], [180.0, 0.0, 0.0], [10.0, -40.0, 70.0]):
        vehicle = {"preset": "tilt-hex", "tool_position": [0.55, 0.1, 0.0], "tool_rotation_deg": rotation}
        run = spec.load("sliding", changes={"vehicle": vehicle}).runs[0]
        model, home = run.model(), wire.route(run).waypoints[-1]
        robot = home.rotation @ model.tool_rotation.T
        np.testing.assert_allclose(robot, np.eye(3), atol=1e-9)
        above = stand.start(model) + np.array([0.0, 0.0, wire.TAKE_OFF])
        np.testing.assert_allclose(home.position - robot @ model.tool_position, above, atol=1e-9)


@pytest.mark.parametrize(
    ("end", "bits", "passed"),
    [
        ([-1.3, 0.01, 0.15], {"flying": 1, "landing": ORDERED}, [True, True]),
        ([-0.74, 0.0, 0.12], {"flying": 1, "landing": ORDERED}, [False, True]),
        ([-1.3, 0.0, 0.15], {"holding": 1 << 26}, [True, False]),
        ([-1.3, 0.0, 0.15], {"landing": 1 << 1 | ORDERED}, [True, False]),
        # At the touch-down.
        ([-1.3, 0.0, 0.15], {"landing": 1 << 26 | ORDERED}, [True, True]),
        # On the ground, before the first pose.
        ([-1.3, 0.0, 0.15], {"disarmed": 0x63}, [True, True]),
    ],
)
def test_a_landing_elsewhere_or_on_a_fault_falls_short(
    end: list[float],
    bits: dict[str, int],
    passed: list[bool],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    files = wire.Files.beside(tmp_path / "flight")
    np.savez(files.truth, robot_position=[[-1.3, 0.0, 0.15], [0.5, 0.0, 1.0], end])
    flight = {"phase": np.array(list(bits)), "faults": np.array(list(bits.values()), dtype=float)}
    monkeypatch.setattr(wire_record.log, "read", lambda path, topics: {"/flight": flight})
    assert [check.passed for check in wire_record.landing(brief(), files)] == passed


def test_a_flight_that_left_its_way_names_the_fault_and_the_landing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def off(*_: object) -> None:
        raise ValueError("its set-points are off the trajectory")

    fault = Check("K_y = 10: faults in flight", "none", "", "IMU silent", False)
    monkeypatch.setattr(wire, "fly", lambda *_, **__: [])
    monkeypatch.setattr(wire_record, "read", off)
    monkeypatch.setattr(wire_record, "landing", lambda *_: [fault])
    assert command.main(["experiment", "sliding", "--wire", "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "off the trajectory; K_y = 10: faults in flight: IMU silent" in said


def test_a_written_world_is_the_run(tmp_path: Path) -> None:
    run = brief()
    path = tmp_path / "world.toml"
    path.write_text(wire.toml_text(wire.world_table(run)))
    assert spec.load(str(path)).runs == (run,)


def test_the_vehicle_stands_beside_the_scene_and_lifts_off() -> None:
    stepper = Stepper(brief())
    start = stepper.world.position.copy()
    at_rest = np.array(STATE.unpack(stepper.step(0, np.zeros(MAX_ROTORS)))[1:])
    assert np.linalg.norm(at_rest[3:6]) < 1e-3
    assert at_rest[30:33] == pytest.approx([0.0, 0.0, 9.81], abs=0.05)
    # The stand carries it, not its tool.
    assert np.all(at_rest[33:39] == 0.0)
    assert at_rest[41] == pytest.approx(2.4 * 9.81, rel=0.01)
    full = np.full(MAX_ROTORS, 90.0)
    for _ in range(500):
        stepper.step(0, full)
    assert stepper.world.position[2] > start[2] + 0.1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--world", "slidign"], "no experiment 'slidign'"),
        (["--world", "sliding", "--world-run", "K_y = 3"], "no run 'K_y = 3'"),
        (["--world-run", "K_y = 10"], "--world <EXPERIMENT>"),
    ],
)
def test_no_such_world_is_said_in_one_sentence(arguments: list[str], said: str) -> None:
    call = [program("tilthex-sim"), *arguments]
    done = subprocess.run(call, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert said in done.stderr


def test_a_world_that_dies_ends_the_vehicle_with_its_status() -> None:
    call = [program("tilthex-sim"), "--world", "sliding"]
    with subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None and process.stderr is not None
            assert process.stdout.readline().startswith("/dev/")
            [child] = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
            os.kill(int(child), signal.SIGKILL)
            assert process.wait(60) == 3
            [line] = process.stderr.read().splitlines()
            assert "ended by itself" in line
        finally:
            process.kill()


def test_the_process_ends_with_its_input_and_writes_the_truth(tmp_path: Path) -> None:
    truth = tmp_path / "truth.npz"
    call = [sys.executable, "-m", "tilthex.experiments.world_process", "sliding", "--truth", str(truth)]
    requests = [struct.pack(f"<Q{MAX_ROTORS}d", at, *[0.0] * MAX_ROTORS) for at in (5, 1_000_005)]
    done = subprocess.run(call, input=b"".join(requests), capture_output=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(b"tilthex2")
    assert STATE.unpack(done.stdout[-STATE.size :])[0] == 1_000_005
    with np.load(truth) as found:
        assert found["at"].tolist() == [0, 5, 1_000_005]
        assert found["tool_position"].shape == (3, 3)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["shaping", "--wire"], "cannot fly shaping"),
        (["sliding", "--wire", "--state", "exact"], "leave out --random and --state"),
    ],
)
def test_what_the_wire_does_not_fly_is_refused(arguments: list[str], said: str, tmp_path: Path) -> None:
    call = [sys.executable, "-m", "tilthex", "experiment", *arguments, "--out", str(tmp_path)]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert said in done.stderr and len(done.stderr.splitlines()) == 1
