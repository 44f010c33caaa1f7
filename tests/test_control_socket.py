"""The control socket of a running flight, against clients that are in its way."""

import contextlib
import json
import signal
import socket
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import tilthex
from test_programs import control_port, run, sentence, started, wait_for

pytestmark = pytest.mark.real_time

HOLD = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]


def line(**request):
    return json.dumps(request).encode() + b"\n"


def say(connection, **request):
    """What is answered to one request on a connection of one's own."""
    connection.sendall(line(id=1, **request))
    with connection.makefile("r", encoding="utf-8") as lines:
        return json.loads(lines.readline())


@contextlib.contextmanager
def connected(port):
    with socket.create_connection(("127.0.0.1", port), 5.0) as connection:
        yield connection


def flood(port, stop):
    """Streams set-points as fast as they go, and reads no answer."""
    with contextlib.suppress(OSError), connected(port) as connection:
        connection.setblocking(False)
        request = line(command="follow", position=[0, 0, 1], rotation=HOLD)
        while not stop.is_set():
            with contextlib.suppress(BlockingIOError):
                connection.send(request)


def priorities(pid):
    """The real-time priority of each thread of a process by its name; 0 for an ordinary one."""
    threads = {}
    for thread in Path(f"/proc/{pid}/task").iterdir():
        stat = (thread / "stat").read_text().rpartition(")")[2].split()
        threads[(thread / "comm").read_text().strip()] = int(stat[37])
    return threads


def test_one_flight_and_everybody_who_is_in_its_way(tmp_path):
    log = tmp_path / "flight.mcap"
    with started("--sim", "--control", "127.0.0.1:0", "--log", log) as process:
        port = control_port(process)
        flight = tilthex.connect(port=port)
        # A web page that posts an order: the first line of HTTP ends its connection.
        with connected(port) as page:
            page.sendall(b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" + line(command="kill"))
            with page.makefile("r", encoding="utf-8") as answer:
                assert "not a JSON object" in json.loads(answer.readline())["error"]
                assert answer.readline() == ""
        # A rate that no clock can keep ends no thread and takes no place.
        with connected(port) as client:
            assert "0.1" in say(client, command="stream", rate=1e-300)["error"]
            assert say(client, command="state")["ok"]
        # Forty that say nothing, or half an order.
        silent = [socket.create_connection(("127.0.0.1", port), 5.0) for _ in range(40)]
        for connection in silent[::2]:
            with contextlib.suppress(OSError):
                connection.sendall(b'{"command": "la')
        flight.take_off()
        with tilthex.connect(port=port) as other:
            with pytest.raises(tilthex.OrderRefused, match="holds the controls"):
                other.zero_bias()
            assert "client" in other.state()["controls"]
        with pytest.raises(tilthex.OrderRefused, match="does not fly"):
            flight.follow([0.0, 0.0, 1.0], np.eye(3))
        # None of these drops it.
        wait_for(flight, lambda state: state["phase"] == "flying")
        for ignored in (signal.SIGUSR1, signal.SIGALRM, signal.SIGTTOU, signal.SIGXFSZ, signal.SIGRTMIN):
            process.send_signal(ignored)
        with pytest.raises(tilthex.OrderRefused, match="already"):
            flight.take_off()
        hover = wait_for(flight, lambda state: state["compliant"])
        assert hover["phase"] == "flying" and not hover["faults"]
        # Where the loop has real-time rights, who serves it stands behind it, and before ordinary programs.
        given = priorities(process.pid)
        for name, steps in {"recorder": 2, "control": 3, "control-client": 3}.items():
            assert given[name] == max(0, given["loop"] - steps), given
        # Without its operator it holds; whoever takes the controls goes on.
        flight.close()
        with tilthex.connect(port=port) as successor:
            held = wait_for(successor, lambda state: "operator silent" in state["faults"])
            assert held["phase"] == "holding"
            successor.take_controls()
            wait_for(successor, lambda state: state["phase"] == "flying" and not state["faults"])
            # A kill from anyone, beside a stream of whoever holds the controls and a full house.
            stop = threading.Event()
            floods = [threading.Thread(target=flood, args=(port, stop)) for _ in range(3)]
            for thread in floods:
                thread.start()
            time.sleep(0.5)
            with connected(port) as anyone:
                assert say(anyone, command="kill") == {"id": 1, "ok": True}
            process.wait(20)
            stop.set()
            for thread in floods:
                thread.join()
        for connection in silent:
            connection.close()
        output, error = process.communicate()
    assert process.returncode == 4, error
    assert "killed by order: the motors were stopped in flight" in error
    assert "requests refused" in output
    replayed = run("replay", log)
    assert replayed.returncode == 0, replayed
    assert "bit for bit" in replayed.stdout


def test_a_client_waits_for_slow_states_and_keeps_its_connection():
    with started("--sim", "--control", "127.0.0.1:0") as process:
        port = control_port(process)
        # A state a second comes later than an answer may.
        with tilthex.connect(port=port, timeout=0.5) as flight:
            ticks = [state["tick"] for state, _ in zip(flight.states(rate=1.0), range(2), strict=False)]
            assert ticks[0] < ticks[1]
            with pytest.raises(ValueError, match="rate is 0; expected"):
                next(flight.states(rate=0))
            with pytest.raises(ValueError, match="stiffness is nan; expected finite"):
                flight.set_admittance(stiffness=np.nan)
            # The flight would end the connection of who sends so long a line.
            with pytest.raises(ValueError, match=r"play has \d+ bytes; expected at most 65536"):
                flight.play([{"position": [0.0, 0.0, 1.0], "rotation": HOLD}] * 1000)
            assert flight.state()["phase"] == "disarmed"
        # What the flight says before it ends a connection is the error.
        clients = [tilthex.connect(port=port, present=lambda: False) for _ in range(2)]
        clients[0]._socket.sendall(b"x" * (64 * 1024 + 1))
        # Together with the next request it would be one wrong line.
        time.sleep(0.5)
        with pytest.raises(ConnectionError, match="a line is longer than"):
            clients[0].state()
        # A thread that waits for a state does not delay the end of its client.
        states = clients[1].states(rate=0.1)
        next(states)
        waiting = threading.Thread(target=lambda: list(states))
        waiting.start()
        for client in clients:
            client.close()
        waiting.join(5.0)
        assert not waiting.is_alive()


def test_a_unix_socket_and_a_token(tmp_path):
    token, path = tmp_path / "token", tmp_path / "control"
    token.write_text("correct horse battery staple\n")
    control = ["--control", f"unix:{path}", "--control-token-file", token]
    with started("--sim", *control) as process:
        assert f"unix:{path}" in process.stdout.readline()
        assert path.stat().st_mode & 0o777 == 0o600
        for wrong in (None, "incorrect horse battery"):
            with (
                pytest.raises((tilthex.OrderRefused, ConnectionError)),
                tilthex.connect(path=path, token=wrong) as stranger,
            ):
                stranger.kill()
        with tilthex.connect(path=path, token=token.read_text().strip()) as flight:
            flight.land()
            assert process.wait(20) == 130
    assert not path.exists()
    token.write_text("short")
    assert "5 characters" in sentence(run("--sim", *control), 2)
