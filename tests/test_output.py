"""A flight depends neither on who reads its output nor on what lies where its files go."""

import contextlib
import os
import re
import resource
import signal
import subprocess
import threading
import time
from pathlib import Path

import pytest
from test_programs import FLY, control_port, program, run, sentence, started, vehicle, wait_for
from tilthex import connect

pytestmark = pytest.mark.real_time

FLIGHT = ["--sim", "--take-off", "--duration", "1"]


def fly(stdout, stderr=subprocess.PIPE, arguments=FLIGHT, **options):
    return subprocess.run(
        [program("tilthex-rt"), *map(str, arguments)],
        stdout=stdout,
        stderr=stderr,
        text=True,
        timeout=60,
        **options,
    )


@contextlib.contextmanager
def full_pipe():
    """The writing end of a pipe that nobody reads and that takes nothing more."""
    read, write = os.pipe()
    os.set_blocking(write, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(write, bytes(4096))
    os.set_blocking(write, True)
    yield write
    os.close(write)
    os.close(read)


def test_output_to_a_full_disk_does_not_touch_the_flight(tmp_path):
    log = tmp_path / "flight.mcap"
    with Path("/dev/full").open("w") as full:
        flown = fly(full, full, [*FLIGHT, "--log", log])
    assert flown.returncode == 0
    assert "bit for bit" in run("replay", log).stdout


def test_a_reader_that_leaves_does_not_touch_the_flight(tmp_path):
    """As `| head -1` does."""
    log = tmp_path / "flight.mcap"
    with started(*FLIGHT, "--log", log, "--control", "127.0.0.1:0") as process:
        process.stdout.readline()
        process.stdout.close()
        process.stderr.close()
        assert process.wait(60) == 0
        process.stdout = process.stderr = None
    assert "bit for bit" in run("replay", log).stdout


def test_no_output_at_all_does_not_touch_the_flight():
    command = f"exec {program('tilthex-rt')} {' '.join(FLIGHT)} >&- 2>&-"
    assert subprocess.run(["sh", "-c", command], timeout=60).returncode == 0


def test_a_full_pipe_does_not_touch_the_flight(tmp_path):
    log = tmp_path / "flight.mcap"
    with full_pipe() as pipe:
        flown = fly(pipe, pipe, [*FLIGHT, "--log", log])
    assert flown.returncode == 0
    assert "bit for bit" in run("replay", log).stdout


@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_signals_land_whatever_becomes_of_the_output(tmp_path, ending):
    log = tmp_path / "flight.mcap"
    with full_pipe() as pipe:
        process = subprocess.Popen(
            [program("tilthex-rt"), "--sim", "--take-off", "--log", log], stdout=pipe, stderr=pipe, text=True
        )
        try:
            # Its log grows while it flies.
            deadline = time.monotonic() + 20
            while time.monotonic() < deadline and not (log.exists() and log.stat().st_size > 2_000_000):
                time.sleep(0.1)
            process.send_signal(ending)
            assert process.wait(40) == 130
        finally:
            process.kill()
            process.wait()
    assert "bit for bit" in run("replay", log).stdout


@pytest.mark.parametrize("arguments", [["--print-config"], ["replay"], ["campaign", "-n", "1"], ["--help"]])
def test_commands_whose_reader_leaves_do_not_panic(tmp_path, arguments):
    if arguments == ["replay"]:
        log = tmp_path / "flight.mcap"
        assert run(*FLIGHT, "--log", log).returncode == 0
        arguments = ["replay", log]
    read, write = os.pipe()
    os.close(read)
    left = fly(write, arguments=arguments)
    os.close(write)
    assert left.returncode == 0, left.stderr
    assert "panicked" not in left.stderr
    with Path("/dev/full").open("w") as full:
        filled = fly(full, arguments=arguments)
    assert "panicked" not in filled.stderr
    if arguments != ["--help"]:
        assert "No space left on device" in sentence(filled, 6)


@pytest.mark.parametrize("name", ["log.mcap", "link.mcap"])
@pytest.mark.parametrize("link", [["--sim", "--take-off"], ["--take-off", "--port", "/dev/no-such-port"]])
def test_a_log_that_is_there_is_not_touched(tmp_path, name, link):
    log = tmp_path / "log.mcap"
    log.write_bytes(b"precious")
    (tmp_path / "link.mcap").symlink_to(log)
    assert "--overwrite" in sentence(run(*link, "--duration", "0", "--log", tmp_path / name), 2)
    assert log.read_bytes() == b"precious"


def test_a_log_is_replaced_by_order_and_only_for_a_vehicle_that_is_there(tmp_path):
    log = tmp_path / "log.mcap"
    log.write_bytes(b"precious")
    result = run(*FLY, "--port", "/dev/no-such-port", "--overwrite", "--log", log)
    assert "does not exist" in sentence(result, 3)
    assert log.read_bytes() == b"precious"
    new = tmp_path / "new.mcap"
    assert run(*FLY, "--port", "/dev/no-such-port", "--log", new).returncode == 3
    assert not new.exists()
    assert run(*FLIGHT, "--overwrite", "--log", log).returncode == 0
    assert run("replay", log).returncode == 0


def test_two_flights_do_not_share_a_log(tmp_path):
    log = tmp_path / "log.mcap"
    with started("--sim", "--take-off", "--log", log, "--control", "127.0.0.1:0") as process:
        with connect(port=control_port(process)) as flight:
            wait_for(flight, lambda state: state["phase"] == "flying")
            second = run(*FLIGHT, "--overwrite", "--log", log)
            assert "another program writes" in sentence(second, 2)
            flight.land()
        process.communicate(timeout=60)
    assert run("replay", log).returncode == 0


@pytest.mark.parametrize(("act", "says"), [("delete", "deleted"), ("move", "moved or replaced")])
def test_a_log_that_is_taken_away_in_flight_is_said(tmp_path, act, says):
    log = tmp_path / "log.mcap"
    with started("--sim", "--take-off", "--log", log, "--control", "127.0.0.1:0") as process:
        with connect(port=control_port(process)) as flight:
            wait_for(flight, lambda state: state["phase"] == "flying")
            if act == "delete":
                log.unlink()
            else:
                log.rename(tmp_path / "other.mcap")
            time.sleep(1.0)
            flight.land()
        output, error = process.communicate(timeout=60)
    assert process.returncode == 0, f"{output}{error}"
    [line] = [line for line in output.splitlines() if line.startswith("log ")]
    assert says in line
    if act == "move":
        assert run("replay", tmp_path / "other.mcap").returncode == 0


def test_a_report_of_a_fault_replaces_none(tmp_path):
    log, report = tmp_path / "flight.mcap", tmp_path / "flight.fault.mcap"
    # Nobody ever reads a pipe: to open it would hold the program up.
    os.mkfifo(report)
    with vehicle("--mocap", "vrpn://127.0.0.1:17412/TILTHEX") as (simulated, port):
        arguments = [*FLY, "--port", port, "--baud", "0", "--mocap", "vrpn://127.0.0.1:17412/TILTHEX"]
        with started(*arguments, "--log", log, "--control", "127.0.0.1:0") as process:
            with connect(port=control_port(process)) as flight:
                wait_for(flight, lambda state: state["phase"] == "flying")
            simulated.send_signal(signal.SIGKILL)
            output, _ = process.communicate(timeout=30)
    assert process.returncode == 3
    assert re.search(r"last 10 s +.*flight\.fault-2\.mcap", output), output
    assert (tmp_path / "flight.fault-2.mcap").stat().st_size > 10_000


@pytest.mark.parametrize("option", ["--config", "--trajectory", "--pushes", "--log"])
def test_a_pipe_in_place_of_a_file_is_refused_at_once(tmp_path, option):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert "it is a pipe; expected a file" in sentence(run(*FLIGHT, option, pipe), 2)


def test_a_pipe_named_by_a_configuration_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    config = tmp_path / "config.toml"
    config.write_text('vehicle.file = "pipe"\n')
    for name in ("tilthex-rt", "tilthex-sim"):
        result = run(*(FLIGHT if name == "tilthex-rt" else []), "--config", config, name=name)
        assert "it is a pipe; expected a file" in sentence(result, 2)


@pytest.mark.parametrize("length", [1, 12, 31])
def test_a_chain_of_files_is_no_circle(tmp_path, length):
    for k in range(length):
        (tmp_path / f"{k}.toml").write_text(f'[vehicle]\nfile = "{k + 1}.toml"\n')
    (tmp_path / f"{length}.toml").write_text('[vehicle]\npreset = "tilt-hex"\n')
    assert "tilt-hex" in run("--print-config", "--config", tmp_path / "0.toml").stdout


@pytest.mark.parametrize("length", [1, 2, 12])
def test_a_circle_of_files_is_named(tmp_path, length):
    for k in range(length):
        (tmp_path / f"{k}.toml").write_text(f'[vehicle]\nfile = "{(k + 1) % length}.toml"\n')
    error = sentence(run("--print-config", "--config", tmp_path / "0.toml"), 2)
    assert "in a circle" in error
    assert "0.toml" in error


def test_the_simulated_vehicle_does_not_depend_on_its_output():
    with full_pipe() as pipe, Path("/dev/full").open("w") as full:
        for out in (pipe, full):
            process = subprocess.Popen([program("tilthex-sim")], stdout=out, stderr=out)
            time.sleep(0.5)
            process.send_signal(signal.SIGTERM)
            assert process.wait(10) == 0


def test_few_descriptors_and_no_reader_at_once():
    """A pipe that is read so slowly that the status never comes through."""
    read, write = os.pipe()
    limit = (64, 64)
    process = subprocess.Popen(
        [program("tilthex-rt"), *FLIGHT],
        stdout=write,
        stderr=write,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, limit),
    )
    os.close(write)
    slow = threading.Thread(target=lambda: [time.sleep(0.05) for _ in iter(lambda: os.read(read, 1), b"")])
    slow.daemon = True
    slow.start()
    assert process.wait(60) == 0
