"""`python -m benchmarks.px4_sitl`: tilthex-rt flies PX4's own firmware in software.

`PX4_BUILD` names the folder of a build of PX4 for `px4_sitl`, whose `dds_topics.yaml` is that of
docs/howto/px4.md. This program is the simulator behind PX4's port 4560: it sends inertial samples at
500 Hz on the computer's clock, receives the motors' outputs, moves a plant by them, and sends its poses
to tilthex-rt by UDP. PX4's simulated motor controllers report a speed in proportion to the output, without
lag; the rotors of the plant have a short lag.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import tilthex
from tilthex import px4, so3
from tilthex.check import named

PERIOD = 0.002
FASTEST = 0.001
"""Shortest time between two samples, s: PX4 keeps the delay of samples that come in a burst."""
FULL = 100.0
"""Rotor speed that PX4 reports for an output of 1, Hz."""
LAG = 0.005
LEG = 0.45
CONFIG = f"""[vehicle]
preset = "tilt-hex"
rotor_time_constant = {LAG}
[link]
protocol = "px4"
baud = 0
motor_rate = 100.0
throttle = [0.0, {1.0 / FULL}, 0.0]
throttle_voltage = 0.0
"""
PARAMETERS = {
    "IMU_INTEG_RATE": round(1.0 / PERIOD),
    "COM_DISARM_PRFLT": -1,
    "COM_DISARM_LAND": -1,
    "COM_OF_LOSS_T": 0.5,
    "COM_OBL_RC_ACT": 4,
    "UXRCE_DDS_SYNCT": 0,
    # The simulated board measures no supply.
    "CBRK_SUPPLY_CHK": 894281,
    "SDLOG_MODE": 0,
}
HOVERS = 10.0
"""Time from the start of tilthex-rt to a hover, s."""
SHELL = "px4-uxrce_dds_client stop; px4-uxrce_dds_client start -t udp -h 127.0.0.1 -p 8888"


@dataclass(frozen=True)
class Event:
    """What happens in a hover."""

    name: str
    cause: Callable[[Flight], object] = lambda flight: None
    lands: float | None = None


def _hang(flight: Flight) -> None:
    flight.signal(signal.SIGSTOP)
    threading.Timer(0.3, flight.signal, [signal.SIGCONT]).start()


EVENTS = (
    Event("nothing", lands=12.0),
    Event("tilthex-rt hangs for 0.3 s", _hang, lands=12.0),
    Event("tilthex-rt is killed", lambda flight: flight.signal(signal.SIGKILL)),
    Event("tilthex-rt is stopped", lambda flight: flight.signal(signal.SIGSTOP)),
    Event("PX4's client starts again", lambda flight: flight.shell(SHELL), lands=14.0),
    Event("the pilot lands", lambda flight: flight.shell("px4-commander mode auto:land")),
)
LASTS = 14.0
"""Time after the event that is watched, s."""


class Vehicle:
    """The plant on flat ground, and its sensors."""

    FEET = np.array([[x, y, -LEG] for x in (-0.3, 0.3) for y in (-0.3, 0.3)])

    def __init__(self, model: tilthex.Vehicle) -> None:
        self.plant = tilthex.Plant(model, [0.0, 0.0, LEG])
        self.plant.set_state(rotor_speeds=np.zeros(model.rotor_count))
        self.random = np.random.default_rng(1)

    def ground(self) -> np.ndarray:
        """The wrench of springs, dampers and friction at the feet: force W, torque R."""
        plant, rotation = self.plant, self.plant.rotation
        foot = plant.position + self.FEET @ rotation.T
        moves = plant.velocity + np.cross(plant.angular_velocity, self.FEET) @ rotation.T
        normal = np.where(foot[:, 2] < 0, np.maximum(-3000 * foot[:, 2] - 15 * moves[:, 2], 0), 0)
        slides = np.linalg.norm(moves[:, :2], axis=1)
        friction = np.minimum(4 * slides, 0.6 * normal) / np.maximum(slides, 1e-12)
        force = np.column_stack([-moves[:, :2] * friction[:, None], normal])
        return np.concatenate([force.sum(0), np.cross(self.FEET, force @ rotation).sum(0)])

    def step(self, speeds: np.ndarray) -> None:
        for _ in range(2):
            self.plant.step(speeds, wrench=self.ground(), dt=PERIOD / 2)

    def imu(self, time_us: int, full: bool) -> bytes:
        """MAVLink's HIL_SENSOR. A full one has the magnetometer and the barometer, too."""
        plant, noise = self.plant, self.random.normal
        force, rate = plant.specific_force + noise(0, 0.05, 3), plant.angular_velocity + noise(0, 0.003, 3)
        field = plant.rotation.T @ [0.21, -0.01, -0.42] + noise(0, 0.002, 3)
        altitude = 488.0 + plant.position[2]
        pressure = 1013.25 * (1 - 2.25577e-5 * altitude) ** 5.25588 + noise(0, 0.02)
        vectors = (px4.FLU_TO_FRD * vector for vector in (force, rate, field))
        numbers = (*np.concatenate(list(vectors)), pressure, 0.0, altitude, 20.0)
        return frame(107, 108, struct.pack("<Q13fIB", time_us, *numbers, 0x1FFF if full else 0x3F, 0))

    def gps(self, time_us: int) -> bytes:
        """MAVLink's HIL_GPS, north along x."""
        x, y, z = self.plant.position
        place = (round(473977418 + 90 * x), round(85455938 - 130 * y), round(1e3 * (488.0 + z)))
        north, west, up = (round(100 * v) for v in self.plant.velocity)
        speed = round(np.hypot(north, west))
        numbers = (*place, 30, 40, speed, north, -west, -up, 0, 3, 12, 0, 0)
        return frame(113, 124, struct.pack("<QiiiHHHhhhHBBBH", time_us, *numbers))

    def pose(self, number: int, at: float) -> bytes:
        position = self.plant.position + self.random.normal(0, 2e-4, 3)
        rotation = self.plant.rotation @ so3.exp(self.random.normal(0, 5e-4, 3))
        turn = so3.log(rotation)
        angle = float(np.linalg.norm(turn))
        half = 0.5 * np.sinc(0.5 * angle / np.pi) * turn
        head = struct.pack("<8sIId", b"tilthex1", number, 1, at)
        return head + struct.pack("<7d", *position, *half, np.cos(0.5 * angle)) + b"hex"


