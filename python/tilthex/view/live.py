"""The page of a running flight."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

from tilthex.view.controls import Controls
from tilthex.view.hand import Hand
from tilthex.view.page import Page
from tilthex.view.pilot import Pilot
from tilthex.view.presence import Presence
from tilthex.view.sample import tool_pose

if TYPE_CHECKING:
    import viser

    from tilthex.view.brake import Connect
    from tilthex.view.sample import Sample

FRAME = 0.1
"""Time between two pictures, s."""
DRAW = 5
"""The plots are drawn once for this number of pictures."""
KEPT = 30.0
"""Duration of the plots, s."""


class Live:
    """Shows the states of the flight, and gives the orders of the page."""

    def __init__(
        self,
        server: viser.ViserServer,
        connect: Connect,
        title: str,
        push_port: int | None = None,
    ) -> None:
        """Connects to the flight. If it is simulated, it receives pushes of its tool at a UDP port.

        Raises:
            ConnectionError: No flight takes orders there.
        """
        self.presence = Presence(server)
        self.pilot = Pilot(connect, self.presence, self._tell)
        self.page = Page(server, self.pilot.config, title, round(KEPT / FRAME))
        with self.page.controls:
            self.controls = Controls(server, self.pilot)
        self.hand = None if push_port is None else Hand(server, push_port)
        self._shown: Sample | None = None

    def run(self, ended: threading.Event) -> None:
        """Shows the flight until the end."""
        self.pilot.start()
        try:
            pictures = 0
            while not ended.wait(FRAME):
                self._show()
                pictures += 1
                if pictures % DRAW == 0:
                    self.page.charts.draw()
        finally:
            if self.hand is not None:
                self.hand.close()
            self.presence.close()
            self.pilot.close()

    def _show(self) -> None:
        sample = self.pilot.newest
        if sample is None:
            return
        self.controls.update()
        if sample is not self._shown:
            self.page.charts.add(sample)
            if self.hand is not None:
                self.hand.ball.position = tool_pose(sample.robot, self.pilot.config).position
        self._shown = sample
        self.page.show(sample, link_age=max(0.0, time.monotonic() - self.pilot.arrived))

    def _tell(self, title: str, text: str) -> None:
        self.page.tell(title, text)
