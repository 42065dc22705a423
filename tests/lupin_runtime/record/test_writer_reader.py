"""Recordings are read as they were written, and as far as possible when damaged."""

from __future__ import annotations

import errno
import os
import resource
import struct
import sys
import tempfile
from pathlib import Path

import lz4.frame
import psutil
import pytest
import zstandard
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from lupin_runtime import graph
from lupin_runtime.record.definitions import schema_text
from lupin_runtime.record.reader import MAGIC, NotARecording, Recording
from lupin_runtime.record.writer import RecordingStopped, RecordingWriter, free_name
from tests.support.optional import present

SCAN_SCHEMA = schema_text("sensor_msgs/msg/LaserScan")
BOOL_SCHEMA = schema_text("std_msgs/msg/Bool")
CDR_TRUE = b"\x00\x01\x00\x00\x01"


def record(path: Path, chunks: int = 5, per_chunk: int = 20) -> list[bytes]:
    """Write a complete file of `chunks` chunks on two topics; return the payloads of /scan."""
    writer = RecordingWriter(path)
    writer.add_metadata("lupin", {"world": "demo"})
    scan = writer.add_channel("/scan", graph.SCAN.type, SCAN_SCHEMA, graph.SCAN.qos)
    stop = writer.add_channel("/e_stop_state", graph.ESTOP_STATE.type, BOOL_SCHEMA, graph.ESTOP_STATE.qos)
    payloads = []
    for i in range(chunks * per_chunk):
        payloads.append(os.urandom(300) + bytes([i % 256]))
        writer.write(scan, payloads[-1], i * 100_000_000, i * 100_000_000 + 5, i)
        if i % 10 == 0:
            writer.write(stop, CDR_TRUE, i * 100_000_000 + 1, 0)
        if i % per_chunk == per_chunk - 1:
            writer.flush()
    writer.finish()
    return payloads