TABLE = [0] * 256
for _byte in range(256):
    _rest = _byte
    for _ in range(8):
        _rest = (_rest >> 1) ^ (0x8408 if _rest & 1 else 0)
    TABLE[_byte] = _rest


def frame(message: int, extra: int, payload: bytes) -> bytes:
    """A frame of MAVLink 2."""
    head = bytes([len(payload), 0, 0, 0, 1, 51, message, 0, 0])
    crc = 0xFFFF
    for byte in head + payload + bytes([extra]):
        crc = (crc >> 8) ^ TABLE[(crc ^ byte) & 0xFF]
    return b"\xfd" + head + payload + struct.pack("<H", crc)


def outputs(buffer: bytearray) -> Iterator[tuple[np.ndarray, bool]]:
    """Takes the frames out of a buffer: the outputs to the motors, 0 to 1, and whether PX4 is armed."""
    while len(buffer) >= 12 and len(buffer) >= buffer[1] + 12:
        length, message = buffer[1], buffer[7]
        payload = bytes(buffer[10 : 10 + length]).ljust(81, b"\0")
        del buffer[: length + 12]
        if message == 93:
            yield np.clip(struct.unpack_from("<6f", payload, 16), 0, 1), bool(payload[80] & 128)


@dataclass
class Flight:
    """One flight: PX4, the vehicle, and tilthex-rt."""

    folder: Path
    build: Path
    model: tilthex.Vehicle
    said: list[tuple[float, str]] = field(default_factory=list)
    rates: dict[str, float] = field(default_factory=dict)
    rt: subprocess.Popen[str] | None = None
    status: int | None = None
    event: float = 0.0
    largest: float = 0.0
    armed: bool = False

    def signal(self, number: int) -> None:
        assert self.rt is not None
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.rt.pid, number)

    def shell(self, command: str) -> subprocess.Popen[str]:
        path = f"{self.folder}{os.pathsep}{self.build / 'bin'}{os.pathsep}{os.environ['PATH']}"
        environment = os.environ | {"PATH": path, "PX4_SIM_MODEL": "none_iris"}
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        return subprocess.Popen(command, shell=True, cwd=self.folder, env=environment, **pipes)

    def listen(self, process: subprocess.Popen[str], take: Callable[[str], None]) -> None:
        def lines() -> None:
            assert process.stdout is not None
            for line in process.stdout:
                take(line)

        threading.Thread(target=lines, daemon=True).start()

    def count(self, line: str) -> None:
        """Keeps the rate of a topic from a line of `uorb top`."""
        words = re.sub(r"\x1b\[K", "", line).split()
        if len(words) > 3 and words[3].isdigit():
            self.rates[words[0]] = float(words[3])

    def fly(self, event: Event) -> str:
        """Flies, and returns a row of the table."""
        parameters = PARAMETERS | px4.parameters(self.model)
        parameters |= {f"PWM_MAIN_FUNC{motor + 1}": 101 + motor for motor in range(6)}
        script = "".join(f"param set {name} {value}\n" for name, value in parameters.items())
        (self.folder / "px4-rc.params").write_text(script)
        # No ground station.
        (self.folder / "px4-rc.mavlink").write_text("")
        with socket.socket() as server:
            server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            server.bind(("127.0.0.1", 4560))
            server.listen(1)
            server.settimeout(30.0)
            command = f"exec px4 -d {self.build / 'etc'} -s etc/init.d-posix/rcS -w {self.folder}"
            board = self.shell(command)
            self.listen(board, lambda line: self.said.append((time.monotonic(), line)))
            try:
                line, _ = server.accept()
                self.run(line, event)
            finally:
                self.status = self.rt.poll() if self.rt else None
                self.end(board)
        return self.row(event)

    def end(self, board: subprocess.Popen[str]) -> None:
        """Ends both programs, PX4 first: it can keep a processor busy while nothing simulates it."""
        for process in filter(None, (board, self.rt)):
            process.kill()
            process.wait()

    def run(self, line: socket.socket, event: Event) -> None:
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        line.setblocking(False)
        vehicle = Vehicle(self.model)
        poses = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        lands = f"--duration {event.lands}" if event.lands else ""
        rt = (
            f"exec {shutil.which('tilthex-rt')} --config px4.toml --port px4+udp://:8888 --take-off {lands} "
            "--mocap udp://127.0.0.1/hex --no-battery-limits"
        )
        speeds, buffer = np.zeros(6), bytearray()
        begin = sent = time.monotonic()
        plan: list[tuple[float, Callable[[], object]]] = [
            (4.0, lambda: setattr(self, "rt", self.shell(rt))),
            (4.0 + HOVERS, lambda: self.listen(self.shell("timeout 3 px4-uorb top -1 -a"), self.count)),
            (7.0 + HOVERS, lambda: (setattr(self, "event", time.monotonic()), event.cause(self))),
            (7.0 + HOVERS + LASTS, lambda: None),
        ]
        for number in range(sys.maxsize):
            time.sleep(max(0.0, max(begin + number * PERIOD, sent + FASTEST) - time.monotonic()))
            with contextlib.suppress(BlockingIOError):
                buffer += line.recv(65536)
            for found, self.armed in outputs(buffer):
                speeds = FULL * found
            vehicle.step(speeds)
            now, time_us = time.monotonic(), round(1e6 * (1.0 + number * PERIOD))
            sent = now
            line.send(vehicle.imu(time_us, number % 10 == 0))
            if number % 100 == 0:
                line.send(vehicle.gps(time_us))
            if number % 5 == 0:
                poses.sendto(vehicle.pose(number, now), ("127.0.0.1", 7411))
            if 3.5 + HOVERS < now - begin < 6.9 + HOVERS:
                self.largest = max(self.largest, float(np.hypot(*vehicle.plant.position[:2])))
            if now - begin > plan[0][0]:
                plan.pop(0)[1]()
            if not plan or (self.event and self.rt and self.rt.poll() is not None and not self.armed):
                return

    def row(self, event: Event) -> str:
        failsafe = [
            at - self.event for at, line in self.said if "Failsafe activated" in line and at > self.event
        ]
        topics = ("actuator_motors", "offboard_control_mode", "sensor_combined", "esc_status")
        rates = "/".join(f"{self.rates.get(topic, 0.0):.0f}" for topic in topics)
        after = f"{failsafe[0]:.2f}" if failsafe else "-"
        end = "" if self.status is None else f"tilthex-rt ended with {self.status}, "
        return (
            f"{event.name:28} {rates:>16} {1e3 * self.largest:8.1f} {after:>10}   "
            f"{end}{'armed' if self.armed else 'disarmed'}"
        )


def main() -> None:
    build = os.environ.get("PX4_BUILD")
    if not build:
        raise SystemExit("PX4_BUILD is not set; expected the folder of a build of PX4 for px4_sitl")
    print("rates: messages/s in PX4 of actuator_motors/offboard_control_mode/sensor_combined/esc_status")
    print("off: largest horizontal distance of the hover from its place, before the event")
    print("failsafe: time from the event to the failsafe of PX4, s")
    print()
    print(f"{'in a hover':28} {'rates':>16} {'off (mm)':>8} {'failsafe':>10}   end")
    for event in EVENTS:
        with tempfile.TemporaryDirectory() as folder:
            config = Path(folder) / "px4.toml"
            config.write_text(CONFIG)
            flight = Flight(Path(folder), Path(build).resolve(), named(str(config)).vehicle)
            print(flight.fly(event), flush=True)


if __name__ == "__main__":
    main()
