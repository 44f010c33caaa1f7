"""A topic of poses as the pose source: sends each `PoseStamped` as a packet for `--mocap udp://`."""

from __future__ import annotations

import contextlib
import socket
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex._quaternions import quaternion_from_rotation
from tilthex.ros2 import orders

PORT = 7411
"""Default port of tilthex-rt for these packets."""
LONGEST_NAME = 64
"""Longest name of a body in a packet, bytes."""


class PoseSender:
    """Sends the poses of a body (docs/protocols.md, "UDP: anything else").

    Args:
        to: HOST or HOST:PORT of tilthex-rt.
        body: The name in its URI.

    Raises:
        ValueError: The port or the name is not possible.
        OSError: The host does not exist.
    """

    def __init__(self, to: str, body: str) -> None:
        host, _, port = to.partition(":")
        if port and not (port.isdecimal() and int(port) <= 65535):
            raise ValueError(f"the port of {to} is not a number up to 65535; expected HOST or HOST:PORT")
        self._body = body.encode()
        if not 1 <= len(self._body) <= LONGEST_NAME:
            raise ValueError(f"the body's name has {len(self._body)} bytes; expected 1 to {LONGEST_NAME}")
        self._line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._line.connect((host, int(port or PORT)))
        except OSError as error:
            raise OSError(f"poses cannot be sent to {host} ({error}); expected HOST or HOST:PORT") from error
        self._number = 0

    def send(self, message: Any, now: int) -> None:
        """Sends a pose with the time of its stamp; if it has none, with the time `now`, ns.

        Raises:
            ValueError: It is not a pose in the world.
        """
        position, rotation = orders.pose(message)
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        self.pack(stamp or now, position, rotation)

    def pack(self, time: int, position: NDArray[np.float64], rotation: NDArray[np.float64]) -> None:
        """Sends one packet. It is not an error if no program listens."""
        packet = struct.pack(
            "<8sIId3d4d",
            b"tilthex1",
            self._number,
            1,
            time * 1e-9,
            *position,
            *quaternion_from_rotation(rotation),
        )
        self._number = (self._number + 1) % 2**32
        # The call is refused if no program received the last packet.
        with contextlib.suppress(ConnectionRefusedError):
            self._line.send(packet + self._body)

    def close(self) -> None:
        """Closes the socket."""
        self._line.close()
