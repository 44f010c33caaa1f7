"""The real programs through a real pseudo-terminal: exit status, errors, signals, log, orders."""

import contextlib
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sysconfig
import time
from pathlib import Path

import numpy as np
import pytest
import tilthex
from test_compare import judge_a_flight
from tilthex._logged import State

pytestmark = pytest.mark.real_time

ROOT = Path(__file__).parent.parent
# What starts the motors of a vehicle at a port, whose battery the configuration does not know.
FLY = ["--take-off", "--no-battery-limits"]
# A simulated flight that hovers until an order.
HOVER = ["--sim", "--take-off", "--control", "127.0.0.1:0"]
PUSHES = "[[push]]\nat = 12.0\nduration = 20.0\nforce = [1.4, 0.0, 0.0]\n"


def program(name):
    found = shutil.which(name, path=sysconfig.get_path("scripts")) or shutil.which(name)
    if found is None:
        pytest.skip(f"{name} is not installed")
    return found


def run(*arguments, name="tilthex-rt", **options):
    return subprocess.run(
        [program(name), *map(str, arguments)], capture_output=True, text=True, timeout=120, **options
    )


@contextlib.contextmanager
def running(*command, stderr=subprocess.PIPE, **options):
    """A process, which is killed at the end. What it printed is shown if the test fails."""
    process = subprocess.Popen(
        list(map(str, command)), stdout=subprocess.PIPE, stderr=stderr, text=True, **options
    )
    try:
        yield process
    except Exception:
        # A flight that has time to land names the fault that ended it.
        process.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.communicate(timeout=30)
        raise
    finally:
        process.kill()
        print(*filter(None, process.communicate()), sep="")


def started(*arguments, name="tilthex-rt", **options):
    return running(program(name), *arguments, **options)


def until(done, found_instead=str, patience=60.0):
    """Waits until `done` returns something true, and returns it."""
    end = time.monotonic() + patience
    while not (found := done()):
        assert time.monotonic() < end, f"it did not come: {found_instead()}"
        time.sleep(0.02)
    return found


@contextlib.contextmanager
def vehicle(*arguments):
    """A simulated vehicle; its pseudo-terminal."""
    with started(*arguments, name="tilthex-sim") as process:
        yield process, process.stdout.readline().strip()


def control_port(process):
    for line in process.stdout:
        if match := re.match(r"control socket at .*:(\d+)", line):
            return int(match[1])
    raise AssertionError("no control socket")


def wait_for(flight, done):
    for state in flight.states(rate=20):
        if done(state):
            return state
    raise AssertionError("the flight ended first")


def sentence(result, status):
    """The one line of an error."""
    assert result.returncode == status, result
    lines = [line for line in result.stderr.splitlines() if "warning" not in line]
    assert len(lines) == 1, result.stderr
    return lines[0]


