"""Messages of other programs: MCAP files (JSON, protobuf, ROS 2) and ROS 2 bags."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from tilthex import _mcap
from tilthex.readers.columns import Stream

LARGEST_ARRAY = 64
"""A longer list in a message does not hold measurements of one moment."""
STAMPS = ("header.stamp", "timestamp", "stamp")
"""Names of the time that a message carries."""


def read_mcap(path: Path) -> list[Stream]:
    """Each topic of an MCAP file whose messages are JSON, protobuf or ROS 2 (cdr).

    Raises:
        ValueError: The file is damaged, or none of its topics can be read.
    """
    log = _mcap.read(path)
    streams, unread = [], []
    for number, channel in log.channels.items():
        decode = _decoder(path, channel)
        if decode is None:
            unread.append(f"{channel.topic} ({channel.encoding} {channel.schema[0]})")
            continue
        messages = ((time, decode(data)) for _, time, data in log.messages([number]))
        streams += _streams(f"{path}, {channel.topic}", messages)
    if not streams:
        what = ", ".join(unread) if unread else "no topic at all"
        raise ValueError(
            f"{path} is not a log of tilthex-rt, and holds {what}; "
            "expected messages in JSON, protobuf or ROS 2's cdr"
        )
    return streams


def read_bag(path: Path) -> list[Stream]:
    """Each topic of a ROS 2 bag: its folder, or one of its files.

    Raises:
        ValueError: It is not a bag.
    """
    if path.is_file():
        path = path.parent
    if not (path / "metadata.yaml").exists():
        raise ValueError(f"{path} is not a ROS 2 bag: it holds no metadata.yaml")
    rosbags = _rosbags()
    with _said(path), rosbags.AnyReader([path], default_typestore=ros_types()) as reader:
        streams = []
        for connection in reader.connections:
            messages = (
                (time, _fields(reader.deserialize(data, connection.msgtype)))
                for _, time, data in reader.messages([connection])
            )
            streams += _streams(f"{path}, {connection.topic}", messages)
        return streams


def _rosbags() -> Any:
    try:
        from rosbags import highlevel
    except ImportError as error:
        raise ImportError("messages of ROS 2 need rosbags: pip install 'tilthex[logs]'") from error
    return highlevel


def ros_types() -> Any:
    """The messages of ROS 2.

    Raises:
        ImportError: rosbags is not installed.
    """
    _rosbags()
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


class _said:
    """Turns errors of rosbags into one sentence."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, error: BaseException | None, _: Any) -> None:
        if error is not None and type(error).__module__.startswith("rosbags"):
            raise ValueError(f"{self._path} cannot be read as a ROS 2 bag: {error}") from error


def _decoder(path: Path, channel: _mcap.Channel) -> Callable[[bytes], Any] | None:
    """The function that turns the bytes of a channel's messages into nested fields."""
    name, encoding, data = channel.schema
    if channel.encoding == "json":
        return json.loads
    if channel.encoding == "protobuf" and encoding == "protobuf":
        from mcap.records import Schema
        from mcap_protobuf.decoder import DecoderFactory

        found = DecoderFactory().decoder_for(
            "protobuf", Schema(id=1, name=name, encoding=encoding, data=data)
        )
        return found and (lambda message: _fields(found(message)))
    if channel.encoding == "cdr":
        store = ros_types()
        if name in store.types:
            return lambda message: _fields(store.deserialize_cdr(message, name))
    return None


def _fields(message: Any) -> Any:
    """A message as nested dictionaries and lists."""
    if hasattr(message, "DESCRIPTOR"):
        return {field.name: _fields(getattr(message, field.name)) for field in message.DESCRIPTOR.fields}
    if hasattr(message, "__dataclass_fields__"):
        return {
            name: _fields(getattr(message, name))
            for name in message.__dataclass_fields__
            if name != "__msgtype__"
        }
    if isinstance(message, np.ndarray):
        return message.tolist()
    if isinstance(message, Sequence) and not isinstance(message, str | bytes):
        return [_fields(each) for each in message]
    return message


def _transforms(message: Any) -> list[Any]:
    """The transforms of a message that holds nothing else."""
    alone = isinstance(message, Mapping) and set(message) == {"transforms"}
    found = message["transforms"] if alone else None
    if not isinstance(found, list):
        return []
    named = all(isinstance(one, Mapping) and "child_frame_id" in one for one in found)
    return found if named else []


def _streams(place: str, messages: Iterable[tuple[int, Any]]) -> list[Stream]:
    """The stream of a topic; of transforms (`/tf`) one for each child frame, with its name at the end."""
    rest = iter(messages)
    first = next(rest, None)
    if first is None or not _transforms(first[1]):
        return [_stream(place, rest if first is None else chain([first], rest))]
    frames: dict[str, list[tuple[int, Any]]] = {}
    for time, message in chain([first], rest):
        for one in _transforms(message):
            frames.setdefault(one["child_frame_id"], []).append((time, one))
    return [_stream(f"{place}/{frame}", found) for frame, found in frames.items()]


def _stream(place: str, messages: Iterable[tuple[int, Any]]) -> Stream:
    """The numbers of messages as columns, named by their path with points between names.

    The time is the stamp of the message, if it has one. Then `arrival` is the time at which it was
    logged, if both are of the same clock.
    """
    logged: list[float] = []
    rows: list[dict[str, float]] = []
    for time, message in messages:
        logged.append(time * 1e-9)
        rows.append(dict(_numbers("", message)))
    names = list(dict.fromkeys(name for row in rows for name in row))
    columns = {name: np.array([row.get(name, np.nan) for row in rows]) for name in names}
    arrival = np.array(logged)
    stamps = [name for name in names if name in STAMPS]
    if stamps and np.all(columns[stamps[0]] > 0.0):
        taken = columns.pop(stamps[0])
        columns["time"] = taken
        late = arrival - taken
        if len(late) and np.min(late) >= 0.0 and np.max(late) < 1.0:
            columns["arrival"] = arrival
    elif "time" not in columns and "t" not in columns:
        columns["time"] = arrival
    return Stream(place, columns, ("message", 1))


def _numbers(path: str, value: Any) -> Iterator[tuple[str, float]]:
    """Name and value of each number. A time of two parts becomes one number, s."""
    if isinstance(value, Mapping):
        whole = next((value[name] for name in ("sec", "seconds", "secs") if name in value), None)
        part = next((value[name] for name in ("nanosec", "nsec", "nanos", "nsecs") if name in value), None)
        if whole is not None and part is not None:
            yield path, float(whole) + 1e-9 * float(part)
            return
        for name, inner in value.items():
            yield from _numbers(f"{path}.{name}" if path else name, inner)
    elif isinstance(value, bool | int | float):
        yield path, float(value)
    elif isinstance(value, Sequence) and not isinstance(value, str | bytes) and len(value) <= LARGEST_ARRAY:
        axes = "xyz" if len(value) == 3 else [str(k) for k in range(len(value))]
        for axis, inner in zip(axes, value, strict=True):
            yield from _numbers(f"{path}.{axis}", inner)
