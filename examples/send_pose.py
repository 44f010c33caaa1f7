"""Sends poses to tilthex over UDP (docs/protocols.md): `tilthex-rt --mocap udp://127.0.0.1/hex` reads them.

    python examples/send_pose.py [HOST[:PORT]] [BODY]

Replace `pose` by the output of your tracking system.
"""

import itertools
import socket
import struct
import sys
import time


def packet(number, taken, position, quaternion_xyzw, body="hex", seen=True):
    """One pose, taken at `taken` (s, any clock that does not jump): m, and a unit quaternion, scalar last."""
    head = struct.pack("<8sIId3d4d", b"tilthex1", number, seen, taken, *position, *quaternion_xyzw)
    return head + body.encode()


def pose():
    return [0.0, 0.0, 0.1], [0.0, 0.0, 0.0, 1.0]


def main(to="127.0.0.1", body="hex", rate=100.0):
    host, _, port = to.partition(":")
    line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    for number in itertools.count():
        taken = time.monotonic()
        line.sendto(packet(number, taken, *pose(), body), (host, int(port or 7411)))
        time.sleep(1.0 / rate)


if __name__ == "__main__":
    main(*sys.argv[1:])
