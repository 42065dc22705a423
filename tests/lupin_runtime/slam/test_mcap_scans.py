"""MCAP recordings of the robot's graph, as `lupin map build` reads them."""

from __future__ import annotations

import json
import math
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from typer.testing import CliRunner

from lupin_cli.commands.map import app
from lupin_runtime import graph
from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.geometry import Pose2, quaternion_from_yaw, yaw_from_quaternion
from lupin_runtime.slam.mcap_scans import read_recording
from lupin_runtime.slam.scan import ScanReader
from lupin_runtime.transforms import Quaternion
from tests.support import slam_worlds

if TYPE_CHECKING:
    from nav_msgs.msg import Odometry
    from sensor_msgs.msg import LaserScan
    from tf2_msgs.msg import TFMessage

    from tests.support.slam_worlds import Log

pytestmark = pytest.mark.graph

START_NS = 1_700_000_000_123_456_789
MOUNT = Pose2(0.05, 0.0, math.pi / 2)


def record(
    path: Path,
    log: Log,
    scans: int,
    odometry: str = graph.ODOM.name,
    mount: str = graph.TF_STATIC.name,
    turned: Quaternion | None = None,
    names: dict[str, str] | None = None,
    edit: Callable[[int, LaserScan], None] = lambda _number, _scan: None,
) -> None:
    """Write scans with odometry between them, out of order as recorders do.

    `turned` is another rotation of the mount, whose scans go round clockwise seen from above; `names` are other frame names.
    """
    name = {each: each for each in ("base_link", "laser", "odom", "map")} | {"laser in scans": "laser"} | (names or {})
    from geometry_msgs.msg import TransformStamped
    from mcap.writer import Writer
    from nav_msgs.msg import Odometry
    from rclpy.serialization import serialize_message
    from sensor_msgs.msg import LaserScan
    from tf2_msgs.msg import TFMessage

    from lupin_runtime.ros import stamp_from_ns

    def transform(parent: str, child: str, stamp: int, pose: Pose2) -> TransformStamped:
        message = TransformStamped()
        message.header.frame_id, message.child_frame_id = name[parent], name[child]
        message.header.stamp = stamp_from_ns(stamp)
        message.transform.translation.x, message.transform.translation.y = pose.x, pose.y
        _, _, message.transform.rotation.z, message.transform.rotation.w = quaternion_from_yaw(pose.yaw)
        return message

    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=20_000)
        writer.start("ros2")
        channels = {}
        for topic, kind in (
            (graph.SCAN.name, graph.SCAN.type),
            (graph.ODOM.name, graph.ODOM.type),
            (graph.TF.name, graph.TF.type),
            (graph.TF_STATIC.name, graph.TF_STATIC.type),
        ):
            channels[topic] = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", b""))

        def put(topic: str, stamp: int, message: LaserScan | Odometry | TFMessage) -> None:
            writer.add_message(channels[topic], stamp, serialize_message(message), stamp)

        if mount:
            mounted = transform("base_link", "laser", 0, MOUNT)
            if turned is not None:
                q = mounted.transform.rotation
                q.x, q.y, q.z, q.w = turned
            put(graph.TF_STATIC.name, START_NS, TFMessage(transforms=[mounted] if mount == graph.TF_STATIC.name else []))
        for k in range(scans):
            stamp = START_NS + k * 100_000_000
            pose = Pose2(*(float(v) for v in log.odom[k]))
            scan = LaserScan(range_min=0.03, range_max=12.0, angle_increment=float(log.angles[1] - log.angles[0]))
            scan.angle_min = float(log.angles[0]) - MOUNT.yaw
            scan.header.frame_id, scan.header.stamp = name["laser in scans"], stamp_from_ns(stamp)
            scan.ranges = array("f", log.ranges[k].astype(np.float32).tobytes())
            if turned is not None:
                heading = yaw_from_quaternion(*turned)
                scan.angle_min = heading - float(log.angles[-1])
                scan.ranges = scan.ranges[::-1]
            edit(k, scan)
            if mount == graph.TF.name:
                mounted.header.stamp = stamp_from_ns(stamp)
                wheel = transform("base_link", "map", stamp, Pose2(1.0, 1.0, 0.1 * k))
                put(graph.TF.name, stamp, TFMessage(transforms=[wheel, mounted]))
            put(graph.SCAN.name, stamp, scan)
            if odometry == graph.ODOM.name:
                message = Odometry()
                message.header.stamp = stamp_from_ns(stamp)
                message.pose.pose.position.x, message.pose.pose.position.y = pose.x, pose.y
                q = message.pose.pose.orientation
                _, _, q.z, q.w = quaternion_from_yaw(pose.yaw)
                put(graph.ODOM.name, stamp + 5_000_000, message)
            elif odometry == graph.TF.name:
                other = transform("map", "odom", stamp, Pose2(9.0, 9.0, 1.0))
                put(graph.TF.name, stamp, TFMessage(transforms=[other, transform("odom", "base_link", stamp, pose)]))
        writer.finish()  # type: ignore[no-untyped-call]


