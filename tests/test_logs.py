"""Logs that were cut, damaged, packed otherwise, or never were logs of a flight, under every command."""

import io
import os
import random
import struct
import zlib
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.stream_reader import StreamReader
from mcap.well_known import MessageEncoding
from mcap.writer import CompressionType, Writer
from test_programs import run
from tilthex import __main__ as command
from tilthex import _mcap, log
from tilthex.recording import Recording

pytestmark = pytest.mark.real_time

COMMANDS = (["plot"], ["fit"], ["estimate"])


def cut_short(path, data, part):
    path.write_bytes(data[: int(part * len(data))])
    return path


def sentence(capsys, arguments, status=2):
    """The one line of a command's refusal."""
    assert command.main([str(a) for a in arguments]) == status
    error = capsys.readouterr().err
    assert error.count("\n") == 1, error
    assert error.startswith("tilthex: ")
    return error


@pytest.mark.parametrize("part", [0.6, 0.75, 0.9, 0.97])
def test_every_command_reads_a_cut_log_as_far_as_it_goes(tmp_path, capsys, flight, part):
    path = cut_short(tmp_path / "cut.mcap", flight, part)
    for arguments in COMMANDS:
        # The flight is too short for a fit, which says so besides.
        short = arguments == ["fit"]
        assert command.main([*arguments, str(path)]) == (2 if short else 0)
        said = capsys.readouterr().err
        assert said.count("\n") == 1 + short, said
        assert "breaks off" in said
        assert "missing" in said
        assert ("in the air; expected at least 10" in said) == short
    replayed = run("replay", path)
    assert replayed.returncode == 5, replayed
    assert "the log is cut" in replayed.stdout
    assert "breaks off" in replayed.stderr
    assert "missing" in replayed.stderr


def test_python_and_rust_read_the_same_of_a_cut_log(tmp_path, flight):
    rng = random.Random(5)
    for _ in range(6):
        path = cut_short(tmp_path / "cut.mcap", flight, rng.uniform(0.1, 1.0))
        replayed = run("replay", path)
        with pytest.warns(log.LogCut) as warned:
            ticks = log.read(path, ["/output"])["/output"]["tick"]
        assert int(replayed.stdout.split()[0]) == len(ticks)
        np.testing.assert_array_equal(ticks, np.arange(len(ticks)))
        missing = str(warned[0].message).partition(": ")[2]
        assert missing in replayed.stderr


def test_a_cut_in_the_index_misses_no_message(tmp_path, flight):
    path = tmp_path / "cut.mcap"
    path.write_bytes(flight[:-10])
    with pytest.warns(log.LogCut, match="no message is missing"):
        log.read(path, ["/state"])


@settings(max_examples=120, deadline=None)
@given(part=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_one_flipped_bit_is_damage_with_its_place(flight_file, flight, part, bit):
    damaged = bytearray(flight)
    at = int(part * len(damaged))
    damaged[at] ^= 1 << bit
    flight_file.write_bytes(damaged)
    with pytest.raises(
        ValueError, match=r"is damaged at byte \d+ \(|is not an MCAP file|is damaged at byte \d+: "
    ):
        _mcap.read(flight_file)


@pytest.fixture(scope="module")
def flight_file(tmp_path_factory):
    return tmp_path_factory.mktemp("flips") / "damaged.mcap"


def test_every_command_calls_damage_damage(tmp_path, capsys, flight):
    rng = random.Random(7)
    path = tmp_path / "damaged.mcap"
    for _ in range(8):
        damaged = bytearray(flight)
        damaged[rng.randrange(8, len(damaged))] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        places = {sentence(capsys, [*arguments, path]).partition("damaged at ")[2] for arguments in COMMANDS}
        assert len(places) == 1
        replayed = run("replay", path)
        assert replayed.returncode == 2, replayed
        assert replayed.stderr.count("\n") == 1
        # The same place, named alike.
        assert places.pop().partition(":")[0] == replayed.stderr.partition("damaged at ")[2].partition(":")[0]


@settings(max_examples=60, deadline=None)
@given(
    hits=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), min_size=1, max_size=30),
    part=st.floats(0.3, 1),
)
def test_garbage_is_refused_or_cut_and_never_a_traceback(flight_file, flight, hits, part):
    damaged = bytearray(flight)
    for place, value in hits:
        damaged[int(place * len(damaged))] = value
    flight_file.write_bytes(damaged[: int(part * len(damaged))])
    try:
        found = _mcap.read(flight_file)
    except ValueError as error:
        assert str(flight_file) in str(error)
    else:
        list(found.messages(found.channels))


