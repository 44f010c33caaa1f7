"""Whether the bridge lives: the operator of a flight is there while the node's executor turns."""

from __future__ import annotations

import time
from collections.abc import Callable

from tilthex.client import HEARTBEAT

STOPPED = 3 * HEARTBEAT
"""An executor that has not turned for this long hangs, s."""


class Pulse:
    """The beats of an executor; called, it says whether the last one is recent.

    Args:
        now: A clock in s.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._last = now()

    def beat(self) -> None:
        """A timer of the executor calls this every `HEARTBEAT`."""
        self._last = self._now()

    def __call__(self) -> bool:
        """Whether the executor turns."""
        return self._now() - self._last < STOPPED
