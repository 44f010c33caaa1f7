"""The example that sends poses over UDP, read by the program that flies."""

import socket
import subprocess
import sys

import numpy as np
import pytest
from test_programs import ROOT, run

sys.path.insert(0, str(ROOT / "examples"))
import send_pose

pytestmark = pytest.mark.real_time


@pytest.fixture
def port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def capture_line(port, body, tmp_path):
    """What `tilthex-rt doctor` says about the capture system."""
    config = tmp_path / "mine.toml"
    preset = '[vehicle]\npreset = "tilt-hex"\n'
    config.write_text(f'{preset}[mocap]\nuri = "udp://127.0.0.1:{port}/{body}"\nup_axis = "z"\n')
    said = run("doctor", "--config", config).stdout
    return next(line for line in said.splitlines() if "capture" in line)


def test_the_program_reads_what_the_example_sends(port, tmp_path):
    sender = subprocess.Popen([sys.executable, ROOT / "examples/send_pose.py", f"127.0.0.1:{port}", "hex"])
    try:
        assert "poses per second" in capture_line(port, "hex", tmp_path)
    finally:
        sender.kill()
        sender.wait()


def test_a_packet_has_the_length_of_the_page():
    packet = send_pose.packet(7, 1.5, [1, 2, 3], [0, 0, 0, 1], "tilt-hex", seen=False)
    assert len(packet) == 80 + 8 and packet[:8] == b"tilthex1" and packet[80:] == b"tilt-hex"
    assert list(np.frombuffer(packet, "<u4", 2, 8)) == [7, 0]
    assert list(np.frombuffer(packet, "<f8", 8, 16)) == [1.5, 1, 2, 3, 0, 0, 0, 1]