def repacked(path, source, compression, chunked=True):
    """The same log, written by PyPI's `mcap`."""
    ids = {}
    with source.open("rb") as stream, path.open("wb") as out:
        writer = Writer(out, compression=compression, use_chunking=chunked)
        writer.start(profile="", library="repacked")
        for record in StreamReader(stream).records:
            name = type(record).__name__
            if name == "Attachment":
                writer.add_attachment(0, 0, record.name, record.media_type, record.data)
            elif name == "Metadata":
                writer.add_metadata(record.name, record.metadata)
            elif name == "Schema" and ("s", record.id) not in ids:
                ids["s", record.id] = writer.register_schema(record.name, record.encoding, record.data)
            elif name == "Channel" and ("c", record.id) not in ids:
                ids["c", record.id] = writer.register_channel(
                    record.topic, record.message_encoding, ids["s", record.schema_id]
                )
            elif name == "Message":
                writer.add_message(
                    ids["c", record.channel_id],
                    record.log_time,
                    record.data,
                    record.publish_time,
                    record.sequence,
                )
        writer.finish()


@pytest.mark.parametrize("compression", list(CompressionType))
def test_logs_of_any_compression_are_read(tmp_path, flight, compression):
    source, path = tmp_path / "flight.mcap", tmp_path / "repacked.mcap"
    source.write_bytes(flight)
    repacked(path, source, compression)
    for topic, columns in log.read(source, log.TOPICS.keys() - {"/command"}).items():
        again = log.read(path, [topic])[topic]
        for name, values in columns.items():
            np.testing.assert_array_equal(again[name], values)
    replayed = run("replay", path)
    assert replayed.returncode == 0, replayed
    repacked(path, source, CompressionType.NONE, chunked=False)
    assert run("replay", path).returncode == 0
    assert len(log.read(path, ["/state"])["/state"]["log_time"]) > 1000


@pytest.mark.parametrize("topic", ["/input", "/state", "/camera"])
@pytest.mark.parametrize("attached", [False, True])
def test_somebody_elses_file_is_one_sentence(tmp_path, capsys, topic, attached):
    path = tmp_path / "other.mcap"
    with path.open("wb") as out:
        writer = Writer(out)
        writer.start(profile="ros1", library="someone")
        if attached:
            writer.add_attachment(0, 0, "config.toml", "", b"vehicle.preset = 'tilt-hex'\n")
        schema = writer.register_schema("sensor_msgs/Imu", "ros1msg", b"float64 x")
        channel = writer.register_channel(topic, "ros1", schema)
        writer.add_message(channel, 1, b"\x01\x02", 1)
        other = writer.register_channel("/flight", MessageEncoding.JSON, 0)
        writer.add_message(other, 1, b"{}", 1)
        writer.finish()
    for arguments in COMMANDS:
        error = sentence(capsys, [*arguments, path])
        assert "log of tilthex-rt" in error or "holds no messages" in error or "expected at least 2" in error
    replayed = run("replay", path)
    assert replayed.returncode == 2
    assert replayed.stderr.count("\n") == 1


def chunk(compression, size, packed):
    """An MCAP file with one chunk as it says."""

    def text(value):
        return struct.pack("<I", len(value)) + value.encode()

    def record(kind, body):
        return struct.pack("<BQ", kind, len(body)) + body

    body = (
        bytes(16) + struct.pack("<QI", size, 0) + text(compression) + struct.pack("<Q", len(packed)) + packed
    )
    return _mcap.MAGIC + record(1, text("") + text("bomb")) + record(6, body)


