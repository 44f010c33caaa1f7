"""Pushes of a simulated tool: the mouse pulls a ball at the tool's tip."""

from __future__ import annotations

import socket
import struct
import threading
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import viser

Array = NDArray[np.float64]

PER_METRE = 10.0
"""Force of a pull, N/m."""
LARGEST = 5.0
"""Largest force of a pull, N."""
AGAIN = 0.05
"""Time between two packets, s; a push ends 0.3 s after its last."""
WRENCH = struct.Struct("<6d")
"""Packet of `tilthex-rt --push-port`: force and torque."""


class Hand:
    """Sends the pull to a simulated flight until it ends."""

    def __init__(self, server: viser.ViserServer, port: int) -> None:
        """A ball in the scene of a page, for the flight that takes pushes at a port of this computer."""
        self._to = ("127.0.0.1", port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._force = np.zeros(3)
        self._pulls = threading.Event()
        self._ended = threading.Event()
        self.ball = server.scene.add_icosphere("/hand", radius=0.025, color=(240, 180, 30))

        # The events are handled in their order, and at once.
        @self.ball.on_drag
        async def _(event: viser.SceneNodeDragEvent[viser.IcosphereHandle]) -> None:
            if event.phase == "end":
                self.release()
            else:
                self.pull(PER_METRE * (np.array(event.end_position) - np.array(event.start_position)))

        self._thread = threading.Thread(target=self._run, name="tilthex-hand", daemon=True)
        self._thread.start()

    @property
    def pulls(self) -> bool:
        """Whether a pull is active."""
        return self._pulls.is_set()

    def pull(self, force: Array) -> None:
        """Pulls the tool with a force (3,), N, world, of `LARGEST` at most, until it is released."""
        size = float(np.linalg.norm(force))
        self._force = force * min(1.0, LARGEST / max(size, 1e-9))
        self._pulls.set()

    def release(self) -> None:
        """Ends the pull."""
        self._pulls.clear()
        self._send(np.zeros(3))

    def close(self) -> None:
        """Ends the pull, and does not accept another one."""
        self._ended.set()
        self._pulls.set()
        self._thread.join()
        self._send(np.zeros(3))
        self._socket.close()

    def _run(self) -> None:
        while self._pulls.wait() and not self._ended.wait(AGAIN):
            if self._pulls.is_set():
                self._send(self._force)

    def _send(self, force: Array) -> None:
        self._socket.sendto(WRENCH.pack(*force, 0.0, 0.0, 0.0), self._to)
