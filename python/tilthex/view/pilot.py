"""The connection to a running flight: its states as they come, and the orders of the page."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable

from tilthex.client import Flight, OrderRefused
from tilthex.view.sample import Sample, from_state

RATE = 20.0
"""States per second."""
AGAIN = 1.0
"""Time between two attempts to connect, s."""
Order = Callable[[Flight], object]
Connect = Callable[[Callable[[], bool] | None], Flight]
"""Makes a connection. Its argument says whether the operator is present; None: always."""


class Pilot:
    """Two connections: one for states and orders, which holds the controls, and one for `land` and `kill`.

    Attributes:
        newest: The newest sample, None before the first.
        arrived: Its time of arrival on `time.monotonic`.
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
        self._orders: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._waiting: dict[str, Order] = {}
        self._lock = threading.Lock()
        self._brake: Flight | None = None
        self._brake_lock = threading.Lock()
        self._ended = threading.Event()
        self._flight: Flight | None = connect(present)
        self.newest: Sample | None = None
        self.arrived = time.monotonic()
        self._thread = threading.Thread(target=self._run, name="tilthex-pilot", daemon=True)

    def start(self) -> None:
        """Starts to take states and to give orders."""
        self._thread.start()

    def order(self, name: str, order: Order) -> None:
        """Gives an order after the next state. It replaces a waiting order of the same name."""
        with self._lock:
            waits = name in self._waiting
            self._waiting[name] = order
        if not waits:
            self._orders.put(name)

    def urgent(self, name: str, order: Order) -> None:
        """Gives `land` or `kill` at once, before all waiting orders. Connects again if necessary."""
        with self._brake_lock:
            try:
                self._press(order)
            except OrderRefused as error:
                self._tell(f"{name} is refused", str(error))
            except (OSError, ValueError) as error:
                self._tell(f"{name} does not reach the flight", str(error))

    def close(self) -> None:
        """Ends both connections; a flight that was ordered to move holds, and lands later."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join(5.0)
        with self._brake_lock:
            if self._brake is not None:
                self._brake.close()

    def _press(self, order: Order) -> None:
        if self._brake is not None:
            try:
                order(self._brake)
                return
            except OrderRefused:
                raise
            except (OSError, ValueError):
                self._brake.close()
        self._brake = self._connect(None)
        order(self._brake)

    def _run(self) -> None:
        flight, self._flight = self._flight, None
        while not self._ended.is_set():
            try:
                if flight is None:
                    flight = self._connect(self._present)
                with flight:
                    self._fly(flight)
                if not self._ended.is_set():
                    self._tell("the flight has ended", "The page connects again when one begins.")
            except (OSError, ValueError) as error:
                # A flight that has not started yet needs no message.
                if flight is not None:
                    self._tell("the flight is gone", str(error))
            flight = None
            self._ended.wait(AGAIN)

    def _fly(self, flight: Flight) -> None:
        with self._brake_lock:
            if self._brake is None:
                self._brake = self._connect(None)
        for state in flight.states(rate=RATE):
            self.newest, self.arrived = from_state(state), time.monotonic()
            while not self._orders.empty():
                self._give(flight, self._orders.get())
            if self._ended.is_set():
                return

    def _give(self, flight: Flight, name: str) -> None:
        with self._lock:
            order = self._waiting.pop(name)
        try:
            order(flight)
        except ConnectionError:
            raise
        except OrderRefused as error:
            self._tell(f"{name} is refused", str(error))
        except ValueError as error:
            self._tell(f"{name} is no order", str(error))
