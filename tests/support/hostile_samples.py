"""Valid files of every kind that a person, a robot or a recording hands to Lupin; its own kinds are written by itself."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import zstandard

from lupin_cli.link.dds_setup import profile_xml
from lupin_cli.playbook.journal import Journal, Mask
from lupin_runtime import graph
from lupin_runtime.arm.library import Library, StoredPose, StoredSequence, Waypoint, to_json
from lupin_runtime.console.settings import SETTINGS
from lupin_runtime.graph import Topic
from lupin_runtime.gridmap import GridMap
from lupin_runtime.layout import packaged_layout_path
from lupin_runtime.mission.overrides import Override, save_overrides
from lupin_runtime.record.definitions import schema_text
from lupin_runtime.record.writer import RecordingWriter
from lupin_runtime.slam.g2o import GraphFile, write_g2o
from lupin_runtime.slam.map_io import save_map
from lupin_runtime.slam.pose_graph import Edges
from tests.support.paths import ROOT
from tests.support.rosbag2_folders import write_metadata

RUN_ID = "20260101-120000-abcd"
HOST_KEY = "AAAAC3NzaC1lZDI1NTE5AAAAIOMqqnkVzrm0SdG6UOoqKLsabgH5C9okWi0dh2l9GKJl"
INVENTORY = """# robots of the greenhouse
default_robot = "greenhouse"

[robots.greenhouse]
user = "mirte"
transport = "wired"
ros_setup = ["source /opt/ros/humble/setup.bash"]

[robots.greenhouse.addresses]
wired = "127.0.0.1:9"
ap = "192.168.42.1"

[robots.pot-2]
addresses = { router = "10.0.0.7:2222" }
"""
PLAYBOOK = """name: sample
description: Everything that the language has.
vars:
  who: {default: ada, help: The operator}
  level: 3
  names: [a, b]
steps:
  - name: Read the host name
    on: laptop
    command: {run: "true", unless: "false"}
    when: level > 2 and who in ['ada', 'bob'] and not (level == 4 or level != 3)
    as: host
    retry: {times: 2, pause_s: 0.5}
    timeout: 10
    tags: [base]
  - name: Write {{ who }}
    file: {path: /tmp/lupin-sample, content: "level {{ level }}", mode: "0644"}
    until: host.changed
    confirm: Write it?
    undo: false
  - include: inner.yaml
"""
INNER_PLAYBOOK = """name: inner
description: Nothing.
steps:
  - name: Nothing
    on: laptop
    command: {run: 'true', unless: 'false'}
    always: true