@pytest.mark.parametrize("odometry", [graph.ODOM.name, graph.TF.name])
def test_recorded_scans_have_odometry_and_mount(tmp_path: Path, greenhouse_log: Log, odometry: str) -> None:
    record(tmp_path / "r.mcap", greenhouse_log, 30, odometry)
    scans = read_recording(tmp_path / "r.mcap").scans
    assert len(scans) == 30
    assert scans[3].stamp == "1700000000.423456789"
    assert scans[3].beams.mount.x == pytest.approx(0.05) and scans[3].beams.mount.yaw == pytest.approx(math.pi / 2)
    np.testing.assert_allclose([scans[9].odom.x, scans[9].odom.y], greenhouse_log.odom[9][:2], atol=1e-9)
    np.testing.assert_allclose(scans[9].ranges, greenhouse_log.ranges[9], rtol=1e-6)


def test_recording_gives_a_map_with_its_own_stamps(tmp_path: Path, greenhouse_log: Log) -> None:
    record(tmp_path / "r.mcap", greenhouse_log, 300)
    result = CliRunner().invoke(app, ["build", str(tmp_path / "r.mcap"), "--out", str(tmp_path / "map"), "--json"])
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["scans"] == 300
    rows = np.loadtxt(tmp_path / "map" / "trajectory.tum")
    poses = np.column_stack((rows[:, 1:3], 2.0 * np.arctan2(rows[:, 6], rows[:, 7])))
    # The log's laser is at the robot's origin; the mount in the recording changes the path by at most 5 cm.
    assert slam_worlds.aligned_errors(poses, greenhouse_log.truth[:300])[0].max() < 0.08
    assert (tmp_path / "map" / "trajectory.tum").read_text().startswith("1700000000.123456789 ")


def test_missing_topic_of_a_recording_is_named(tmp_path: Path, greenhouse_log: Log) -> None:
    record(tmp_path / "no_mount.mcap", greenhouse_log, 5, mount="")
    with pytest.raises(MalformedFile, match="'laser'"):
        read_recording(tmp_path / "no_mount.mcap")
    record(tmp_path / "no_odometry.mcap", greenhouse_log, 5, odometry="none")
    with pytest.raises(MalformedFile, match="'odom'"):
        read_recording(tmp_path / "no_odometry.mcap")
    record(tmp_path / "no_scan.mcap", greenhouse_log, 0)
    with pytest.raises(MalformedFile, match="/scan"):
        read_recording(tmp_path / "no_scan.mcap")


