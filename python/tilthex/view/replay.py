"""A log in the page: a slider over time, and a list of events."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

from tilthex.view.page import Page
from tilthex.view.sample import Flown

if TYPE_CHECKING:
    import viser

POINTS = 1500
"""Number of points of a plot over the whole log."""
FRAME = 0.05
"""Time between two pictures while it plays, s."""
SPEEDS = ("0.25", "0.5", "1", "2", "5", "10")


class Replay:
    """The page of a log."""

    def __init__(self, server: viser.ViserServer, flown: Flown, title: str) -> None:
        self._flown = flown
        self.page = Page(server, flown.config, title, POINTS)
        end = float(flown.times[-1])
        gui = server.gui
        with self.page.controls:
            self.slider = gui.add_slider(
                "time, s", min=0.0, max=max(round(end, 2), 0.01), step=0.01, initial_value=0.0
            )
            self.play = gui.add_checkbox("play", False)
            self.speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
            times = {f"{at:.2f} s  {what}": at for at, what in flown.events()}
            if times:
                self.jump = gui.add_dropdown(
                    "go to", tuple(times), hint="changes of the phase, and faults as they begin"
                )

                @self.jump.on_update
                def _(_: object) -> None:
                    _set(self.slider, times[self.jump.value])

        @self.slider.on_update
        def _(_: object) -> None:
            self.page.show(flown.at(self.slider.value))

        self.page.charts.fill(flown.thinned(POINTS))
        self.page.show(flown.sample(0))

    def run(self, ended: threading.Event) -> None:
        """Moves the slider while it plays, until the end."""
        last = time.monotonic()
        while not ended.wait(FRAME):
            now = time.monotonic()
            passed, last = now - last, now
            if not self.play.value:
                continue
            at = self.slider.value + passed * float(self.speed.value)
            end = float(self._flown.times[-1])
            if at >= end:
                at = end
                _set(self.play, False)
            # The time is not rounded to the slider's steps, with which it could stand still.
            _set(self.slider, at)


def _set(handle: Any, value: float) -> None:
    """Sets the value of an element, which viser's types declare read-only."""
    handle.value = value