@pytest.mark.parametrize("size", [1000, 64 << 20, 1 << 40])
@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_a_bomb_is_one_sentence(tmp_path, capsys, compression, size):
    zeros = bytes(64 << 20)
    packed = lz4.frame.compress(zeros) if compression == "lz4" else zstandard.compress(zeros)
    path = tmp_path / "bomb.mcap"
    path.write_bytes(chunk(compression, size, packed))
    for arguments in COMMANDS:
        assert "unpack" in sentence(capsys, [*arguments, path])
    assert "unpack" in run("replay", path).stderr


def test_an_unknown_compression_is_named(tmp_path, capsys):
    path = tmp_path / "brotli.mcap"
    path.write_bytes(chunk("brotli", 1, b"x"))
    assert 'compressed with "brotli"; expected lz4 or zstd' in sentence(capsys, ["plot", path])
    assert 'compressed with "brotli"; expected lz4 or zstd' in run("replay", path).stderr


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"no log", bytes(100), b"PK\x03\x04"])
def test_what_never_was_a_log_is_one_sentence(tmp_path, capsys, content):
    path = tmp_path / "flight.mcap"
    path.write_bytes(content)
    for arguments in COMMANDS:
        sentence(capsys, [*arguments, path])
    replayed = run("replay", path)
    assert (replayed.returncode, replayed.stderr.count("\n")) == (2, 1)


def test_a_pipe_or_a_device_is_no_log(tmp_path, capsys):
    pipe = tmp_path / "pipe.mcap"
    os.mkfifo(pipe)
    for path, what in ((pipe, "a pipe"), (Path("/dev/zero"), "a device"), (tmp_path, "a directory")):
        assert what in sentence(capsys, ["plot", path])
        assert what in run("replay", path).stderr


def test_phases_are_names_and_numbers_are_arrays(path):
    topics = log.read(path, ["/flight", "/state", "/rotors", "/wrench", "/control"])
    phase = topics["/flight"]["phase"]
    assert {"disarmed", "starting", "flying", "landing"} <= set(phase)
    aloft = log.flying(phase)
    height = topics["/state"]["position_w"][:, 2]
    assert np.median(height[aloft]) > np.median(height[~aloft]) + 0.2
    assert topics["/rotors"]["command"].shape == (len(phase), 6)
    assert topics["/wrench"]["tool_w.force"].shape == (len(phase), 3)
    assert topics["/control"]["compliant"].dtype == float
    assert set(log.TOPICS) - set(log.Log(path).topics) == {"/command"}


def test_state_and_truth_share_a_clock(path):
    """By their `time` the estimate is on the truth while the vehicle climbs and sinks."""
    topics = log.read(path, ["/state", "/truth", "/flight"])
    state, truth = topics["/state"], topics["/truth"]
    moves = log.flying(topics["/flight"]["phase"]) & (abs(state["velocity_w"][:, 2]) > 0.1)
    assert moves.sum() > 300
    at = state["time"][moves]
    off = [
        state["position_w"][moves, k] - np.interp(at, truth["time"], truth["position_w"][:, k])
        for k in range(3)
    ]
    assert np.median(np.linalg.norm(off, axis=0)) < 1e-3
    # One clock: neither counts from a start of its own.
    assert abs(truth["time"][-1] - topics["/flight"]["time"][-1]) < 1.0
    assert np.all(state["time"] <= topics["/flight"]["time"] + 1e-3)


def test_the_check_sums_are_those_of_the_file(flight):
    """What is compared is there: a log without checksums would pass every flip."""
    records = list(StreamReader(io.BytesIO(flight), emit_chunks=True, validate_crcs=True).records)
    chunks = [r for r in records if type(r).__name__ == "Chunk"]
    assert chunks
    assert all(c.uncompressed_crc == zlib.crc32(lz4.frame.decompress(c.data)) for c in chunks)
    [end] = [r for r in records if type(r).__name__ == "DataEnd"]
    assert end.data_section_crc != 0


def test_a_recording_of_a_cut_log_warns(tmp_path, flight):
    import tilthex

    path = cut_short(tmp_path / "cut.mcap", flight, 0.8)
    with pytest.warns(log.LogCut):
        recording = Recording.from_file(path, tilthex.Config.default(tilthex.Vehicle.preset("tilt-hex")))
    assert len(recording.imu_time) > 500
