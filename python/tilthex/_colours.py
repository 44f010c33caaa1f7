"""Colours on a terminal; none in a file or a pipe, or if `NO_COLOR` is set (no-color.org)."""

from __future__ import annotations

import os
from typing import TextIO

RED, GREEN, YELLOW = 31, 32, 33


def coloured(text: str, colour: int, stream: TextIO) -> str:
    """A text in a colour if the stream to which it is printed is a terminal."""
    if not stream.isatty() or os.environ.get("NO_COLOR"):
        return text
    return f"\x1b[{colour}m{text}\x1b[0m"