def test_messages_are_read_as_they_were_written(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    payloads = record(path)
    recording = Recording(path)
    scans = list(recording.raw({"/scan"}))
    assert [m.data for m in scans] == payloads
    assert [m.log_ns for m in scans] == [i * 100_000_000 for i in range(100)]
    assert scans[3].publish_ns == 300_000_005
    assert recording.damage == []
    assert recording.metadata == {"world": "demo"}


def test_summary_counts_every_topic(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap")
    summary = Recording(tmp_path / "a.mcap").summary()
    counts = {t.channel.topic: (t.messages, t.channel.type) for t in summary.topics}
    assert counts == {"/e_stop_state": (10, "std_msgs/msg/Bool"), "/scan": (100, "sensor_msgs/msg/LaserScan")}
    assert summary.duration_s == pytest.approx(9.9)
    assert summary.messages == 110


def test_reference_reader_accepts_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    payloads = record(path)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert present(summary.statistics).message_count == 110
        assert {s.encoding for s in summary.schemas.values()} == {"ros2msg"}
        assert [m.data for _, _, m in reader.iter_messages(topics=["/scan"])] == payloads
        scan = next(c for c in summary.channels.values() if c.topic == "/scan")
        assert scan.message_encoding == "cdr"
        assert "reliability: best_effort" in scan.metadata["offered_qos_profiles"]


def test_unfinished_file_keeps_every_flushed_message(tmp_path: Path) -> None:
    path = tmp_path / "killed.mcap"
    writer = RecordingWriter(path)
    channel = writer.add_channel("/e_stop_state", graph.ESTOP_STATE.type, BOOL_SCHEMA, graph.ESTOP_STATE.qos)
    for i in range(30):
        writer.write(channel, CDR_TRUE, i, i)
        if i == 19:
            writer.flush()
    # Without finish(), like the file of a killed process.
    recording = Recording(path)
    assert [m.log_ns for m in recording.raw()] == list(range(20))
    assert "killed" in recording.damage[0]
    writer.abandon()


@settings(max_examples=60)
@given(cut=st.integers(min_value=len(MAGIC), max_value=4000))
def test_truncated_file_yields_a_prefix_and_reports_damage(tmp_path_factory: pytest.TempPathFactory, cut: int) -> None:
    folder = tmp_path_factory.mktemp("cut")
    payloads = record(folder / "whole.mcap", chunks=4, per_chunk=3)
    whole = (folder / "whole.mcap").read_bytes()
    (folder / "cut.mcap").write_bytes(whole[:cut])
    recording = Recording(folder / "cut.mcap")
    read = [m.data for m in recording.raw({"/scan"})]
    assert read == payloads[: len(read)]
    assert len(read) % 3 == 0
    assert recording.damage or len(read) == len(payloads)


def test_damaged_chunk_loses_only_that_chunk(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    payloads = record(path)
    content = bytearray(path.read_bytes())
    with path.open("rb") as file:
        chunk = present(make_reader(file).get_summary()).chunk_indexes[2]
    middle = chunk.chunk_start_offset + chunk.chunk_length // 2
    content[middle : middle + 8] = b"\xff" * 8
    path.write_bytes(content)
    recording = Recording(path)
    assert [m.data for m in recording.raw({"/scan"})] == payloads[:40] + payloads[60:]
    assert len(recording.damage) == 1
    assert "skipped" in recording.damage[0]


@settings(max_examples=80)
@given(at=st.integers(min_value=8, max_value=3000), garbage=st.binary(min_size=1, max_size=40))
@example(at=130, garbage=b"\xf1")  # the header of the first chunk's frame claims more than the memory
def test_reading_garbage_never_raises(tmp_path_factory: pytest.TempPathFactory, at: int, garbage: bytes) -> None:
    path = tmp_path_factory.mktemp("garbage") / "a.mcap"
    record(path, chunks=3, per_chunk=3)
    content = bytearray(path.read_bytes())
    content[at : at + len(garbage)] = garbage
    path.write_bytes(content)
    recording = Recording(path)
    assert sum(1 for _ in recording.raw()) <= 11


@pytest.mark.parametrize(
    ("content", "words"), [(b"", "empty"), (b"SQLite format 3\0", "begins with"), (MAGIC[:5], "begins with")]
)
def test_file_of_another_format_is_refused_by_name(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "x.db3"
    path.write_bytes(content)
    with pytest.raises(NotARecording, match=words) as error:
        Recording(path)
    assert str(path) in str(error.value)


def test_missing_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NotARecording, match="No such file"):
        Recording(tmp_path / "none.mcap")


def test_messages_are_decoded_and_throttled(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = RecordingWriter(path)
    channel = writer.add_channel("/e_stop_state", graph.ESTOP_STATE.type, BOOL_SCHEMA, graph.ESTOP_STATE.qos)
    foreign = writer.add_channel("/foreign", "nowhere_msgs/msg/Thing", "int32 x", graph.REL10)
    for i in range(100):
        writer.write(channel, CDR_TRUE, i * 20_000_000, i)
        writer.write(foreign, b"\x00\x01\x00\x00", i * 20_000_000, i)
    writer.finish()
    recording = Recording(path)
    decoded = list(recording.messages(max_rate_hz={"/e_stop_state": 5.0}))
    assert [m.log_ns for m in decoded] == [i * 200_000_000 for i in range(10)]
    assert all(m.message.data is True for m in decoded)
    assert recording.damage == ["/foreign: its type nowhere_msgs/msg/Thing is not installed on this machine"]


def test_messages_that_do_not_fit_their_type_are_skipped(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    writer = RecordingWriter(path)
    channel = writer.add_channel("/e_stop_state", graph.ESTOP_STATE.type, BOOL_SCHEMA, graph.ESTOP_STATE.qos)
    plan = writer.add_channel(graph.PLAN.name, graph.PLAN.type, "", graph.PLAN.qos)
    for i in range(4):
        writer.write(channel, CDR_TRUE if i % 2 else CDR_TRUE[:3], i, i)
        writer.write(plan, CDR_TRUE[:4] + b"\xff" * 40, i, i)
    writer.finish()
    recording = Recording(path)
    assert [decoded.log_ns for decoded in recording.messages()] == [1, 3]
    assert recording.damage == ["/e_stop_state: 2 messages do not fit their type", "/plan: 4 messages do not fit their type"]


@pytest.mark.parametrize("type_name", ["evil/msg/Thing", "evil/__init__/Thing", "antigravity/msg/X", "a/b", "../x/msg/Y", ""])
def test_recording_chooses_no_module_to_import(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, type_name: str) -> None:
    (tmp_path / "evil" / "msg").mkdir(parents=True)
    for folder in (tmp_path / "evil", tmp_path / "evil" / "msg"):
        (folder / "__init__.py").write_text(f"open({str(tmp_path / 'mark')!r}, 'w')\n")
    monkeypatch.syspath_prepend(tmp_path)
    writer = RecordingWriter(tmp_path / "one.mcap")
    writer.write(writer.add_channel("/thing", type_name, "int32 x", graph.REL10), CDR_TRUE, 0, 0)
    writer.finish()
    recording = Recording(tmp_path / "one.mcap")
    assert list(recording.messages()) == []
    assert recording.damage == [f"/thing: its type {type_name} is not installed on this machine"]
    assert not (tmp_path / "mark").exists()
    assert "antigravity" not in sys.modules


@given(st.binary(max_size=60), st.integers(0, 80))
def test_garbage_in_a_chunk_is_skipped(records: bytes, length: int) -> None:
    for body in (records, struct.pack("<BQ", Opcode.MESSAGE, length) + records):
        chunk = struct.pack("<QQQII", 0, 0, len(body), 0, 0) + struct.pack("<Q", len(body)) + body
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "one.mcap")
            path.write_bytes(MAGIC + struct.pack("<BQ", Opcode.CHUNK, len(chunk)) + chunk)
            recording = Recording(path)
            assert list(recording.raw()) == []
            assert recording.damage, "a file without a footer is incomplete"


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
@pytest.mark.parametrize("claimed_bytes", [1 << 30, 1 << 20])
def test_bomb_in_a_recording_is_not_unpacked(tmp_path: Path, compression: str, claimed_bytes: int) -> None:
    zeros = bytes(1 << 29)
    packed = zstandard.compress(zeros) if compression == "zstd" else lz4.frame.compress(zeros, store_size=False)
    name = compression.encode()
    chunk = struct.pack("<QQQII", 0, 0, claimed_bytes, 0, len(name)) + name + struct.pack("<Q", len(packed)) + packed
    path = tmp_path / "bomb.mcap"
    path.write_bytes(MAGIC + struct.pack("<BQ", Opcode.CHUNK, len(chunk)) + chunk)
    del zeros
    recording = Recording(path)
    before = resource.getrlimit(resource.RLIMIT_AS)
    try:
        resource.setrlimit(resource.RLIMIT_AS, (psutil.Process().memory_info().vms + (200 << 20), before[1]))
        assert list(recording.raw()) == []
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
    assert "a chunk is damaged and was skipped" in recording.damage[0]


def test_recording_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    record(path)
    before = path.read_bytes()
    with pytest.raises(FileExistsError):
        RecordingWriter(path)
    assert free_name(path) == tmp_path / "recording-1.mcap"
    (tmp_path / "recording-1.mcap").touch()
    assert free_name(path) == tmp_path / "recording-2.mcap"
    assert path.read_bytes() == before


def test_full_disk_leaves_a_file_of_complete_chunks(tmp_path: Path) -> None:
    path = tmp_path / "full.mcap"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))
        writer = RecordingWriter(path)
        channel = writer.add_channel("/scan", graph.SCAN.type, SCAN_SCHEMA, graph.SCAN.qos)
        kept = 0
        with pytest.raises(RecordingStopped) as error:  # noqa: PT012 -- any of the writes may meet the limit
            for i in range(100):
                writer.write(channel, os.urandom(1000), i, i)
                if i % 10 == 9:
                    writer.flush()
                    kept = i + 1
        writer.abandon()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert error.value.errno == errno.EFBIG
    assert 0 < kept < 100
    assert [m.log_ns for m in Recording(path).raw()] == list(range(kept))
    seen = []
    # A strict reader finds no truncated record.
    with path.open("rb") as file, pytest.raises(EndOfFile):  # noqa: PT012 -- the records before the end count
        for item in StreamReader(file, emit_chunks=True).records:
            seen.append(item)
    assert type(seen[-1]).__name__ == "MessageIndex"
