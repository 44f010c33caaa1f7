"""Whether the bridge works: the operator of a flight is present while the node's executor runs."""

from __future__ import annotations

import time
from collections.abc import Callable

from tilthex.client import HEARTBEAT

STOPPED = 3 * HEARTBEAT
"""An executor hangs if it has not run for this time, s."""


class Pulse:
    """The beats of an executor. A call says whether the last beat is recent.

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
        """Whether the executor runs."""
        return self._now() - self._last < STOPPED
