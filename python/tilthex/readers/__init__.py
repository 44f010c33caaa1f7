"""Recordings of other programs, read into named columns: tables, MAT files, MCAP, ROS 2 bags, logs of PX4."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tilthex.readers import messages, table, ulog
from tilthex.readers.columns import Stream

READERS: dict[str, Callable[[Path], list[Stream]]] = {
    ".csv": table.read_csv,
    ".mat": table.read_mat,
    ".mcap": messages.read_mcap,
    ".ulg": ulog.read,
    ".db3": messages.read_bag,
    "": messages.read_bag,
}
"""The reader for each ending of a file name. A ROS 2 bag is a folder."""


def read(path: Path) -> list[Stream]:
    """The streams of a file.

    Raises:
        ValueError: The file is of another kind, is damaged, or has an unknown unit.
        OSError: It cannot be read.
    """
    reader = READERS.get(path.suffix.lower() if path.is_file() else "")
    if reader is None or not path.exists():
        if not path.exists():
            raise FileNotFoundError(f"{path} does not exist")
        raise ValueError(
            f"{path} ends in '{path.suffix}'; expected a log (.mcap), a table (.csv, .mat), a log of PX4 "
            "(.ulg) or the folder of a ROS 2 bag"
        )
    return reader(path)


__all__ = ["READERS", "Stream", "read"]
