"""Clients that others wrote read our motion capture servers over loopback.

Each client runs in a process of its own: some block for ever when nothing comes.
"""

import importlib.util
import json
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
BODY = "tilt-hex"

# Each prints one JSON object for its third frame.
CLIENTS = {
    "motioncapture": """
import json, sys, motioncapture
kind, host, port, body = sys.argv[1:]
client = motioncapture.connect(kind, {"hostname": host, "port_command": port, "interface_ip": "127.0.0.1"})
seen = 0
while seen < 3:
    client.waitForNextFrame()
    seen += body in client.rigidBodies
found = client.rigidBodies[body]
rotation = found.rotation
print(json.dumps({
    "name": body,
    "position": [float(x) for x in found.position],
    "xyzw": [rotation.x, rotation.y, rotation.z, rotation.w],
}), flush=True)
import os; os._exit(0)
""",
    "natnet": """
import json, sys, time, natnet
multicast, port = sys.argv[1] == "multicast", int(sys.argv[2])
client = natnet.NatNetClient(use_multicast=multicast, command_port=port)
frames, names = [], []
client.on_data_frame_received_event.handlers.append(frames.append)
client.on_data_description_received_event.handlers.append(names.append)
with client:
    while len(frames) < 3 or not names:
        client.request_modeldef()
        client.update_sync()
        time.sleep(0.02)
body, suffix = frames[-1].rigid_bodies[0], frames[-1].suffix
print(json.dumps({
    "name": names[-1].rigid_bodies[0].name,
    "position": body.pos,
    "xyzw": body.rot,
    "valid": body.tracking_valid,
    "numbers": [frame.prefix.frame_number for frame in frames],
    "stamps": [suffix.stamp_camera_mid_exposure, suffix.stamp_data_received, suffix.stamp_transmit],
}))
""",
    "new_natnet_client": """
import json, os, sys, time
from new_natnet_client.Client import NatNetClient
from new_natnet_client.NatNetTypes import NAT_Messages

client = NatNetClient(use_multicast=False, command_port=int(sys.argv[1]))
client.send_request(NAT_Messages.CONNECT, "")  # its own comes before it allows itself to send
while (frame := client.MoCap) is None:
    time.sleep(0.02)
body = frame.rigid_body_data.rigid_bodies[0]
p, q = body.pos, body.rot
print(json.dumps({
    "position": [p.x, p.y, p.z],
    "xyzw": [q.x, q.y, q.z, q.w],
    "valid": body.tracking,
}), flush=True)
os._exit(0)
""",
}


def free_port(kind: int) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@contextmanager
def running(command: list[str]) -> Iterator[None]:
    """A program that says something when it is ready and ends with its standard input, or is ended."""
    process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdin and process.stdout
        assert process.stdout.readline(), f"{command} did not start"
        yield
    finally:
        process.terminate()
        process.communicate()


def cargo_run(package: str, *target: str) -> list[str]:
    if shutil.which("cargo") is None:
        pytest.skip("no cargo to build the server with")
    return ["cargo", "run", "--quiet", "--locked", "-p", package, *target, "--"]


def mocap_server(protocol: str, version: str, port: int) -> list[str]:
    server = cargo_run("tilthex-mocap", "--features", "net", "--example", "mocap_server")
    return [*server, protocol, version, str(port), BODY]


def read(client: str, *arguments: object) -> dict[str, Any]:
    """What a client makes of its third frame."""
    if importlib.util.find_spec(client) is None:
        pytest.skip(f"{client} is not installed")
    command = [sys.executable, "-c", CLIENTS[client], *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    assert lines, done.stderr
    frame: dict[str, Any] = json.loads(lines[-1])
    return frame


def assert_on_circle(frame: dict[str, Any]) -> None:
    """The example's body: on the unit circle at 1.5 m, turned by 1 rad about the vertical, z up."""
    x, y, z = frame["position"]
    assert np.hypot(x, y) == pytest.approx(1.0, abs=1e-5)
    assert z == pytest.approx(1.5)
    assert frame["xyzw"] == pytest.approx([0.0, 0.0, np.sin(0.5), np.cos(0.5)], abs=1e-6)
    assert frame.get("name", BODY) == BODY
    assert frame.get("valid", True)


@pytest.mark.parametrize("version", ["3.0", "4.1"])
@pytest.mark.parametrize("cast", ["unicast", "multicast"])
def test_natnet_reads_natnet(version: str, cast: str) -> None:
    port = free_port(socket.SOCK_DGRAM)
    protocol = "natnet" if cast == "unicast" else "natnet+multicast"
    with running(mocap_server(protocol, version, port)):
        frame = read("natnet", cast, port)
    assert_on_circle(frame)
    assert frame["numbers"] == sorted(frame["numbers"])
    assert frame["stamps"] == sorted(frame["stamps"])


@pytest.mark.parametrize("version", ["3.0", "4.1"])
def test_motioncapture_reads_natnet(version: str) -> None:
    port = free_port(socket.SOCK_DGRAM)
    with running(mocap_server("natnet+multicast", version, port)):
        assert_on_circle(read("motioncapture", "optitrack", "127.0.0.1", port, BODY))


# This client takes any server for one of 4.1, since it looks at the version before it was told,
# and its multicast binds to the interface's address, where Linux delivers no group's packets.
def test_new_natnet_client_reads_natnet() -> None:
    port = free_port(socket.SOCK_DGRAM)
    with running(mocap_server("natnet", "4.1", port)):
        assert_on_circle(read("new_natnet_client", port))


def test_motioncapture_reads_vrpn() -> None:
    port = free_port(socket.SOCK_STREAM)
    with running(mocap_server("vrpn", "-", port)):
        assert_on_circle(read("motioncapture", "vrpn", f"tcp://127.0.0.1:{port}", port, BODY))


@pytest.mark.parametrize("protocol", ["natnet", "vrpn"])
def test_the_simulated_vehicle_is_seen(protocol: str) -> None:
    port = free_port(socket.SOCK_DGRAM if protocol == "natnet" else socket.SOCK_STREAM)
    installed = shutil.which("tilthex-sim")
    sim = [installed] if installed else cargo_run("tilthex-rt", "--bin", "tilthex-sim")
    with running([*sim, "--mocap", f"{protocol}://127.0.0.1:{port}/{BODY}"]):
        if protocol == "natnet":
            frame = read("natnet", "unicast", port)
        else:
            frame = read("motioncapture", "vrpn", f"tcp://127.0.0.1:{port}", port, BODY)
    # It stands level on the ground near the origin, facing along x.
    assert np.linalg.norm(frame["position"]) < 1.0
    assert np.abs(frame["xyzw"][3]) == pytest.approx(1.0, abs=0.01)
    assert frame["name"] == BODY
