"""Reads MCAP files and checks everything in them: complete files, cut files, damaged files.

The checks are those of `tilthex-rt replay`: every length and checksum is tested before any data is
returned.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

MAGIC = b"\x89MCAP0\r\n"
MAX_RECORD = 256 << 20
"""Largest record, bytes. A larger length is damaged."""
MAX_CHUNK = 64 << 20
"""Largest chunk after unpacking, bytes."""
MAX_RATIO = 50
"""All chunks together unpack to at most this many times the size of the file. Flights unpack to about 4
times."""
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = range(1, 7)
ATTACHMENT, METADATA, DATA_END = 9, 12, 15
KINDS = (
    "header",
    "footer",
    "schema",
    "channel",
    "message",
    "chunk",
    "message index",
    "chunk index",
    "attachment",
    "attachment index",
    "statistics",
    "metadata",
    "metadata index",
    "summary offset",
    "end of the data",
)
SHORT = "its fields do not fit into it"
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")


class Damaged(ValueError):
    """What is wrong with a record. The caller adds the place."""


@dataclass(frozen=True)
class Channel:
    """A channel of a log; `schema` as MCAP stores it: name, encoding, data."""

    topic: str
    encoding: str
    schema: tuple[str, str, bytes]


@dataclass
class Log:
    """The result of one pass over a file."""

    data: memoryview
    attachments: dict[str, bytes] = field(default_factory=dict)
    library: str = ""
    channels: dict[int, Channel] = field(default_factory=dict)
    times: tuple[int, int] | None = None
    """Log time of the first and of the last message, ns."""
    counts: dict[int, int] = field(default_factory=dict)
    """Number of messages of each channel."""
    cut: int | None = None
    """Number of bytes up to the last complete record of a file that was cut."""
    end: int = 0
    """Where the data section ends."""
    index_only: bool = False
    """All messages are there; only the index after them is missing."""
    schemas: dict[int, tuple[str, str, bytes]] = field(default_factory=dict)
    data_end: int | None = None
    unpacked: int = 0

    def messages(self, channels: Iterable[int]) -> Iterator[tuple[int, int, bytes]]:
        """Channel, log time (ns) and bytes of the messages of some channels, in the order of the file."""
        wanted = frozenset(channels)
        at = len(MAGIC)
        while at < self.end:
            kind, body = _record(self.data[: self.end], at)
            at += _HEAD.size + len(body)
            if kind == MESSAGE:
                yield from _of([body], wanted)
            elif kind == CHUNK:
                data = memoryview(_unpack(*_chunk(body)))
                yield from _of((inner for k, inner, _ in _records(data) if k == MESSAGE), wanted)

    def missing(self) -> str | None:
        """What is missing in a log that was cut, as a sentence; None for a complete log."""
        if self.cut is None:
            return None
        size = len(self.data)
        rest = size - self.cut
        left_out = f", and its last {rest} bytes are part of a record and are not read" if rest else ""
        if self.index_only:
            return f"the log breaks off in its index at byte {self.cut}: no message is missing{left_out}"
        first, last = self.times or (0, 0)
        return (
            f"the log breaks off {(last - first) * 1e-9:.3f} s after its first message, at byte {self.cut} "
            f"of {size}: the rest is missing (0.5 s at most if the program was killed){left_out}"
        )


class Fields:
    """The fields of a record, from its start."""

    def __init__(self, data: memoryview) -> None:
        self.data, self.at = data, 0

    def take(self, count: int) -> memoryview:
        """The next `count` bytes."""
        end = self.at + count
        if end > len(self.data):
            raise Damaged(SHORT)
        taken = self.data[self.at : end]
        self.at = end
        return taken

    def number(self, size: int) -> int:
        """The next number, of `size` bytes."""
        return int.from_bytes(self.take(size), "little")

    def text(self) -> str:
        """The next text, which follows its length."""
        try:
            return str(self.take(self.number(4)), "utf-8")
        except UnicodeDecodeError:
            raise Damaged("a name in it is not text") from None

    def rest(self) -> int:
        """Number of bytes that are left."""
        return len(self.data) - self.at


def read(path: str | Path) -> Log:
    """Goes through a file once.

    Raises:
        ValueError: It is not a file, not an MCAP file, or damaged. One sentence, with the place.
        OSError: It cannot be read.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        what = "a directory" if path.is_dir() else "a pipe" if path.is_fifo() else "a device"
        raise ValueError(f"{path} is {what}; expected a file")
    data = memoryview(path.read_bytes())
    log = Log(data)
    try:
        _scan(log, data)
    except Damaged as error:
        raise ValueError(f"{path} {error}") from None
    return log


