"""Finds out whether the operator looks at the page. The flight must know this."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import viser

ASK = 0.3
"""Time between two questions to a page, s."""
ALIVE = 1.5
"""The operator is present if a page has answered within this time, s."""
KEY = "tilthex-present"


class Presence:
    """Asks every open page repeatedly. A page answers between two pictures that it draws.

    A browser draws no pictures of a hidden page, so that a hidden page does not answer: an operator who
    has changed to another tab does not see the flight. A page without network or computer does not answer
    either.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._answered = -float("inf")
        self._ended = threading.Event()

        @server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            threading.Thread(target=self._ask, args=(client,), name="tilthex-presence", daemon=True).start()

    def __call__(self) -> bool:
        """Whether a page has answered recently."""
        return time.monotonic() - self._answered < ALIVE

    def close(self) -> None:
        """Stops asking."""
        self._ended.set()

    def _ask(self, client: viser.ClientHandle) -> None:
        while not self._ended.wait(ASK):
            if client.client_id not in self._server.get_clients():
                return
            try:
                client.local_storage.get_item(KEY, timeout=ALIVE)
            except TimeoutError:
                continue
            except RuntimeError as error:
                # A page that is still open has answered, although its browser has no stored value.
                if "disconnected" in str(error):
                    return
            self._answered = time.monotonic()
