"""The connection of one urgent order."""

from __future__ import annotations

import threading
from collections.abc import Callable

from tilthex.client import Flight, OrderRefused

Order = Callable[[Flight], object]
Connect = Callable[..., Flight]
"""Makes a connection. Its argument `present` says whether the operator is present; without it: always."""


class Brake:
    """Gives one order, `land` or `kill`, which waits for no other order."""

    def __init__(self, name: str, order: Order, connect: Connect, tell: Callable[[str, str], None]) -> None:
        """Makes no connection yet.

        Args:
            name: Name of the order in messages.
            order: Gives the order.
            connect: Makes a connection.
            tell: Called with a title and a sentence if the order is refused or does not reach the flight.
        """
        self._name, self._order, self._connect, self._tell = name, order, connect, tell
        self._flight: Flight | None = None
        self._lock = threading.Lock()

    def prepare(self) -> None:
        """Connects, if it never did.

        Raises:
            ConnectionError: No flight takes orders there.
        """
        with self._lock:
            if self._flight is None:
                self._flight = self._connect()

    def press(self) -> None:
        """Gives the order at once. Connects again if necessary."""
        with self._lock:
            try:
                self._press()
            except OrderRefused as error:
                self._tell(f"{self._name} is refused", str(error))
            except (OSError, ValueError) as error:
                self._tell(f"{self._name} does not reach the flight", str(error))

    def close(self) -> None:
        """Ends the connection."""
        with self._lock:
            if self._flight is not None:
                self._flight.close()

    def _press(self) -> None:
        if self._flight is not None:
            try:
                self._order(self._flight)
                return
            except OrderRefused:
                raise
            except (OSError, ValueError):
                self._flight.close()
        self._flight = self._connect()
        self._order(self._flight)
