"""A controller in Python flies tilthex-sim through its protocol, with what motion capture sends."""

import copy
import os
import pickle
import pty
import sys
import time

import numpy as np
import pytest
import tilthex
from test_programs import ROOT, running, until, vehicle
from tilthex import wire
from tilthex._programs import free_port
from tilthex.chain import Chain

VEHICLE = tilthex.Vehicle.preset("tilt-hex")
CONFIG = tilthex.Config.default(VEHICLE)
POSES = "udp://127.0.0.1/NOBODY"


class Aside:
    """In the place of the admittance: the reference goes aside, then the law fails."""

    def __init__(self, metres, steps=10**9):
        self.metres, self.steps, self.dts = metres, steps, []

    def step(self, setpoint, wrench, dt):
        self.dts.append(dt)
        if len(self.dts) > self.steps:
            raise RuntimeError("this law has a fault")
        return tilthex.Setpoint(setpoint.position + np.array([self.metres, 0, 0]), setpoint.rotation)


@pytest.mark.real_time
def test_a_block_of_ones_own_flies_and_the_vehicle_lands_whatever_the_block_does():
    with wire.simulated(CONFIG) as found:
        faulty = Aside(0.0, steps=50)
        with pytest.raises(RuntimeError, match="this law has a fault"):
            wire.fly(Chain(VEHICLE, CONFIG, admittance=faulty), CONFIG, **found._asdict(), duration=9.0)
        assert len(faulty.dts) == 51
        # It stands again, so that it can take off.
        law = Aside(0.1)
        flown = wire.fly(Chain(VEHICLE, CONFIG, admittance=law), CONFIG, **found._asdict(), duration=3.0)
    assert flown.time[-1] == pytest.approx(3.0, abs=0.1) and len(flown.time) == len(law.dts)
    # Every inertial sample was used once: the times of the steps are those of the samples.
    np.testing.assert_allclose(np.diff(flown.time), law.dts[1:], atol=1e-9)
    assert flown.samples.sum() == pytest.approx(500 * flown.time[-1], abs=25)
    assert abs(flown.reference - flown.setpoint - [0.1, 0, 0]).max() < 1e-12
    assert abs(flown.position - flown.reference)[-50:].max() < 0.02
    assert abs(flown.position[0] - flown.setpoint[0]).max() < 0.05
    assert flown.command.shape == flown.rotor_speeds.shape == (len(flown.time), VEHICLE.rotor_count)


@pytest.mark.real_time
def test_a_trajectory_is_flown_through_a_pseudo_terminal():
    way = tilthex.Trajectory(
        [{"position": [0, 0, 0.5]}, {"position": [0.2, 0.1, 0.6], "hold": 0.5}], velocity=0.4
    )
    poses = f"vrpn://127.0.0.1:{free_port()}/TILTHEX"
    with vehicle("--mocap", poses) as (_, port):
        flown = wire.fly(Chain(VEHICLE, CONFIG), CONFIG, port=port, poses=poses, trajectory=way)
    assert abs(flown.setpoint[-1] - [0.2, 0.1, 0.6]).max() < 1e-3
    assert abs(flown.position - flown.setpoint).max() < 0.05


@pytest.mark.parametrize("port", ["/dev/ttyUSB0", "/dev/serial/by-id/usb-flymu", "/tmp/line", "FT0815", ""])
def test_only_a_simulated_vehicle_is_flown(port):
    with pytest.raises(ValueError, match="flies simulated vehicles only"):
        wire.fly(Chain(VEHICLE, CONFIG), CONFIG, port=port, poses=POSES, duration=1.0)


def test_what_is_missing_is_named(tmp_path):
    def fly(match, kind=OSError, **options):
        options = {"port": f"unix:{tmp_path / 'line'}", "poses": POSES, "duration": 1.0} | options
        with pytest.raises(kind, match=match):
            wire.fly(Chain(VEHICLE, CONFIG), CONFIG, **options)

    fly("neither trajectory nor duration", ValueError, duration=None)
    fly("cannot be opened: No such file or directory; expected that of a tilthex-sim")
    ours, theirs = pty.openpty()
    try:
        fly("names no protocol", ValueError, port=os.ttyname(theirs), poses="nowhere")
    finally:
        os.close(ours)
        os.close(theirs)
    level = pytest.raises(OSError, match="unknown level `no-such-level`")
    with level, wire.simulated(CONFIG, "--truth", "no-such-level"):
        pass


def test_the_link_says_what_the_programs_say():
    link = tilthex.VehicleLink(CONFIG)
    # The test vectors of the protocol: identify, and six motors at 60 Hz.
    assert link.receive(0.0, b"") == [] and link.command(0.0) == b"^?$"
    data = link.command(0.1, np.full(6, 60.0))
    assert data == bytes.fromhex("5e77" + "208d" * 6 + "24")
    assert not link.ready and not any(link.spinning) and link.battery is None
    link.receive(0.2, b"^B\x00\x3a\x98$")
    assert link.battery == 15.0 and link.silence == 0.0
    with pytest.raises(ValueError, match=r"rotor_speeds has shape \(5,\); expected \(6,\), Hz"):
        link.command(0.3, np.zeros(5))


def test_a_client_of_poses_gets_them_on_the_clock_of_python():
    port = free_port()
    example = str(ROOT / "examples/send_pose.py")
    with running(sys.executable, example, f"127.0.0.1:{port}", "hex"):
        client = tilthex.PoseClient(CONFIG, f"udp://127.0.0.1:{port}/hex")
        found = []
        until(lambda: found.extend(client.receive()) or len(found) > 5)
    for arrival, taken, position, rotation in found:
        assert position.tolist() == [0.0, 0.0, 0.1] and rotation.tolist() == np.eye(3).tolist()
        assert taken <= arrival <= time.monotonic() and time.monotonic() - taken < 60
    assert repr(client).startswith(f"PoseClient(udp://127.0.0.1:{port}/hex, ")
    for act in (pickle.dumps, copy.copy):
        with pytest.raises(TypeError, match="PoseClient is a connection; make a new one from its address"):
            act(client)
    with pytest.raises(ValueError, match="names no body"):
        tilthex.PoseClient(CONFIG, "udp://127.0.0.1")
