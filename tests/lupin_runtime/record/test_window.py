"""A window of a recording has the messages of its time and the state before it, whatever the recording's condition."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_runtime import graph
from lupin_runtime.record.definitions import schema_text
from lupin_runtime.record.reader import NotARecording, RawMessage, Recording
from lupin_runtime.record.window import IndexedRecording, read_window
from lupin_runtime.record.writer import RecordingWriter

BOOL_SCHEMA = schema_text("std_msgs/msg/Bool")
SECOND = 1_000_000_000
TOPICS = ("/fast", "/slow", "/static")


class Recorder:
    """A recording of topics of type Bool. Payloads are the time as text."""

    def __init__(self, path: Path) -> None:
        self.writer = RecordingWriter(path)
        self._channels: dict[str, int] = {}

    def write(self, topic: str, at_s: float, data: bytes | None = None) -> None:
        if topic not in self._channels:
            self._channels[topic] = self.writer.add_channel(topic, "std_msgs/msg/Bool", BOOL_SCHEMA, graph.ESTOP_STATE.qos)
        self.writer.write(self._channels[topic], data or f"{at_s:g}".encode(), int(at_s * SECOND), 0)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A recording of 20 s: /fast once a second, /slow at 0.5 and 10.5 s, /static twice; a chunk every 5 s."""
    recorder = Recorder(tmp_path / "a.mcap")
    for second in range(20):
        recorder.write("/fast", second)
        if second % 10 == 0:
            recorder.write("/slow", second + 0.5)
        if second in (1, 3):
            recorder.write("/static", second)
        if second % 5 == 4:
            recorder.writer.flush()
    recorder.writer.finish()
    return tmp_path / "a.mcap"


def read(*paths: Path, from_s: float, to_s: float, topics: tuple[str, ...] = TOPICS, max_bytes: int = 1000) -> list[str]:
    recordings = [IndexedRecording(path) for path in paths]
    window = read_window(recordings, topics, int(from_s * SECOND), int(to_s * SECOND), ("/static",), max_bytes)
    return [f"{message.topic}@{message.data.decode()}" for message in window.messages]


def test_window_has_its_messages_and_the_state_before(path: Path) -> None:
    assert read(path, from_s=7.0, to_s=9.0) == [
        "/slow@0.5",
        "/static@1",
        "/static@3",
        "/fast@6",
        "/fast@7",
        "/fast@8",
        "/fast@9",
    ]
    assert read(path, from_s=7.0, to_s=7.5, topics=("/fast",)) == ["/fast@6", "/fast@7"]
    assert read(path, from_s=7.0, to_s=7.5, topics=("/absent",)) == []


def test_window_before_the_recording_is_empty(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "late.mcap")
    recorder.write("/fast", 100.0)
    recorder.writer.finish()
    assert read(tmp_path / "late.mcap", from_s=10.0, to_s=20.0) == []
    window = read_window([IndexedRecording(tmp_path / "late.mcap")], ("/fast",), 0, 0)
    assert (window.start_ns, window.end_ns) == (100 * SECOND, 100 * SECOND)


def test_recording_without_messages_has_no_times(tmp_path: Path) -> None:
    Recorder(tmp_path / "a.mcap").writer.finish()
    window = read_window([IndexedRecording(tmp_path / "a.mcap")], TOPICS, 0, SECOND)
    assert (window.start_ns, window.end_ns, window.messages) == (0, 0, [])


def test_growing_recording_is_read_on(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "a.mcap")
    recording = IndexedRecording(tmp_path / "a.mcap")
    ends = []
    for second in range(4):
        recorder.write("/fast", second)
        if second == 2:
            recorder.write("/late", second)  # a channel that is defined in a later chunk
        recorder.writer.flush()
        ends.append(read_window([recording], ("/fast", "/late"), 0, 10 * SECOND).end_ns / SECOND)
    assert ends == [0.0, 1.0, 2.0, 3.0]
    messages = read_window([recording], ("/fast", "/late"), 0, 10 * SECOND).messages
    assert [message.topic for message in messages] == ["/fast", "/fast", "/fast", "/late", "/fast"]
    recorder.writer.finish()
    assert len(read_window([recording], ("/fast",), 0, 10 * SECOND).messages) == 4


def test_recordings_of_a_restarted_recorder_are_one(path: Path, tmp_path: Path) -> None:
    second = Recorder(tmp_path / "b.mcap")
    second.write("/fast", 25.0)
    second.writer.finish()
    assert read(path, tmp_path / "b.mcap", from_s=24.0, to_s=26.0) == [
        "/static@1", "/static@3", "/slow@10.5", "/fast@19", "/fast@25",
    ]  # fmt: skip
    assert read(path, tmp_path / "b.mcap", from_s=26.0, to_s=27.0, topics=("/fast",)) == ["/fast@25"]


def test_window_ends_before_its_size_limit(path: Path) -> None:
    window = read_window([IndexedRecording(path)], ("/fast",), 5 * SECOND, 15 * SECOND, max_bytes=4)
    assert [message.data for message in window.messages] == [b"4", b"5", b"6", b"7", b"8"]
    assert window.complete_ns == 9 * SECOND - 1
    assert read_window([IndexedRecording(path)], ("/fast",), 5 * SECOND, 30 * SECOND).complete_ns == 19 * SECOND


def test_damaged_chunk_is_skipped(path: Path) -> None:
    recording = IndexedRecording(path)
    recording.refresh()
    content = bytearray(path.read_bytes())
    broken = recording._chunks[1]
    content[broken.at + 50 : broken.at + broken.length] = bytes(broken.length - 50)
    path.write_bytes(content)
    assert read(path, from_s=3.0, to_s=12.0, topics=("/fast",)) == [f"/fast@{n}" for n in (2, 3, 4, 10, 11, 12)]


@settings(max_examples=60)
@given(st.data())
def test_truncated_file_has_the_messages_of_its_whole_chunks(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("truncated")
    recorder = Recorder(folder / "a.mcap")
    for second in range(6):
        recorder.write("/fast", second)
        recorder.writer.flush()
    recorder.writer.finish()
    content = (folder / "a.mcap").read_bytes()
    (folder / "a.mcap").write_bytes(content[: data.draw(st.integers(0, len(content)))])
    try:
        reference: list[RawMessage] = list(Recording(folder / "a.mcap").raw())
    except NotARecording:
        return
    window = read_window([IndexedRecording(folder / "a.mcap")], ("/fast",), 0, 10 * SECOND)
    assert window.messages == reference
