"""The flight's times on the clock of ROS."""

from __future__ import annotations

DRIFT = 1e-4
"""Largest relative drift of the two clocks, s/s; much more than that of real computers."""
JUMP = 1_000_000_000
"""If the difference of the clocks changes by this or more, ns, a clock was set; no message is so late."""


class FlightClock:
    """Converts times of the flight: its monotonic clock, on this computer or another, in s.

    A state arrives late, never early. The smallest difference between arrival and time is therefore closest
    to the difference of the clocks; the error is the shortest delay of a message. Stamps increase, unless the
    clock of ROS is set.
    """

    def __init__(self) -> None:
        self._offset: int | None = None
        self._time = 0.0
        self._last = 0

    def stamp(self, time: float, now: int) -> int:
        """The time of a state on the clock of ROS, ns. `now` is its arrival on that clock, ns."""
        seen = now - round(time * 1e9)
        if self._offset is None or abs(seen - self._offset) >= JUMP:
            self._offset, self._last = seen, 0
        else:
            self._offset = min(seen, self._offset + round(max(0.0, time - self._time) * DRIFT * 1e9))
        self._time = time
        self._last = max(round(time * 1e9) + self._offset, self._last + 1)
        return self._last