"""
SSH_CONFIG = """Include config.d/*
Host greenhouse pot-*
    HostName 127.0.0.1
    Port 9
    User mirte
    IdentityFile ~/.ssh/id_ed25519
    IdentitiesOnly yes
Host jump
    ProxyJump bob@127.0.0.1:9
Match host other
    ProxyCommand none
"""
CALIBRATION = """image_width: 640
image_height: 480
camera_name: body
camera_matrix: {rows: 3, cols: 3, data: [600.0, 0.0, 320.0, 0.0, 600.0, 240.0, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, -0.2, 0.001, 0.001, 0.0]}
"""
CAMERAS = "color: {width: 640, height: 480, rate_hz: 15}\ndepth: {enabled: true}\npoint_cloud: {enabled: false}\n"
LOG = "[INFO] [1767268800.123456789] [nav]: going to tag 5\n[WARN] [1767268801.5] [nav]: blocked\nTraceback\n  ValueError\n"


def write_maps(folder: Path) -> None:
    """Write the same map with a binary PGM, a plain PGM and a PNG: map.yaml, plain.yaml, picture.yaml."""
    cells = np.zeros((24, 32), np.int8)
    cells[0], cells[-1], cells[:, 0], cells[:, -1], cells[8:12, 10] = 100, 100, 100, 100, 100
    cells[20:22, 20:22] = -1
    save_map(folder / "map.yaml", GridMap(cells, 0.05, -0.8, -0.6))
    header = (folder / "map.yaml").read_text()
    pixels = np.frombuffer((folder / "map.pgm").read_bytes()[-24 * 32 :], np.uint8).reshape(24, 32)
    rows = "\n".join(" ".join(map(str, row)) for row in pixels.tolist())
    (folder / "plain.pgm").write_text(f"P2\n# plain\n32 24\n255\n{rows}\n")
    (folder / "plain.yaml").write_text(header.replace("map.pgm", "plain.pgm"))
    (folder / "picture.png").write_bytes(cv2.imencode(".png", pixels)[1].tobytes())
    (folder / "picture.yaml").write_text(header.replace("map.pgm", "picture.png"))


def write_graph(path: Path) -> None:
    """Write a pose graph of a square that closes."""
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 1.57], [1.0, 1.0, 3.14], [0.0, 1.0, -1.57]])
    ends = np.array([0, 1, 2, 3])
    edges = Edges(ends, np.roll(ends, -1), np.tile([1.0, 0.02, 1.57], (4, 1)), np.tile(np.eye(3) * 100.0, (4, 1, 1)))
    write_g2o(path, GraphFile(np.arange(4), poses, edges, np.zeros(1, np.int64)))


def write_carmen(path: Path) -> None:
    """Write a CARMEN log of a robot that moves along a wall."""
    lines = ["PARAM robot_frontlaser_offset 0.1 nohost 0"]
    for step in range(5):
        ranges = " ".join(f"{2.0 + 0.3 * math.sin(beam / 9.0):.2f}" for beam in range(180))
        pose = f"{0.2 * step:.3f} 0.0 0.0"
        lines.append(f"FLASER 180 {ranges} {pose} {pose} {step}.5 host {step}.5")
    path.write_text("\n".join(lines) + "\n")


def write_bag(folder: Path) -> None:
    """Write a rosbag2 folder with two splits, of which one is packed."""
    folder.mkdir()
    write_recording(folder / "bag_0.mcap")
    (folder / "bag_1.mcap.zstd").write_bytes(zstandard.compress((folder / "bag_0.mcap").read_bytes()))
    write_metadata(folder, ["bag_0.mcap", "bag_1.mcap.zstd"], compression_mode="FILE", compression_format="zstd")


def write_recording(path: Path) -> None:
    """Write a recording of a few scans, poses and messages of the mission."""
    from geometry_msgs.msg import TransformStamped
    from nav_msgs.msg import OccupancyGrid, Odometry
    from rclpy.serialization import serialize_message
    from sensor_msgs.msg import LaserScan
    from tf2_msgs.msg import TFMessage

    writer = RecordingWriter(path)
    writer.add_metadata("lupin", {"world": "demo"})
    mount = TransformStamped()
    mount.header.frame_id, mount.child_frame_id = graph.BASE_FRAME, "laser"
    mount.transform.rotation.w = 1.0
    _record(writer, graph.TF_STATIC, serialize_message(TFMessage(transforms=[mount])), 0)
    grid = OccupancyGrid()
    grid.header.frame_id = graph.MAP_FRAME
    grid.info.resolution, grid.info.width, grid.info.height, grid.info.origin.orientation.w = 0.05, 20, 10, 1.0
    grid.data = [0] * 200
    _record(writer, graph.MAP, serialize_message(grid), 0)
    for step in range(6):
        stamp_ns = 1_000_000_000 + step * 200_000_000
        odometry = Odometry()
        odometry.header.stamp.sec, odometry.header.stamp.nanosec = stamp_ns // 10**9, stamp_ns % 10**9
        odometry.header.frame_id, odometry.child_frame_id = graph.ODOM_FRAME, graph.BASE_FRAME
        odometry.pose.pose.position.x, odometry.pose.pose.orientation.w = 0.1 * step, 1.0
        _record(writer, graph.ODOM, serialize_message(odometry), stamp_ns)
        scan = LaserScan(angle_min=-3.0, angle_max=3.0, angle_increment=0.1, range_min=0.1, range_max=12.0)
        scan.header.stamp, scan.header.frame_id = odometry.header.stamp, "laser"
        scan.ranges = [2.0 + 0.3 * math.sin(beam / 5.0) for beam in range(61)]
        _record(writer, graph.SCAN, serialize_message(scan), stamp_ns)
        writer.flush()
    writer.finish()


_channels: dict[tuple[int, str], int] = {}


def _record(writer: RecordingWriter, topic: Topic, data: bytes, stamp_ns: int) -> None:
    key = (id(writer), topic.name)
    if key not in _channels:
        _channels[key] = writer.add_channel(topic.name, topic.type, schema_text(topic.type), topic.qos)
    writer.write(_channels[key], data, stamp_ns, stamp_ns)


def stage(name: str) -> dict[str, Any]:
    """Return a process as the supervisor writes it to state.json."""
    return {
        "name": name, "phase": "up", "optional": False, "pid": 4_000_000, "start_ticks": 12345, "trouble": "",
        "up_after_s": 1.5, "waiting_for": ["topic /scan"], "waiting_s": 2.0, "cpu_percent": 12.5,
        "memory_mb": 80.1, "restarts": 1, "why": "",
    }  # fmt: skip


def run_files() -> dict[str, dict[str, Any]]:
    """Return the JSON files of a run by name, with every value that readers use."""
    mission = {
        "mission_id": "m1", "mission": "ExplorationMission", "lifecycle_state": "EXPLORING", "mission_phase": "DRIVING",
        "current_target": "5", "estop_engaged": True, "paused": True, "battery_low": True, "tags_discovered": 3,
        "targets_total": 8, "targets_completed": 2, "targets_failed": 1, "targets_unreachable": 0, "last_event": "tag 5 seen",
    }  # fmt: skip
    death = {"stage": "nav", "status": "was killed", "consequence": "it was started again", "ends_run": False}
    outcome = {
        "state": "LOST", "sentence": "slam crashed and its map is lost", "wall_time_s": 65.2, "mission": mission,
        "deaths": [death], "exit_status": 1, "failed_process": "slam",
    }  # fmt: skip
    return {
        "run.json": {
            "started": 1767268800.5, "options": {"world": "demo", "mission": True, "target": "sim"}, "version": "0.1.0",
        },
        "state.json": {
            "id": RUN_ID, "age_s": 12.5, "monotonic_s": time.monotonic(), "stages": [stage("sim"), stage("nav")],
            "deaths": [death], "memory_peak_mb": 512.5, "silent_s": {"/scan": 2.5}, "rates_hz": {"/scan": 9.9},
            "alarms": ["a node bypasses the drive bus"], "mission": mission, "outcome": outcome,
        },
        "result.json": {"outcome": outcome, "tags_read": 2, "tags_found": 3, "distance_m": 12.5},
    }  # fmt: skip


def write_run(state: Path) -> Path:
    """Write an ended run with logs and a recording into a folder of Lupin's state; return the run's folder."""
    folder = state / "lupin" / "runs" / RUN_ID
    (folder / "logs").mkdir(parents=True)
    for name, content in run_files().items():
        (folder / name).write_text(json.dumps(content))
    (folder / "logs" / "nav.log").write_text(LOG)
    write_recording(folder / "recording.mcap")
    return folder


def write_journal(folder: Path) -> Path:
    """Write the journal of a playbook run that failed at its second step."""
    journal = Journal.begin(
        folder, "sample", "pot-1", Mask(), {
            "playbook": "sample", "file": "/p/sample.yaml", "robot": "pot-1", "digest": "d", "variables": {"who": "ada"},
            "secrets": ["key"], "from_step": "", "exclusive": True, "command": "lupin play sample", "operator": "ada@desk",
            "tags": ["base"],
        }
    )  # fmt: skip
    for index in range(2):
        journal.write("step", index=index, name="Write", operation="file", machine="robot", arguments={"path": "/x"}, undo=True)
        journal.write("change", index=index, summary="written", diff="-a\n+b", before={"content": "a"})
        journal.write("output", index=index, text="line\nline")
        journal.write("step-end", index=index, state="changed", error="", duration_s=1.5, result={"changed": True})
    journal.write("end", state="failed", closed=True)
    journal.close()
    return journal.path


def settings_text() -> str:
    """Return the console's file of settings with every default."""
    return json.dumps({setting.name: setting.default for setting in SETTINGS if setting.shared}, indent=1)


def locations_text() -> str:
    """Return the console's file of named locations."""
    return json.dumps({"dock": {"x": 1.0, "y": 2.0, "yaw": 0.5}, "door": {"x": -1.0, "y": 0.0, "yaw": 0.0}})


def sessions_text() -> str:
    """Return the console's file of paired browsers."""
    row = {"name": "phone", "role": "operator", "token_sha256": "ab" * 32, "paired_s": 1767268800.0, "used_s": 1767268900.0}
    return json.dumps({"sessions": [row]})


def library_text() -> str:
    """Return an arm's library with a pose and a sequence."""
    arm = (0.1, 0.2, 0.3, 0.4)
    points = (Waypoint(0.0, arm, 0.1), Waypoint(1.5, arm, 0.2))
    poses = {"pick": StoredPose(arm, 0.1, "2026-01-01T12:00:00+00:00", "over the pot")}
    return to_json(Library(poses, {"wave": StoredSequence("teleop", True, 1.5, points, "2026-01-01T12:00:00+00:00")}))


def layout_text() -> str:
    """Return the layout of a greenhouse that Lupin ships."""
    return packaged_layout_path().read_text()


def dds_profile() -> str:
    """Return the profile that `lupin dds setup` writes."""
    return profile_xml("10.42.0.1")


def write_approach_overrides(path: Path) -> None:
    """Write the overrides of two approaches."""
    save_overrides(path, {"5": Override(1.0, 2.0, 0.5, 0.3), "7": Override(standoff=0.4)})


def shipped_playbook(name: str) -> str:
    """Return the text of a playbook that Lupin ships."""
    return (ROOT / "playbooks" / name).read_text()