def _scan(log: Log, data: memoryview) -> None:
    if bytes(data[: len(MAGIC)]) != MAGIC:
        if len(data) and MAGIC.startswith(bytes(data[: len(MAGIC)])):
            log.cut = 0
            return
        raise Damaged("is not an MCAP file: its first bytes are wrong")
    # A file with a correct end was not cut.
    whole = len(data) > len(MAGIC) and bytes(data[-len(MAGIC) :]) == MAGIC
    at = len(MAGIC)
    while True:
        rest = len(data) - at
        # After a power failure a file may end with zeros.
        if not whole and (rest < _HEAD.size or (data[at] == 0 and not any(data[at:]))):
            return _cut_at(log, at)
        name = "no record"
        try:
            if rest < _HEAD.size:
                raise Damaged("the file ends before the log")
            kind, length = _HEAD.unpack_from(data, at)
            if not 1 <= kind <= len(KINDS):
                raise Damaged(f"there is no record of kind {kind}")
            name = KINDS[kind - 1]
            if at == len(MAGIC) and kind != HEADER:
                raise Damaged("expected the header of the file")
            if length > rest - _HEAD.size:
                if whole or length > MAX_RECORD:
                    raise Damaged(f"its length of {length} bytes goes beyond the end of the file")
                return _cut_at(log, at)
            begin = at + _HEAD.size
            _take(log, kind, data[begin : begin + length], at)
        except Damaged as error:
            raise Damaged(f"is damaged at byte {at} ({name}): {error}") from None
        at = begin + length
        if kind == FOOTER:
            tail = bytes(data[at:])
            if tail == MAGIC:
                return None
            if len(tail) < len(MAGIC) and MAGIC.startswith(tail):
                return _cut_at(log, at)
            raise Damaged(
                f"is damaged at byte {at}: {len(tail)} bytes follow its footer; "
                "expected the 8 bytes that end an MCAP file"
            )


def _cut_at(log: Log, at: int) -> None:
    log.cut = at
    log.index_only = log.data_end is not None
    if not log.index_only:
        log.end = at


def _take(log: Log, kind: int, body: memoryview, at: int) -> None:
    fields = Fields(body)
    if log.data_end is not None and kind in (CHUNK, MESSAGE, ATTACHMENT, METADATA, DATA_END):
        raise Damaged("it is after the end of the data")
    if kind == HEADER:
        fields.text()
        log.library = fields.text()
    elif kind in (SCHEMA, CHANNEL):
        _declare(log, kind, body)
    elif kind == MESSAGE:
        _check_message(log, body)
    elif kind == CHUNK:
        size, compression, check_sum, packed = _chunk(body)
        log.unpacked += size
        if log.unpacked > MAX_RATIO * len(log.data):
            raise Damaged(f"the chunks unpack to more than {MAX_RATIO} times the file; a flight does not")
        unpacked = memoryview(_unpack(size, compression, check_sum, packed))
        place = 0
        try:
            for inner_kind, inner, place in _records(unpacked):  # noqa: B007  # noqa: B007
                if inner_kind == MESSAGE:
                    _check_message(log, inner)
                elif inner_kind in (SCHEMA, CHANNEL):
                    _declare(log, inner_kind, inner)
                else:
                    raise Damaged(f"a record of kind {inner_kind} does not belong there")
        except Damaged as error:
            raise Damaged(f"after byte {place} of its unpacked data, {error}") from None
    elif kind == ATTACHMENT:
        fields.take(16)
        name, _, data = fields.text(), fields.text(), fields.take(fields.number(8))
        check_sum = fields.number(4)
        if check_sum and check_sum != zlib.crc32(body[:-4]):
            raise Damaged("its checksum does not match")
        log.attachments[name] = bytes(data)
    elif kind == DATA_END:
        check_sum = fields.number(4)
        log.end, log.data_end = at, at + _HEAD.size + 4
        if check_sum and check_sum != zlib.crc32(log.data[:at]):
            raise Damaged(
                f"its checksum over the bytes from 0 to {at} does not match, though each chunk's does: "
                "a record between the chunks is changed"
            )
    elif kind == FOOTER:
        _check_footer(log, fields, at)


