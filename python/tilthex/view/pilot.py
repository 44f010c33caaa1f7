"""The connection to a running flight: its states as they come, and the orders of the page."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from tilthex._core import Config
from tilthex.client import Flight, OrderRefused
from tilthex.view.brake import Brake, Connect, Order
from tilthex.view.sample import Sample, from_state

RATE = 20.0
"""States per second."""
AGAIN = 1.0
"""Time between two attempts to connect, s."""


class Pilot:
    """Three connections: one for states and orders, which holds the controls; one to land; one to kill.

    Attributes:
        config: The configuration of the flight as the page was opened.
        newest: The newest sample, None before the first.
        arrived: Its time of arrival on `time.monotonic`.
        land, kill: Give these orders.
    """

    def __init__(
        self, connect: Connect, present: Callable[[], bool], tell: Callable[[str, str], None]
    ) -> None:
        """Connects.

        Args:
            connect: Makes a connection.
            present: Says whether the operator is present.
            tell: Called with a title and a sentence if an order is refused or the flight has gone.

        Raises:
            ConnectionError: No flight takes orders there.
        """
        self._connect, self._present, self._tell = connect, present, tell
        self.land = Brake("land", Flight.land, connect, tell)
        self.kill = Brake("kill", Flight.kill, connect, tell)
        self._waiting: dict[str, Order] = {}
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._first = connect(present=present)
        self.config = Config.from_text(self._first.configuration())
        self.newest: Sample | None = None
        self.arrived = time.monotonic()
        self._thread = threading.Thread(target=self._run, name="tilthex-pilot", daemon=True)

    def start(self) -> None:
        """Starts to receive states and to give orders."""
        self._thread.start()

    def order(self, name: str, order: Order) -> None:
        """Gives an order after the next state. It replaces a waiting order of the same name."""
        with self._lock:
            self._waiting[name] = order

    def close(self) -> None:
        """Ends the connections. A flight that flies the page's orders then holds, and lands later."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join(5.0)
        for each in (self._first, self.land, self.kill):
            each.close()

    def _run(self) -> None:
        flight: Flight | None = self._first
        while True:
            if flight is not None:
                self._take(flight)
            if self._ended.wait(AGAIN):
                return
            try:
                flight = self._connect(present=self._present)
            except (OSError, ValueError):
                # If no flight runs yet, no message is necessary.
                flight = None
            # An order that was given without a flight must not act on the next flight.
            while (waiting := self._next()) is not None:
                self._tell(f"{waiting[0]} does not reach the flight", "The page had no connection to it.")

    def _take(self, flight: Flight) -> None:
        """Receives the states of a flight until it ends."""
        try:
            with flight:
                if Config.from_text(flight.configuration()).vehicle != self.config.vehicle:
                    self._tell("the flight has another vehicle", "Start `tilthex view` again to see it.")
                    return
                self._fly(flight)
            if not self._ended.is_set():
                self._tell("the flight has ended", "The page connects again when one begins.")
        except (OSError, ValueError) as error:
            self._tell("the flight is gone", str(error))
        except KeyError as error:
            self._tell("the flight has another version of tilthex", f"its state has no {error}")

    def _fly(self, flight: Flight) -> None:
        for brake in (self.land, self.kill):
            brake.prepare()
        for state in flight.states(rate=RATE):
            self.newest, self.arrived = from_state(state), time.monotonic()
            while (waiting := self._next()) is not None:
                self._give(flight, *waiting)
            if self._ended.is_set():
                return

    def _next(self) -> tuple[str, Order] | None:
        """The order that has waited longest."""
        with self._lock:
            name = next(iter(self._waiting), None)
            return None if name is None else (name, self._waiting.pop(name))

    def _give(self, flight: Flight, name: str, order: Order) -> None:
        try:
            order(flight)
        except OrderRefused as error:
            self._tell(f"{name} is refused", str(error))
        except ValueError as error:
            self._tell(f"{name} is not a valid order", str(error))
