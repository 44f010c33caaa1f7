"""Whether somebody looks at the page: the operator whom the flight must hear of."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import viser

ASK = 0.3
"""Time between two questions to a page, s."""
ALIVE = 1.5
"""A page that has answered within this time is seen by its operator, s."""
KEY = "tilthex-present"


class Presence:
    """Asks every open page again and again; a page answers between two of its pictures.

    A browser draws no pictures of a page that is hidden, so a hidden page does not answer: who has switched
    to another tab does not look at the flight. A page whose network or computer is gone does not either.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._answered = -float("inf")
        self._ended = threading.Event()

        @server.on_client_connect
        def _(client: viser.ClientHandle) -> None:
            threading.Thread(target=self._ask, args=(client,), name="tilthex-presence", daemon=True).start()

    def __call__(self) -> bool:
        """Whether a page has answered lately."""
        return time.monotonic() - self._answered < ALIVE

    def close(self) -> None:
        """Asks no more."""
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
                # Where it has not left, its browser keeps nothing, which is an answer too.
                if "disconnected" in str(error):
                    return
            self._answered = time.monotonic()
