"""A vehicle that flies itself, behind a real pseudo-terminal, and its console."""

import contextlib
import json
import re
import signal
import socket
import time

import numpy as np
import pytest
import tilthex
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from test_programs import control_port, run, sentence, started, wait_for
from tilthex._programs import free_port
from tilthex.log import read

pytestmark = pytest.mark.real_time


@contextlib.contextmanager
def vehicle(*arguments):
    """A vehicle that flies itself, and motion capture: the options for its console."""
    poses = f"natnet://127.0.0.1:{free_port()}/TILTHEX"
    with started("--on-board", "--mocap", poses, *arguments, name="tilthex-sim") as process:
        yield process, ["--port", process.stdout.readline().strip(), "--mocap", poses]


def on_mission(flight):
    """The state when the mission begins.

    A stalled machine holds poses back, and a start that is called off needs a new order.
    """
    before = None
    for state in flight.states(rate=20):
        phase = state and state["phase"]
        if phase == "flying" and state["compliant"]:
            return state
        if phase == "disarmed" and before in ("starting", "grounded"):
            flight.take_off()
        before = phase
    raise AssertionError("the flight ended first")


def test_a_flight_through_the_console(tmp_path):
    log = tmp_path / "console.mcap"
    with vehicle() as (_, console):
        options = [*console, "--take-off", "--control", "127.0.0.1:0", "--log", log]
        with started("console", *options) as process, tilthex.connect(port=control_port(process)) as flight:
            begin = on_mission(flight)
            flight.set_admittance(stiffness=[20.0, 20.0, 20.0, 10.0, 10.0, 5.0])
            with pytest.raises(tilthex.OrderRefused, match="takes no set-points and no wrenches"):
                flight.release_wrench()
            goal = np.add(begin["reference"]["position"], [0.2, 0.0, 0.1])
            flight.go_to(goal)
            there = wait_for(
                flight, lambda state: np.linalg.norm(state["reference"]["position"] - goal) < 0.02
            )
            # What the vehicle does not send is not known.
            assert there["contact_likelihood"] is None and 10.0 < there["battery"] < 20.0
            flight.land()
            out, errors = process.communicate(timeout=60)
            assert process.returncode == 0, errors
        assert "order refused" not in errors and "does not answer" not in errors, errors
        said = re.findall(r"the vehicle says: phase: (\w+)", errors)
        assert said[-3:] == ["flying", "landing", "disarmed"] and said[0] == "starting", said
        assert int(re.search(r"records +(\d+)", out)[1]) > 200
    assert len(read(log, ["/state"])["/state"]["position_w"]) > 200
    with log.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        lines = [found.decoded_message.message for found in reader.iter_decoded_messages(["/log"])]
    assert {"phase: landing", "flying -> landing"} <= set(lines), lines
    assert "vehicle flew by itself" in sentence(run("replay", log), 2)


def test_a_client_is_told_what_the_vehicle_answers():
    with vehicle() as (_, console):
        options = [*console, "--control", "127.0.0.1:0"]
        with started("console", *options) as process, tilthex.connect(port=control_port(process)) as flight:
            wait_for(flight, lambda state: state is not None)
            flight.take_off()
            # The console lets it through; the vehicle has not learnt its bias yet.
            with pytest.raises(
                tilthex.OrderRefused, match="the vehicle refuses it: the vehicle takes no motions now"
            ):
                flight.go_to([0.0, 0.0, 1.0], np.eye(3))
            on_mission(flight)
            flight.set_admittance(mass=[3.0, 3.0, 3.0, 0.02, 0.02, 0.04], damping=[20.0] * 3 + [8.0] * 3)
            for name, value in (("stiffness", [20.0] * 6), ("stiffness", [6.0] * 6)):
                flight.set_admittance(**{name: value})
            flight.land()
            _, errors = process.communicate(timeout=60)
            assert process.returncode == 0, errors
        assert "does not answer" not in errors and "other periods" not in errors, errors


def test_an_order_that_the_vehicle_does_not_answer_is_told():
    with vehicle() as (board, console):
        options = [*console, "--control", "127.0.0.1:0"]
        with started("console", *options) as process, tilthex.connect(port=control_port(process)) as flight:
            wait_for(flight, lambda state: state is not None)
            board.send_signal(signal.SIGSTOP)
            try:
                with pytest.raises(tilthex.OrderRefused, match="does not answer to the order to take off"):
                    flight.take_off()
            finally:
                board.send_signal(signal.SIGCONT)


def test_another_console_takes_over_and_without_one_the_vehicle_lands(tmp_path):
    with vehicle() as (_, console):
        options = ["console", *console, "--control", "127.0.0.1:0"]
        with (
            started(*options, "--take-off") as process,
            tilthex.connect(port=control_port(process)) as flight,
        ):
            on_mission(flight)
            process.kill()
        with started(*options, cwd=tmp_path) as process:
            with tilthex.connect(port=control_port(process)) as flight:
                wait_for(flight, lambda state: state is not None and state["phase"] == "flying")
            # Nobody forwards poses for longer than a vehicle waits for them.
            process.send_signal(signal.SIGSTOP)
            time.sleep(2.0)
            process.send_signal(signal.SIGCONT)
            _, errors = process.communicate(timeout=60)
        assert process.returncode == 4, errors
        assert "the vehicle landed because of a fault: pose lost" in errors, errors


def test_what_is_wrong_is_one_sentence(tmp_path):
    assert "no vehicle is named" in sentence(run("console"), 2)
    assert "a console needs the serial port" in sentence(run("console", "--port", "px4:///dev/ttyUSB0"), 2)
    assert "--record-rate" in sentence(run("console", "--port", "/dev/null", "--record-rate", "0"), 2)
    # A vehicle of another kind, and a program of another kind.
    with started(name="tilthex-sim") as process:
        port = process.stdout.readline().strip()
        result = run("console", "--port", port)
        assert result.returncode == 3 and "a vehicle with tilthex on board" in result.stderr, result
    with vehicle() as (_, console):
        result = run("--take-off", "--no-battery-limits", *console)
        assert result.returncode == 3 and 'the answer was "tilthex1.0"' in result.stderr, result


def test_the_control_socket_refuses_what_the_vehicle_cannot_get():
    with vehicle() as (_, console), started("console", *console, "--control", "127.0.0.1:0") as process:
        port = control_port(process)
        with socket.create_connection(("127.0.0.1", port), 5.0) as client:
            request = {"id": 1, "command": "set_admittance", "max_translation": 0.2}
            client.sendall(json.dumps(request).encode() + b"\n")
            with client.makefile("r", encoding="utf-8") as lines:
                assert "only diagonal" in json.loads(lines.readline())["error"]
