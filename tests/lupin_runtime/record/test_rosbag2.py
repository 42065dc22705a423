"""A folder of `ros2 bag record` is read as rosbag2 reads it: its splits, its compression, and what is left of it.

The rules are those of rosbag2 (rosbag2_cpp `SequentialReader`, rosbag2_compression, rosbag2_storage_mcap):
- metadata.yaml lists the splits, and their order is that of the list, whatever their times;
- a path is relative to the folder, before version 4 to its parent, or absolute;
- mode `file` packs whole splits by zstd and adds .zstd to their names; mode `message` packs the data of each message;
- without metadata.yaml, as a killed recorder leaves it, splits have numbers: `garden_0.mcap`, `garden_1.mcap`, ...;
- the storage sqlite3 has files .db3.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_runtime.record.reader import NotARecording, Recording
from lupin_runtime.record.runs import find_recorded_run, recorded_run
from tests.support.rosbag2_folders import Message, write_metadata, write_split

BOOL = "std_msgs/msg/Bool"
S = 1_000_000_000


def stop_messages(first: int, count: int) -> list[Message]:
    return [("/stop", BOOL, number * S, bytes((0, 1, 0, 0, number % 2))) for number in range(first, first + count)]


@pytest.fixture
def garden(tmp_path: Path) -> Path:
    """Three splits of ten messages, one a second."""
    folder = tmp_path / "garden"
    folder.mkdir()
    names = [write_split(folder / f"garden_{number}.mcap", stop_messages(10 * number, 10)).name for number in range(3)]
    write_metadata(folder, names)
    return folder


def times_s(folder: Path) -> list[int]:
    return [message.log_ns // S for recording in recorded_run(folder).open() for message in recording.raw()]


def test_splits_are_read_in_the_order_of_the_list(garden: Path) -> None:
    assert times_s(garden) == list(range(30))
    write_metadata(garden, ["garden_2.mcap", "garden_0.mcap"])
    assert times_s(garden) == [*range(20, 30), *range(10)]
    assert recorded_run(garden).damage() == []


@pytest.mark.parametrize("name", ["garden", "garden/metadata.yaml", "garden/"])
def test_folder_and_its_metadata_are_names_of_the_recording(garden: Path, name: str) -> None:
    run = find_recorded_run(str(garden.parent / name))
    assert (run.folder, len(run.recordings)) == (garden, 3)


def test_splits_whose_times_overlap_keep_all_messages(garden: Path) -> None:
    write_split(garden / "garden_1.mcap", stop_messages(5, 10))
    assert times_s(garden) == [*range(10), *range(5, 15), *range(20, 30)]


def test_missing_split_is_named_and_the_others_are_read(garden: Path) -> None:
    (garden / "garden_1.mcap").unlink()
    assert times_s(garden) == [*range(10), *range(20, 30)]
    (problem,) = recorded_run(garden).damage()
    assert "garden_1.mcap: no such file, but metadata.yaml lists it" in problem


def test_split_without_its_end_keeps_its_whole_chunks(garden: Path) -> None:
    split = garden / "garden_2.mcap"
    write_split(split, stop_messages(20, 2000))
    split.write_bytes(split.read_bytes()[: split.stat().st_size // 2])
    read = times_s(garden)
    assert read == list(range(len(read)))
    assert 200 < len(read) < 2020


@pytest.mark.parametrize("version", [1, 3, 4, 5, 8, 9])
def test_paths_are_relative_to_the_folder_or_its_parent(garden: Path, version: int) -> None:
    prefix = "garden/" if version < 4 else ""
    write_metadata(garden, [f"{prefix}garden_{number}.mcap" for number in range(3)], version=version)
    assert len(times_s(garden)) == 30


def test_absolute_path_is_taken_as_it_is(garden: Path) -> None:
    write_metadata(garden, [str(garden / "garden_1.mcap")])
    assert times_s(garden) == list(range(10, 20))


def test_folder_of_a_killed_recorder_is_read_by_its_numbers(garden: Path) -> None:
    (garden / "metadata.yaml").unlink()
    (garden / "garden_2.mcap").rename(garden / "garden_10.mcap")
    assert times_s(garden) == list(range(30))


def test_several_recordings_in_one_folder_are_named(garden: Path) -> None:
    (garden / "metadata.yaml").unlink()
    write_split(garden / "shed.mcap", stop_messages(0, 1))
    with pytest.raises(NotARecording, match=r"holds 4 recordings and no metadata.yaml; name one of them: garden_0.mcap"):
        recorded_run(garden).open()


@pytest.mark.parametrize(
    "text",
    ["", "rosbag2_bagfile_information: [", "a: 1", "rosbag2_bagfile_information: {relative_file_paths: [{}]}", "\0", "- 1"],
)
def test_unusable_metadata_costs_only_the_order(garden: Path, text: str) -> None:
    (garden / "metadata.yaml").write_text(text)
    assert times_s(garden) == list(range(30))
    (problem,) = recorded_run(garden).damage()
    assert str(garden / "metadata.yaml") in problem


@pytest.mark.parametrize("has_metadata", [True, False])
def test_other_storage_is_refused_with_the_command_that_converts(garden: Path, has_metadata: bool) -> None:
    for path in garden.iterdir():
        path.unlink()
    (garden / "garden_0.db3").write_bytes(b"SQLite format 3\0")
    if has_metadata:
        write_metadata(garden, ["garden_0.db3"], storage_identifier="sqlite3")
    with pytest.raises(NotARecording, match="in the storage sqlite3") as refused:
        recorded_run(garden).open()
    assert f"ros2 bag convert -i {garden} -o mcap.yaml" in str(refused.value)
    with pytest.raises(NotARecording, match="sqlite3 storage; convert its folder"):
        Recording(garden / "garden_0.db3")


def test_empty_folder_says_what_was_expected(tmp_path: Path) -> None:
    with pytest.raises(NotARecording, match=r"holds no recording: neither recording.mcap nor what `ros2 bag record -s mcap`"):
        recorded_run(tmp_path).open()


@pytest.mark.parametrize(("pack_file", "pack_messages"), list(itertools.product([False, True], repeat=2)))
def test_compression_of_files_and_messages_changes_nothing(tmp_path: Path, pack_file: bool, pack_messages: bool) -> None:
    messages = stop_messages(0, 500)
    path = write_split(tmp_path / "a_0.mcap", messages, pack_file=pack_file, pack_messages=pack_messages)
    write_metadata(tmp_path, [path.name])
    for recording in (Recording(path), *recorded_run(tmp_path).open()):
        assert [message.data for message in recording.raw()] == [data for *_, data in messages]
        assert recording.damage == []


def test_unpacked_file_is_found_under_its_packed_name(garden: Path) -> None:
    write_metadata(garden, ["garden_0.mcap.zstd"], compression_mode="FILE", compression_format="zstd")
    assert times_s(garden) == list(range(10))


def test_file_packed_by_lz4_or_in_several_frames_is_read(tmp_path: Path) -> None:
    content = write_split(tmp_path / "a.mcap", stop_messages(0, 500)).read_bytes()
    (tmp_path / "a.mcap.lz4").write_bytes(lz4.frame.compress(content))
    half = len(content) // 2
    (tmp_path / "b.mcap.zstd").write_bytes(zstandard.compress(content[:half]) + zstandard.compress(content[half:]))
    for name in ("a.mcap.lz4", "b.mcap.zstd"):
        recording = Recording(tmp_path / name)
        assert len(list(recording.raw())) == 500
        assert recording.damage == []


@pytest.mark.parametrize("compress", [zstandard.compress, lz4.frame.compress])
def test_packed_file_that_is_no_recording_is_refused(tmp_path: Path, compress: object) -> None:
    assert callable(compress)
    (tmp_path / "a.mcap.zstd").write_bytes(compress(b"# a text\n" * 100))
    with pytest.raises(NotARecording, match="begins with b'# a text'"):
        Recording(tmp_path / "a.mcap.zstd")


@pytest.mark.parametrize(
    ("start", "words"),
    [(b"#ROSBAG V2.0\n", "ROS 1"), (b"\x1f\x8b\x08\0", "gunzip"), (b"BZh91AY", "bunzip2"), (b"\xfd7zXZ\0", "unxz")],
)
def test_other_formats_are_named(tmp_path: Path, start: bytes, words: str) -> None:
    (tmp_path / "a").write_bytes(start + bytes(100))
    with pytest.raises(NotARecording, match=words):
        Recording(tmp_path / "a")


@settings(max_examples=60)
@given(share=st.floats(0.0, 1.0), flipped=st.integers(0, 255))
@pytest.mark.parametrize("compress", [zstandard.compress, lz4.frame.compress], ids=["zstd", "lz4"])
def test_damaged_packed_file_yields_a_prefix(
    tmp_path_factory: pytest.TempPathFactory, compress: object, share: float, flipped: int
) -> None:
    assert callable(compress)
    folder = tmp_path_factory.mktemp("packed")
    messages = stop_messages(0, 600)
    whole = compress(write_split(folder / "a.mcap", messages).read_bytes())
    at = int(share * (len(whole) - 1))
    for damaged in (whole[:at], whole[:at] + bytes((whole[at] ^ flipped,)) + whole[at + 1 :]):
        (folder / "b.mcap.zstd").write_bytes(damaged)
        try:
            recording = Recording(folder / "b.mcap.zstd")
        except NotARecording:
            continue
        read = list(recording.raw())
        assert recording.damage or len(read) in (0, 600)


def test_cut_off_messages_cost_themselves_only(tmp_path: Path) -> None:
    packed = zstandard.compress(bytes((0, 1, 0, 0, 1)))
    unknown_size = zstandard.ZstdCompressor(write_content_size=False).compress(bytes((0, 1, 0, 0, 1)))
    odd = [packed[:n] for n in range(4, len(packed))] + [unknown_size, packed[:4] + b"\xff" * 20]
    path = write_split(tmp_path / "a.mcap", [*stop_messages(0, 3), *(("/stop", BOOL, 3 * S, data) for data in odd)])
    recording = Recording(path)
    assert len(list(recording.raw())) == 3
    assert recording.damage == [f"/stop: {len(odd)} messages are compressed by zstd and cannot be unpacked"]


def test_other_compression_of_messages_is_refused_by_name(garden: Path) -> None:
    write_metadata(garden, ["garden_0.mcap"], compression_mode="MESSAGE", compression_format="lz4")
    with pytest.raises(NotARecording, match="messages are compressed by 'lz4', of which only zstd is read"):
        recorded_run(garden).open()