def _check_footer(log: Log, fields: Fields, at: int) -> None:
    begin = log.data_end
    if begin is None:
        raise Damaged("the end of the data does not come before it")
    summary = fields.number(8)
    fields.take(8)
    check_sum = fields.number(4)
    if summary not in (0, begin):
        raise Damaged(f"it says that the summary begins at byte {summary}; it begins at {begin}")
    if check_sum and check_sum != zlib.crc32(log.data[begin : at + _HEAD.size + 16]):
        raise Damaged(f"the checksum of the summary, from byte {begin} on, does not match")


def _declare(log: Log, kind: int, body: memoryview) -> None:
    fields = Fields(body)
    number = fields.number(2)
    if kind == SCHEMA:
        log.schemas[number] = fields.text(), fields.text(), bytes(fields.take(fields.number(4)))
        return
    schema = log.schemas.get(fields.number(2), ("", "", b""))
    log.channels[number] = Channel(fields.text(), fields.text(), schema)


def _check_message(log: Log, body: memoryview) -> None:
    if len(body) < _MESSAGE.size:
        raise Damaged("a message is shorter than its head")
    channel, _, time, _ = _MESSAGE.unpack_from(body)
    if channel not in log.channels:
        raise Damaged(f"a message is of channel {channel}, which is not declared")
    log.counts[channel] = log.counts.get(channel, 0) + 1
    first, last = log.times or (time, time)
    log.times = min(first, time), max(last, time)


def _chunk(body: memoryview) -> tuple[int, str, int, memoryview]:
    """Size, compression, checksum and packed records of a chunk."""
    fields = Fields(body)
    fields.take(16)
    size, check_sum, compression = fields.number(8), fields.number(4), fields.text()
    packed = fields.take(fields.number(8))
    if fields.rest():
        raise Damaged(SHORT)
    return size, compression, check_sum, packed


def _unpack(size: int, compression: str, check_sum: int, packed: memoryview) -> bytes:
    """Unpacks at most the declared number of bytes, and compares the checksum."""
    if size > MAX_CHUNK:
        raise Damaged(f"it announces {size} unpacked bytes; expected at most {MAX_CHUNK}")
    if compression == "":
        unpacked = bytes(packed)
    elif compression == "lz4":
        unpacked = _lz4(packed, size)
    elif compression == "zstd":
        unpacked = _zstd(packed, size)
    else:
        raise Damaged(f'it is compressed with "{compression}"; expected lz4 or zstd')
    if len(unpacked) != size:
        more = "more" if len(unpacked) > size else "fewer"
        raise Damaged(f"it unpacks to {more} than the {size} bytes that it announces")
    # A checksum of 0 means that there is none.
    if check_sum and check_sum != zlib.crc32(unpacked):
        raise Damaged("its checksum does not match")
    return unpacked


def _lz4(packed: memoryview, size: int) -> bytes:
    import lz4.frame

    try:
        found: bytes = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1)
    except RuntimeError as error:
        raise Damaged(f"it cannot be unpacked (lz4 {error})") from None
    return found


def _zstd(packed: memoryview, size: int) -> bytes:
    import zstandard

    try:
        with zstandard.ZstdDecompressor().stream_reader(io.BytesIO(packed)) as stream:
            found: bytes = stream.read(size + 1)
    except zstandard.ZstdError as error:
        raise Damaged(f"it cannot be unpacked (zstd {error})") from None
    return found


def _record(data: memoryview, at: int) -> tuple[int, memoryview]:
    if len(data) - at < _HEAD.size:
        raise Damaged("a record does not end")
    kind, length = _HEAD.unpack_from(data, at)
    begin = at + _HEAD.size
    if length > len(data) - begin:
        raise Damaged("a record does not end")
    return kind, data[begin : begin + length]


def _records(data: memoryview) -> Iterator[tuple[int, memoryview, int]]:
    """Kind, body and place of the records in a chunk."""
    at = 0
    while at < len(data):
        kind, body = _record(data, at)
        yield kind, body, at
        at += _HEAD.size + len(body)


def _of(messages: Iterable[memoryview], wanted: frozenset[int]) -> Iterator[tuple[int, int, bytes]]:
    for body in messages:
        channel, _, time, _ = _MESSAGE.unpack_from(body)
        if channel in wanted:
            yield channel, time, bytes(body[_MESSAGE.size :])
