"""Reads the logs of `tilthex-rt` (MCAP) as arrays.

    from tilthex import log

    topics = log.read("flight.mcap", ["/state", "/flight"])
    position = topics["/state"]["position_w"]  # (N, 3), m
    aloft = log.flying(topics["/flight"]["phase"])  # (N,), bool

A log that breaks off, as after `kill -9`, is read up to its last record, and `LogCut` warns of what is
missing. A damaged log is refused, and the message names the place of the damage.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tilthex import _mcap
from tilthex._logged import TOPICS

Columns = dict[str, NDArray[Any]]

GROUNDED = ("disarmed", "starting", "grounded")
"""Phases with the vehicle on the ground. The other phases are flying, holding, landing and emergency."""
STILL = 1e-6
"""A set-point that changes by less than this from tick to tick rests, m."""
FREE_FLIGHT = ("flying", "holding")
"""Phases in which only the tool can touch anything; in a landing the vehicle may touch the ground."""


class NotALog(ValueError):
    """A correct MCAP file that another program has written."""


class LogCut(UserWarning):
    """A log that breaks off; the text says what is missing."""


def read(path: str | Path, topics: Iterable[str]) -> dict[str, Columns]:
    """The messages of some topics as columns.

    The columns of a topic are named by the path of the field in the message, with a point between names:
    `position_w` (N, 3), `tool_w.force` (N, 3), `command` (N, n). `log_time` (N,) is the time of the tick,
    s since 1970. Quaternions are (x, y, z, w). `phase` and `given_up` are names. docs/log.md lists all
    topics and fields.

    Raises:
        ValueError: The file is not a log of tilthex-rt, is damaged (with the place), or lacks a topic.

    Warns:
        LogCut: The log breaks off; everything up to there is read.
    """
    log = Log(path)
    return {topic: log.columns(topic) for topic in topics}


def configuration(path: str | Path) -> str:
    """The effective configuration, TOML, that is attached to a log.

    Raises:
        ValueError: The log has none.
    """
    return Log(path).configuration


def flying(phase: NDArray[Any]) -> NDArray[np.bool_]:
    """Where the vehicle is off the ground: flying, holding, landing or emergency."""
    return ~np.isin(phase, GROUNDED)


def learning_ends(flight: Log, bias_time: float) -> float:
    """The log time, s, at which the bias or the model has been learnt; that of take-off if none is learnt.

    A calibration flight ends with the first learnt model, the hover for the bias after `bias_time` with a
    still set-point in flight.
    """
    phases, target, model = (flight.columns(topic) for topic in ("/flight", "/setpoint", "/model"))
    count = min(len(topic["log_time"]) for topic in (phases, target, model))
    time = phases["log_time"][:count]
    aloft = np.isin(phases["phase"][:count], FREE_FLIGHT)
    if not aloft.any():
        raise ValueError(f"{flight.path}: the vehicle does not fly in this log; expected a flight")
    taught = aloft & (model["hovers"][:count] > 0)
    if taught.any():
        return float(time[taught][0])
    if bias_time <= 0.0:
        return float(time[aloft][0])
    steps = abs(np.diff(target["position_w"][:count], axis=0, prepend=np.inf))
    moved = steps.max(axis=1) > STILL
    since = time - np.maximum.accumulate(np.where(moved | ~aloft, time, -np.inf))
    ends = aloft & (since >= bias_time)
    return float(time[ends][0]) if ends.any() else float(time[aloft][0])


class Log:
    """A log that was checked.

    Attributes: path: The file. configuration: Its effective configuration, TOML. missing: What is missing in
    a log that breaks off, as a sentence; None for a complete log.
    """

    def __init__(self, path: str | Path) -> None:
        try:
            import mcap_protobuf.decoder  # noqa: F401
        except ImportError as error:
            raise ImportError(
                f"reading a log needs {error.name}, which is not installed: pip install 'tilthex[analysis]'"
            ) from error
        self.path = path
        self._log = _mcap.read(path)
        self._decoders: dict[int, Callable[[bytes], Any]] = {}
        self.missing = self._log.missing()
        attached = self._log.attachments.get("config.toml")
        if attached is None:
            if self.missing and self._log.times is None:
                size = len(self._log.data)
                raise ValueError(
                    f"{path} breaks off after {size} bytes, before the configuration at the start of a log: "
                    "nothing can be read"
                )
            raise NotALog(
                f"{path} is an MCAP file, written by {self._log.library!r}, but not a log of tilthex-rt: "
                "no configuration (config.toml) is attached"
            )
        self.configuration = attached.decode(errors="replace")
        if self.missing:
            warnings.warn(f"{path}: {self.missing}", LogCut, stacklevel=3)

    @property
    def topics(self) -> dict[str, int]:
        """Topics that hold messages, and how many."""
        counts: dict[str, int] = {}
        for number, count in self._log.counts.items():
            topic = self._log.channels[number].topic
            counts[topic] = counts.get(topic, 0) + count
        return counts

    def messages(self, topic: str) -> Iterator[tuple[float, Any]]:
        """Log time, s, and message, of all messages of a topic, in the order of the file."""
        from google.protobuf.message import DecodeError

        try:
            for number, time, data in self._log.messages(self._channels(topic)):
                yield time * 1e-9, self._decoders[number](data)
        except DecodeError as error:
            raise ValueError(f"{self.path}: a message of {topic} cannot be read: {error}") from error

    @property
    def attachments(self) -> dict[str, bytes]:
        """The attached files, by their names."""
        return self._log.attachments

    @property
    def channels(self) -> dict[int, tuple[str, str, tuple[str, str, bytes]]]:
        """Topic, encoding and schema (name, encoding, data) of each channel, as MCAP stores them."""
        return {
            number: (channel.topic, channel.encoding, channel.schema)
            for number, channel in self._log.channels.items()
        }

    def raw(self) -> Iterator[tuple[int, int, bytes]]:
        """Log time, ns, channel and bytes of every message, in the order of the file."""
        for number, time, data in self._log.messages(self._log.channels):
            yield time, number, data

    def columns(self, topic: str) -> Columns:
        """The messages of a topic as columns, see `read`."""
        times, messages = [], []
        for time, message in self.messages(topic):
            times.append(time)
            messages.append(message)
        if not messages:
            raise ValueError(f"{self.path} holds no messages of {topic}; expected a log of tilthex-rt")
        return {"log_time": np.array(times), **_columns(messages)}

    def _channels(self, topic: str) -> list[int]:
        """The channels of a topic, and a decoder for each."""
        numbers = [number for number, channel in self._log.channels.items() if channel.topic == topic]
        for number in numbers:
            if number not in self._decoders:
                self._decoders[number] = self._decoder(number)
        return numbers

    def _decoder(self, number: int) -> Callable[[bytes], Any]:
        from mcap.records import Schema
        from mcap_protobuf.decoder import DecoderFactory

        channel = self._log.channels[number]
        name, encoding, data = channel.schema
        expected = "tilthex." + TOPICS.get(channel.topic, "")
        found = None
        if name == expected:
            schema = Schema(id=1, name=name, encoding=encoding, data=data)
            try:
                found = DecoderFactory().decoder_for(channel.encoding, schema)
            except Exception as error:
                raise ValueError(f"{self.path}: the schema of {channel.topic} is damaged: {error}") from error
        if found is None:
            raise ValueError(
                f"{self.path} is not a log of tilthex-rt: {channel.topic} holds messages of {name!r} "
                f"({channel.encoding}); expected {expected} (protobuf)"
            )
        decoder: Callable[[bytes], Any] = found
        return decoder


def _columns(messages: list[Any]) -> Columns:
    """Makes the columns field by field. The type of the message says once how to read each field."""
    columns: Columns = {}
    for name, paths, names in _fields("", messages[0].DESCRIPTOR):
        get: Callable[[Any], Any] = attrgetter(*paths)
        rows: list[Any] = [get(message) for message in messages]
        if names is not None:
            columns[name] = np.array([names.get(row, str(row)) for row in rows])
        elif hasattr(rows[0], "append"):
            columns[name] = np.array([list(row) for row in rows], dtype=float)
        else:
            columns[name] = np.array(rows, dtype=float)
    return columns


def _fields(prefix: str, descriptor: Any) -> Iterator[tuple[str, list[str], dict[int, str] | None]]:
    """Name, paths and, for an enumeration, the value names, of all numbers of a message and lists of numbers.

    Messages of x, y, z(, w) become one column with several paths; other messages are entered recursively.
    """
    for field in descriptor.fields:
        name = prefix + field.name
        if field.enum_type is not None:
            values = field.enum_type.values
            # PHASE_FLYING is "flying", PART_YAW_TORQUE is "yaw-torque".
            texts = {v.number: v.name.partition("_")[2].lower().replace("_", "-") for v in values}
            yield name, [name], texts
        elif field.message_type is None:
            if field.type not in (field.TYPE_STRING, field.TYPE_BYTES):
                yield name, [name], None
        elif all(part.name in "xyzw" for part in field.message_type.fields):
            yield name, [f"{name}.{part.name}" for part in field.message_type.fields], None
        elif not _repeated(field):
            yield from _fields(f"{name}.", field.message_type)


def _repeated(field: Any) -> bool:
    """Whether a field is a list; versions of protobuf say this in two ways."""
    known = getattr(field, "is_repeated", None)
    return bool(field.label == field.LABEL_REPEATED if known is None else known)
