"""A rosbag2 folder gives the same scans as the file of the same messages, however it is split and compressed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage
from typer.testing import CliRunner

from lupin_cli.commands.map import app
from lupin_runtime import graph
from lupin_runtime.slam.mcap_scans import RecordedScans, read_recording
from tests.support.rosbag2_folders import Message, write_metadata, write_split

pytestmark = pytest.mark.graph

STEP_NS = 100_000_000
BEAMS = 90


def drive(scans: int) -> list[Message]:
    """Messages of a robot that drives along a wall: the lidar's mount, and for each scan a transform of the odometry."""
    from geometry_msgs.msg import TransformStamped

    def transform(parent: str, child: str, at_ns: int, x: float) -> bytes:
        message = TransformStamped(child_frame_id=child)
        message.header.frame_id = parent
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(at_ns, 1_000_000_000)
        message.transform.translation.x = x
        return bytes(serialize_message(TFMessage(transforms=[message])))

    messages = [(graph.TF_STATIC.name, graph.TF_STATIC.type, 0, transform(graph.BASE_FRAME, "lidar", 0, 0.1))]
    for number in range(scans):
        at_ns = number * STEP_NS
        messages.append(
            (graph.TF.name, graph.TF.type, at_ns, transform(graph.ODOM_FRAME, graph.BASE_FRAME, at_ns, number * 0.05))
        )
        scan = LaserScan(angle_increment=2 * np.pi / BEAMS, range_min=0.1, range_max=10.0)
        scan.header.frame_id = "lidar"
        scan.header.stamp.sec, scan.header.stamp.nanosec = divmod(at_ns, 1_000_000_000)
        scan.ranges = [2.0 + 0.5 * np.sin(0.4 * beam) + 0.01 * number for beam in range(BEAMS)]
        messages.append((graph.SCAN.name, graph.SCAN.type, at_ns, bytes(serialize_message(scan))))
    return messages


def bag(folder: Path, splits: list[list[Message]], *, pack_messages: bool = False, pack_file: bool = False) -> Path:
    folder.mkdir()
    names = [
        write_split(folder / f"bag_{number}.mcap", split, pack_messages=pack_messages, pack_file=pack_file).name
        for number, split in enumerate(splits)
    ]
    write_metadata(folder, names)
    return folder


def as_text(read: RecordedScans) -> list[tuple[object, ...]]:
    return [(scan.stamp, scan.odom, scan.ranges.tolist(), scan.beams) for scan in read.scans]


@pytest.mark.parametrize("pack_messages", [False, True])
@pytest.mark.parametrize("pack_file", [False, True])
def test_splits_and_compression_do_not_change_the_scans(tmp_path: Path, pack_messages: bool, pack_file: bool) -> None:
    messages = drive(20)
    whole = read_recording(write_split(tmp_path / "whole.mcap", messages))
    parts = [messages[:11], messages[11:30], messages[30:]]
    split = read_recording(bag(tmp_path / "bag", parts, pack_messages=pack_messages, pack_file=pack_file))
    assert as_text(split) == as_text(whole)
    assert len(split.scans) == 20
    assert split.problems == []


def test_splits_that_overlap_give_each_scan_its_own_odometry(tmp_path: Path) -> None:
    messages = drive(20)
    mount, steps = messages[:1], messages[1:]
    overlapping = read_recording(bag(tmp_path / "bag", [mount + steps[0::4] + steps[1::4], steps[2::4] + steps[3::4]]))
    whole = read_recording(write_split(tmp_path / "whole.mcap", messages))
    assert sorted(as_text(overlapping), key=str) == sorted(as_text(whole), key=str)


def test_every_cut_of_a_message_costs_that_message_only(tmp_path: Path) -> None:
    messages = drive(20)
    topic, kind, at_ns, data = messages[20]
    assert topic == graph.SCAN.name
    for length in (0, 1, 3, 4, 5, 20, 60, len(data) - 40, len(data) - 1):
        cut = [*messages[:20], (topic, kind, at_ns, data[:length]), *messages[21:]]
        read = read_recording(write_split(tmp_path / f"{length}.mcap", cut))
        assert len(read.scans) == 19
        assert read.problems == ["/scan: 1 messages do not fit their type"]


def test_map_is_built_from_a_folder_without_one_split(tmp_path: Path) -> None:
    messages = drive(30)
    folder = bag(tmp_path / "bag", [messages[:31], messages[31:51], messages[51:]])
    (folder / "bag_1.mcap").unlink()
    done = CliRunner().invoke(app, ["build", str(folder), "--out", str(tmp_path / "map"), "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["scans"] == 20
    assert "bag_1.mcap: no such file, but metadata.yaml lists it" in done.stderr


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.db3", b"SQLite format 3\0", "sqlite3 storage"),
        ("a.bag", b"#ROSBAG V2.0\n", "ROS 1"),
        ("a.mcap.zstd", b"\x28\xb5\x2f\xfd", "is empty"),
    ],
)
def test_other_recordings_are_usage_errors(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    (tmp_path / name).write_bytes(content)
    done = CliRunner().invoke(app, ["build", str(tmp_path / name), "--out", str(tmp_path / "map")])
    assert done.exit_code == 2
    assert words in done.stderr
