"""A VRPN connection that breaks and comes again does not end a flight."""

import contextlib
import selectors
import socket
import threading
import time

import pytest
from test_programs import FLY, control_port, started, vehicle, wait_for
from tilthex import connect

pytestmark = pytest.mark.real_time


class Line:
    """A TCP line that can be broken: all its connections end, and new ones are taken."""

    def __init__(self, server):
        self.server = server
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.pairs = []
        self.accepted = 0
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        with contextlib.suppress(OSError):
            while True:
                near, _ = self.listener.accept()
                far = socket.create_connection(("127.0.0.1", self.server))
                self.accepted += 1
                self.pairs.append((near, far))
                threading.Thread(target=self._pass_on, args=(near, far), daemon=True).start()

    @staticmethod
    def _pass_on(near, far):
        with contextlib.suppress(OSError, ValueError), selectors.DefaultSelector() as ready:
            ready.register(near, selectors.EVENT_READ, far)
            ready.register(far, selectors.EVENT_READ, near)
            while True:
                for key, _ in ready.select(0.5):
                    data = key.fileobj.recv(65536)
                    if not data:
                        return
                    key.data.sendall(data)

    def cut(self):
        pairs, self.pairs = self.pairs, []
        for pair in pairs:
            for end in pair:
                with contextlib.suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)
                end.close()

    def close(self):
        # Closing alone does not wake the thread that waits in `accept`: it would take one connection more.
        self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()
        self.cut()


@pytest.mark.parametrize("times", [1, 3])
def test_a_flight_survives_broken_connections(times):
    with vehicle("--mocap", "vrpn://127.0.0.1:17413/TILTHEX") as (_, port):
        line = Line(17413)
        arguments = [*FLY, "--port", port, "--baud", "0", "--mocap", f"vrpn://127.0.0.1:{line.port}/TILTHEX"]
        with started(*arguments, "--control", "127.0.0.1:0") as process:
            with connect(port=control_port(process)) as flight:
                wait_for(flight, lambda state: state["phase"] == "flying")
                for _ in range(times):
                    line.cut()
                    time.sleep(1.5)
                wait_for(flight, lambda state: state["phase"] in ("flying", "landing"))
                flight.land()
            _, error = process.communicate(timeout=60)
        assert process.returncode == 0, error
        assert line.accepted == 1 + times
        line.close()


def test_a_server_that_goes_for_good_lands():
    with vehicle("--mocap", "vrpn://127.0.0.1:17414/TILTHEX") as (_, port):
        line = Line(17414)
        arguments = [*FLY, "--port", port, "--baud", "0", "--mocap", f"vrpn://127.0.0.1:{line.port}/TILTHEX"]
        with started(*arguments, "--control", "127.0.0.1:0") as process:
            with connect(port=control_port(process)) as flight:
                wait_for(flight, lambda state: state["phase"] == "flying" and state["position"][2] > 0.5)
                line.close()
            _, error = process.communicate(timeout=60)
        assert process.returncode == 4, error
        assert "pose lost" in error
