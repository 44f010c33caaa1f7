"""Reads the logs of `tilthex-rt` (MCAP) as arrays."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Columns = dict[str, Vector]


def read(path: str | Path, topics: Iterable[str]) -> dict[str, Columns]:
    """The messages of some topics as columns.

    Each topic's columns are named by the path of the field in the message, with
    a point between names: `position_w` (N, 3), `tool_w.force` (N, 3), `command`
    (N, n). `log_time` (N,) is when the message was logged, s. Quaternions are (x, y, z, w).

    Raises:
        ValueError: The file is no finished MCAP log, or lacks a topic.
    """
    wanted = list(topics)
    rows: dict[str, list[tuple[float, Any]]] = {topic: [] for topic in wanted}
    with opened(path) as reader:
        for _, channel, message, decoded in reader.iter_decoded_messages(topics=wanted):
            rows[channel.topic].append((message.log_time * 1e-9, decoded))
    for topic, messages in rows.items():
        if not messages:
            raise ValueError(f"{path} holds no messages of {topic}; expected a log of tilthex-rt")
    return {topic: _columns(messages) for topic, messages in rows.items()}


def configuration(path: str | Path) -> str:
    """The effective configuration, TOML, that is attached to a log.

    Raises:
        ValueError: There is none.
    """
    with opened(path) as reader:
        for attachment in reader.iter_attachments():
            if attachment.name == "config.toml":
                text: str = attachment.data.decode()
                return text
    raise ValueError(f"{path} has no configuration attached; expected a log of tilthex-rt")


def flying(phase: Vector) -> NDArray[np.bool_]:
    """Where the vehicle is off the ground: flying, holding, landing or in an emergency."""
    return phase >= 3


@contextmanager
def opened(path: str | Path) -> Iterator[Any]:
    """The reader of an MCAP log, its protobuf messages decoded."""
    try:
        from mcap.exceptions import McapError
        from mcap.reader import make_reader
        from mcap_protobuf.decoder import DecoderFactory
    except ImportError as error:
        raise ImportError(
            f"reading a log needs {error.name}, which is not installed: pip install 'tilthex[analysis]'"
        ) from error
    with Path(path).open("rb") as stream:
        try:
            yield make_reader(stream, decoder_factories=[DecoderFactory()])
        except (McapError, struct.error) as error:
            raise ValueError(f"{path} is no whole MCAP log ({type(error).__name__})") from error


def _columns(messages: list[tuple[float, Any]]) -> Columns:
    columns = {"log_time": np.array([time for time, _ in messages])}
    flat = [dict(_fields("", message)) for _, message in messages]
    for name in flat[0]:
        columns[name] = np.array([row[name] for row in flat], dtype=float)
    return columns


def _fields(prefix: str, message: Any) -> Iterable[tuple[str, Any]]:
    """Numbers and lists of them; messages of x, y, z(, w) as lists, others field by field."""
    for field in message.DESCRIPTOR.fields:
        value = getattr(message, field.name)
        name = prefix + field.name
        if field.message_type is None:
            if field.type not in (field.TYPE_STRING, field.TYPE_BYTES):
                yield name, value if isinstance(value, (int, float)) else list(value)
        elif all(part.name in "xyzw" for part in field.message_type.fields):
            yield name, [getattr(value, part.name) for part in field.message_type.fields]
        else:
            yield from _fields(f"{name}.", value)