def test_truncated_recording_is_mapped_up_to_its_end(tmp_path: Path, greenhouse_log: Log) -> None:
    record(tmp_path / "whole.mcap", greenhouse_log, 400)
    whole = (tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "truncated.mcap").write_bytes(whole[: len(whole) // 2])
    read = read_recording(tmp_path / "truncated.mcap")
    assert 20 < len(read.scans) < 400
    assert read.problems
    (tmp_path / "none.mcap").write_bytes(whole[:20])
    with pytest.raises(MalformedFile, match=r"none\.mcap"):
        read_recording(tmp_path / "none.mcap")


def first_points(path: Path, number: int = 7) -> np.ndarray:
    scan = read_recording(path).scans[number]
    return ScanReader().read(scan.beams, scan.ranges).xy


HANGING = {
    "roll": (1.0, 0.0, 0.0, 0.0),
    "pitch": (0.0, 1.0, 0.0, 0.0),
    "roll and yaw": (math.cos(0.3), math.sin(0.3), 0.0, 0.0),
}


@pytest.mark.parametrize("turned", HANGING.values(), ids=HANGING)
def test_lidar_that_hangs_upside_down_sees_the_same_room(tmp_path: Path, greenhouse_log: Log, turned: Quaternion) -> None:
    record(tmp_path / "upright.mcap", greenhouse_log, 10)
    record(tmp_path / "hanging.mcap", greenhouse_log, 10, turned=turned)
    points = first_points(tmp_path / "hanging.mcap")[::-1]
    np.testing.assert_allclose(points, first_points(tmp_path / "upright.mcap"), atol=1e-5)


def test_mount_that_is_published_as_a_moving_one_is_used(tmp_path: Path, greenhouse_log: Log) -> None:
    record(tmp_path / "static.mcap", greenhouse_log, 10)
    record(tmp_path / "moving.mcap", greenhouse_log, 10, mount=graph.TF.name)
    np.testing.assert_array_equal(first_points(tmp_path / "moving.mcap"), first_points(tmp_path / "static.mcap"))
    assert read_recording(tmp_path / "moving.mcap").problems == []


def test_tilted_lidar_is_refused_with_its_angle(tmp_path: Path, greenhouse_log: Log) -> None:
    record(tmp_path / "r.mcap", greenhouse_log, 10, turned=(0.0, math.sin(math.radians(15)), 0.0, math.cos(math.radians(15))))
    result = CliRunner().invoke(app, ["build", str(tmp_path / "r.mcap"), "--out", str(tmp_path / "map")])
    assert result.exit_code == 2
    assert "the laser 'laser' is tilted by 30 degrees" in result.stderr


@pytest.mark.parametrize(
    "names",
    [{"laser in scans": "/laser"}, {"laser": "/laser"}, {"odom": "/odom", "base_link": "/base_link"}],
    ids=["scan", "laser", "odometry"],
)
@pytest.mark.parametrize("odometry", [graph.ODOM.name, graph.TF.name])
def test_leading_slash_of_a_frame_changes_nothing(
    tmp_path: Path, greenhouse_log: Log, names: dict[str, str], odometry: str
) -> None:
    record(tmp_path / "plain.mcap", greenhouse_log, 10)
    record(tmp_path / "slash.mcap", greenhouse_log, 10, odometry, names=names)
    np.testing.assert_array_equal(first_points(tmp_path / "slash.mcap"), first_points(tmp_path / "plain.mcap"))


def test_other_prefix_of_a_frame_is_another_frame(tmp_path: Path, greenhouse_log: Log) -> None:
    record(tmp_path / "r.mcap", greenhouse_log, 10, names={"laser in scans": "robot1/laser"})
    with pytest.raises(MalformedFile, match="from 'robot1/laser' to 'base_link'"):
        read_recording(tmp_path / "r.mcap")


@pytest.mark.parametrize("limit", [0.0, math.inf, math.nan])
def test_scans_without_a_range_limit_are_mapped(tmp_path: Path, greenhouse_log: Log, limit: float) -> None:
    def edit(_: int, scan: LaserScan) -> None:
        scan.range_max = limit

    record(tmp_path / "plain.mcap", greenhouse_log, 10)
    record(tmp_path / "limitless.mcap", greenhouse_log, 10, edit=edit)
    np.testing.assert_array_equal(first_points(tmp_path / "limitless.mcap"), first_points(tmp_path / "plain.mcap"))


def test_empty_first_scans_and_varying_counts_are_mapped(tmp_path: Path, greenhouse_log: Log) -> None:
    """As of drivers that publish while the motor starts, and of those whose number of beams follows its speed."""

    def edit(number: int, scan: LaserScan) -> None:
        if number < 3:
            scan.ranges = array("f")
        elif number < 5:
            scan.ranges = array("f", [math.inf] * len(scan.ranges))
        else:
            scan.ranges = scan.ranges[: len(scan.ranges) - number % 4]

    record(tmp_path / "r.mcap", greenhouse_log, 60, edit=edit)
    result = CliRunner().invoke(app, ["build", str(tmp_path / "r.mcap"), "--out", str(tmp_path / "map"), "--json"])
    assert result.exit_code == 0, result.stderr
    built = json.loads(result.stdout)
    assert (built["scans"], built["unusable"], built["problems"]) == (57, 2, 3)
    assert "0 beams" in result.stderr
