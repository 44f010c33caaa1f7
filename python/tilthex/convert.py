"""`tilthex convert`: a log in the formats of other programs (docs/log.md).

`csv` and `parquet` have one file for each topic of the log, with the columns of `tilthex.log.read`. A column
of several numbers becomes one column for each number: `position_w.0`, `position_w.1`, `position_w.2`.
`rosbag2` has the flight in the standard messages of ROS 2, with the axes of REP 103 (world z up, robot x
forward and y left) and the frames of REP 105. `foxglove` has the log with poses and a scene beside its own
channels, and a layout that shows them; `rerun` has the flight as a recording of Rerun.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from tilthex import _foxglove, _rerun
from tilthex._logged import TOPICS
from tilthex.log import Columns, Log
from tilthex.readers.messages import ros_types
from tilthex.ros2.messages import RosMessages

Array = NDArray[Any]


def add_parser(subparsers: Any) -> None:
    """Registers the command with the parsers of `tilthex`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "convert",
        help="write a log for other programs: CSV, Parquet, Foxglove, Rerun or a bag of ROS 2",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("log", type=Path, help="a log of tilthex-rt")
    parser.add_argument("--to", required=True, choices=sorted(WRITERS), help="format")
    parser.add_argument("--out", type=Path, help="folder to write; default: the log's name and the format")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Converts a log, and prints the name of the result."""
    out = arguments.out or arguments.log.with_name(f"{arguments.log.stem}-{arguments.to}")
    convert(arguments.log, arguments.to, out)
    print(f"written: {out}")


def convert(path: str | Path, to: str, out: str | Path) -> None:
    """Writes a log in another format, into a new folder.

    Args:
        path: A log of tilthex-rt. A log that breaks off is converted up to its last record.
        to: "csv", "foxglove", "parquet", "rerun" or "rosbag2".
        out: The folder; it must not exist.

    Raises:
        ValueError: The log cannot be read, or the format is not known.
        FileExistsError: The folder exists.
    """
    writer = WRITERS.get(to)
    if writer is None:
        raise ValueError(f"a log cannot be converted to {to!r}; expected one of {', '.join(sorted(WRITERS))}")
    log, out = Log(path), Path(out)
    if out.exists():
        raise FileExistsError(f"{out} exists; remove it, or name another folder with --out")
    writer(log, out)


def flat(columns: Columns) -> dict[str, Array]:
    """Columns of single numbers: (N,) each."""
    single: dict[str, Array] = {}
    for name, values in columns.items():
        if values.ndim == 1:
            single[name] = values
        else:
            single |= {f"{name}.{i}": column for i, column in enumerate(values.T)}
    return single


def _tables(log: Log) -> Iterator[tuple[str, Any]]:
    import pandas

    for topic in log.topics:
        if topic in TOPICS:
            yield topic.lstrip("/"), pandas.DataFrame(flat(log.columns(topic)))


def _csv(log: Log, out: Path) -> None:
    out.mkdir(parents=True)
    for name, table in _tables(log):
        table.to_csv(out / f"{name}.csv", index=False)


def _parquet(log: Log, out: Path) -> None:
    import pyarrow  # noqa: F401

    out.mkdir(parents=True)
    for name, table in _tables(log):
        table.to_parquet(out / f"{name}.parquet", engine="pyarrow", index=False)


def _rosbag2(log: Log, out: Path) -> None:
    store = ros_types()
    from rosbags.rosbag2 import Writer

    out.parent.mkdir(parents=True, exist_ok=True)
    with Writer(out, version=9) as bag:
        messages = RosMessages(store.types)
        for topic, kind, source, make in messages.topics():
            if source not in log.topics:
                continue
            columns = log.columns(source)
            connection = bag.add_connection("/" + topic.lstrip("/"), kind, typestore=store)
            for row, stamp in enumerate(columns["log_time"]):
                time = round(float(stamp) * 1e9)
                message = make(time, {name: values[row] for name, values in columns.items()})
                bag.write(connection, time, store.serialize_cdr(message, kind))


WRITERS: dict[str, Callable[[Log, Path], None]] = {
    "csv": _csv,
    "foxglove": _foxglove.write,
    "parquet": _parquet,
    "rerun": _rerun.write,
    "rosbag2": _rosbag2,
}
"""The function that writes each format."""