@pytest.mark.parametrize(
    ("arguments", "status", "says"),
    [
        ([], 2, "--port"),
        ([*FLY, "--port", "/dev/no-such-port"], 3, "does not exist"),
        ([*FLY, "--port", "/dev/null"], 3, "is not a serial port"),
        ([*FLY, "--port", "FT0815"], 3, 'serial number "FT0815"'),
        (["--sim", "--config", "no.toml"], 2, "no.toml"),
        (["--sim", "--trajectory", "no.toml"], 2, "no.toml"),
        (["--sim", "--take-off", "--pushes", "no.toml"], 2, "no.toml"),
        (["--sim", "--log", "/dev/full"], 2, "it is a device; expected a file"),
        (["--sim", "--log", "/tmp"], 2, "it is a directory; expected a file"),
        (["--sim", "--config", "/dev/zero"], 2, "it is a device; expected a file"),
        (["--sim", "--trajectory", "/dev/zero"], 2, "it is a device; expected a file"),
        (["--sim", "--take-off", "--pushes", "/dev/zero"], 2, "it is a device; expected a file"),
        (["--sim", "--duration", "nan"], 2, "--duration"),
        (["--sim", "--control", "0.0.0.0:0"], 2, "every network"),
        (["--sim", "--control", "[::ffff:0.0.0.0]:0"], 2, "every network"),
        (["--sim", "--control", "192.0.2.1:0"], 2, "--control-token-file"),
        (["--sim", "--duration", "1"], 2, "--take-off"),
        (["--port", "/dev/null", "--no-battery-limits"], 2, "--take-off"),
        (["--port", "/dev/null", "--take-off"], 2, "--no-battery-limits"),
        (["replay", "/dev/null"], 2, "it is a device; expected a file"),
        (["replay", "--port", "/dev/null", "x.mcap"], 2, "unexpected argument '--port'"),
        (["--port", "/dev/null", "campaign"], 2, "cannot be used with '--port <DEV>'"),
        (["campaign", "-n", "0"], 2, "'0' for '--number <NUMBER>'"),
        (["campaign", "--seed", str(2**64 - 1)], 2, "expected a smaller one"),
        (["campaign", "--save", "/dev/null"], 2, "name a new file with --save"),
        (["campaign", "--save", "no/such.json"], 2, "there is no folder no"),
        (["campaign", "merge"], 2, "<FILE.json>"),
        (["campaign", "-n", "3", "merge", "x.json"], 2, "cannot be used with '--number <NUMBER>'"),
        (["campaign", "merge", "/dev/null"], 2, "it is a device; expected a file"),
        (["campaign", "merge", __file__], 2, "expected a file that `campaign --save` wrote"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(arguments, status, says):
    assert says in sentence(run(*arguments), status)


def test_a_campaign_as_json_is_the_saved_result(tmp_path):
    saved = tmp_path / "result.json"
    flown = run("campaign", "-n", "2", "--seed", "5", "--save", saved, "--json")
    assert flown.returncode == 0, flown
    found = json.loads(flown.stdout)
    assert found == json.loads(saved.read_text()) and found["seeds"] == [[5, 6]]
    assert json.loads(run("campaign", "merge", saved, "--json").stdout) == found


def test_a_bad_key_names_the_nearest_one(tmp_path):
    config = tmp_path / "config.toml"
    config.write_text('[vehicle]\npreset = "tilt-hex"\n[admittance]\nstifness = [6, 6, 6, 10, 10, 5]\n')
    assert "`stiffness`" in sentence(run("--sim", "--config", config), 2)


def test_the_printed_configuration_is_a_configuration(tmp_path):
    config = tmp_path / "config.toml"
    config.write_text(run("--print-config").stdout)
    assert run("--print-config", "--config", config).stdout == config.read_text()


def test_a_port_that_answers_something_else(tmp_path):
    master, slave = os.openpty()
    os.set_blocking(master, False)
    with started(*FLY, "--port", os.ttyname(slave), "--baud", "0") as process:
        while process.poll() is None:
            with contextlib.suppress(BlockingIOError):
                if b"?" in os.read(master, 1000):
                    os.write(master, b"^?toaster7$")
            time.sleep(0.01)
        error = process.stderr.read()
    assert process.returncode == 3
    assert "toaster7" in error and "chimera" in error


def test_no_answer_and_no_pose():
    master, slave = os.openpty()
    assert "no vehicle identified itself" in sentence(
        run(*FLY, "--port", os.ttyname(slave), "--baud", "0"), 3
    )
    os.close(master)


def test_a_signal_before_the_start_ends_at_once_and_one_in_flight_lands(tmp_path):
    with started("--sim", "--control", "127.0.0.1:0") as process:
        control_port(process)
        time.sleep(1.0)
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 130
        assert "has not started" in process.stderr.read()
    with started("--sim", "--take-off", "--control", "127.0.0.1:0") as process:
        with tilthex.connect(port=control_port(process)) as flight:
            wait_for(flight, lambda state: state["phase"] == "flying")
            process.send_signal(signal.SIGHUP)
            wait_for(flight, lambda state: state["phase"] == "landing")
        output, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "landed" in error
    assert "ticks" in output


def test_orders_move_the_tool_and_the_log_replays_bit_for_bit(tmp_path):
    log = tmp_path / "flight.mcap"
    with (
        started("--sim", "--control", "127.0.0.1:0", "--log", log) as process,
        tilthex.connect(port=control_port(process)) as flight,
    ):
        with pytest.raises(tilthex.OrderRefused, match="stiffness"):
            flight.set_admittance(stiffness=[-1, 6, 6, 10, 10, 5])
        with pytest.raises(ValueError, match="position"):
            flight.go_to([0.0, np.nan, 1.0], np.eye(3))
        flight._socket.sendall(b"garbage\n")
        flight.set_admittance(stiffness=[8, 8, 8, 10, 10, 5])
        flight.take_off()
        start = wait_for(flight, lambda state: state["compliant"])
        assert set(start) == set(State.__annotations__)
        assert 0.0 < start["latency"] < 0.5 and start["given_up"] is None
        target = start["setpoint"]["position"] + [0.1, 0.05, 0.05]
        flight.go_to(target)
        reached = wait_for(
            flight, lambda state: np.linalg.norm(state["setpoint"]["position"] - target) < 1e-6
        )
        assert reached["refused"] >= 2
        assert not reached["faults"]
        flight.land()
        _, error = process.communicate(timeout=60)
    assert process.returncode == 0, error
    replayed = run("replay", log)
    assert replayed.returncode == 0, replayed
    assert "bit for bit" in replayed.stdout
    found = json.loads(run("replay", log, "--json").stdout)
    assert f"{found['ticks']} ticks, {found['messages']} messages" in replayed.stdout
    assert found["first_difference"] is found["missing"] is None


def test_kill_dash_nine_leaves_a_readable_log_and_the_vehicle_falls_back(tmp_path):
    log = tmp_path / "flight.mcap"
    with vehicle("--mocap", "natnet://127.0.0.1:17410/TILTHEX") as (simulated, port):
        arguments = [*FLY, "--port", port, "--baud", "0", "--mocap", "natnet://127.0.0.1:17410/TILTHEX"]
        with started(*arguments, "--log", log, "--control", "127.0.0.1:0") as process:
            with tilthex.connect(port=control_port(process)) as flight:
                wait_for(flight, lambda state: state["phase"] == "flying")
            process.send_signal(signal.SIGKILL)
            assert process.wait(20) == -signal.SIGKILL
        # Its watchdog holds the lowest speed and tells who listens.
        line = os.open(port, os.O_RDWR | os.O_NOCTTY)
        heard = b""
        while b"without set-points" not in heard:
            heard += os.read(line, 4096)
        os.close(line)
        assert simulated.poll() is None
    replayed = run("replay", log)
    assert replayed.returncode == 5, replayed
    assert int(replayed.stdout.split()[0]) > 1000
    assert "the log is cut" in replayed.stdout
    assert "breaks off" in sentence(replayed, 5)


def test_a_pulled_port_in_flight_is_the_links_fault(tmp_path):
    log = tmp_path / "flight.mcap"
    with vehicle("--mocap", "vrpn://127.0.0.1:17411/TILTHEX") as (simulated, port):
        arguments = [*FLY, "--port", port, "--baud", "0", "--mocap", "vrpn://127.0.0.1:17411/TILTHEX"]
        with started(*arguments, "--log", log, "--control", "127.0.0.1:0") as process:
            with tilthex.connect(port=control_port(process)) as flight:
                wait_for(flight, lambda state: state["phase"] == "flying")
            simulated.send_signal(signal.SIGKILL)
            output, error = process.communicate(timeout=30)
    assert process.returncode == 3
    assert "disappeared in flight" in error
    assert (tmp_path / "flight.fault.mcap").exists(), output


def test_a_disk_that_fills_up_does_not_end_the_flight(tmp_path):
    def small_disk():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))

    log = tmp_path / "flight.mcap"
    result = run("--sim", "--take-off", "--duration", "1", "--log", log, preexec_fn=small_disk)
    assert result.returncode == 0, result.stderr
    assert "breaks off" in result.stdout


def test_the_log_reads_with_common_tools(tmp_path, capsys):
    """A pushed flight, read by PyPI's `mcap` and its protobuf support: every channel has a schema."""
    mcap = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_protobuf.decoder")
    pushes, log = tmp_path / "pushes.toml", tmp_path / "flight.mcap"
    pushes.write_text(PUSHES)
    result = run("--sim", "--take-off", "--duration", "9", "--pushes", pushes, "--log", log)
    assert result.returncode == 0, result.stderr
    with log.open("rb") as file:
        reader = mcap.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        summary = reader.get_summary()
        assert all(summary.schemas[c.schema_id].encoding == "protobuf" for c in summary.channels.values())
        topics = {
            c.topic: summary.statistics.channel_message_counts.get(c.id, 0) for c in summary.channels.values()
        }
        [attachment] = reader.iter_attachments()
        assert attachment.name == "config.toml"
        tilthex.Config.from_toml(_write(tmp_path / "attached.toml", attachment.data))
        forces, truths = [], []
        for _, channel, message, decoded in reader.iter_decoded_messages(["/wrench", "/truth"]):
            assert message.log_time >= message.publish_time > 0
            if channel.topic == "/wrench":
                forces.append(decoded.tool_w.force.x)
            else:
                truths.append(decoded.tool_wrench_w.force.x)
    judge_a_flight(log, tmp_path, capsys)
    ticks = int(re.search(r"ticks +(\d+)", result.stdout)[1])
    for topic in [
        "/state",
        "/setpoint",
        "/reference",
        "/wrench",
        "/rotors",
        "/timing",
        "/link",
        "/flight",
        "/input",
        "/output",
    ]:
        assert topics[topic] == ticks, topic
    assert topics["/log"] > 5 and topics["/tf"] > 100 and topics["/truth"] > 500
    assert max(truths) == 1.4
    assert abs(np.median(np.array(forces)[-500:]) - 1.4) < 0.2 or max(forces) > 1.0


def _write(path: Path, data: bytes):
    path.write_bytes(data)
    return path


def test_the_loop_makes_only_the_system_calls_that_are_documented(tmp_path):
    """docs/loop.md lists them; strace watches the loop's thread in flight."""
    strace = shutil.which("strace")
    if strace is None:
        pytest.skip("strace is not installed")
    listed = set(re.findall(r"^\| `(\w+)` \|", (ROOT / "docs" / "loop.md").read_text(), re.MULTILINE))
    assert listed
    trace = tmp_path / "trace"
    with (
        started(*HOVER, "--log", tmp_path / "flight.mcap") as process,
        tilthex.connect(port=control_port(process)) as flight,
    ):
        wait_for(flight, lambda state: state["phase"] == "flying")
        tasks = Path(f"/proc/{process.pid}/task").iterdir()
        [thread] = [task.name for task in tasks if (task / "comm").read_text().strip() == "loop"]
        command = [strace, "-qq", "-p", thread, "-o", trace, "-e", "trace=all"]
        watcher = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        wait_for(flight, lambda state: (trace.exists() and trace.stat().st_size > 100_000) or watcher.poll())
        watcher.send_signal(signal.SIGINT)
        _, error = watcher.communicate(timeout=20)
        if not trace.exists() or trace.stat().st_size == 0:
            pytest.skip(f"strace may not watch: {error}")
        flight.land()
        process.communicate(timeout=60)
    calls = set(re.findall(r"^(\w+)\(", trace.read_text(), re.MULTILINE))
    assert {"clock_nanosleep", "ioctl", "read", "write"} <= calls <= listed, calls


SURVIVED = (
    "bit-flips,frames-lost,frames-duplicated,frames-reordered,frames-cut,garbage,capture-lost,capture-flips,"
    "capture-jumps,capture-noise,capture-clock,imu-noise,imu-frozen,gyro-bias,accelerometer-bias,"
    "imu-saturated,rotor-thrust,rotor-slow,rotor-stuck,motor-emergency,battery-empty,reboot,unplugged,"
    "disk-full,disk-slow,stopped,commands-lost"
)
"""Kinds of faults that no flight may fail with; docs/results has all kinds and their figures."""


def test_hundreds_of_faulty_flights_end_as_the_table_says():
    """No panic, no bad byte, no unlisted reaction, no fly-away, no motor stopped in the air."""
    flown = run("campaign", "-n", "200", "--faults", SURVIVED)
    assert flown.returncode == 0, flown.stdout[-2000:] + flown.stderr
    kinds = [line.split() for line in flown.stdout.splitlines() if re.match(r"\w+ +\d+ +\d", line)]
    assert len(kinds) == SURVIVED.count(",") + 1 and sum(int(kind[1]) for kind in kinds) > 200
    assert sum(int(kind[-1]) for kind in kinds) == 0


def test_a_faulty_flight_tells_its_story():
    flown = run("campaign", "-n", "1", "--seed", "1", "--faults", "motor-emergency")
    assert flown.returncode == 0, flown.stderr
    assert "a motor that stops and shows its emergency bit" in flown.stdout
    assert re.search(r"emergency .* rotor lost", flown.stdout)
    assert flown.stdout.rstrip().endswith("stands, motors off")


def test_ranges_of_seeds_merge_into_the_table_of_the_whole(tmp_path):
    whole, first, second, merged = (tmp_path / f"{name}.json" for name in ("whole", "a", "b", "merged"))
    flown = run("campaign", "-n", "7", "--seed", "8100", "--save", whole)
    run("campaign", "-n", "1", "--seed", "8100", "--save", first)
    run("campaign", "-n", "6", "--seed", "8101", "--save", second)
    joined = run("campaign", "merge", second, first, "--save", merged)
    assert joined.stdout == flown.stdout and joined.returncode == flown.returncode
    assert merged.read_bytes() == whole.read_bytes()
    twice = sentence(run("campaign", "merge", merged, second), 2)
    assert "b.json" in twice and "seeds 8101 to 8106" in twice
    # A file that was changed by hand is refused, whatever its numbers are.
    for bad in ("[9, 3]", f"[3, {2**64 - 1}]", "[5]", "[-1, 3]"):
        second.write_text(re.sub(r"\[\s*8100,\s*8100\s*\]", bad, first.read_text()))
        assert "expected a file that `campaign --save` wrote" in sentence(run("campaign", "merge", second), 2)
