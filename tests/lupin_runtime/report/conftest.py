"""A recording of a small synthetic mission: a greenhouse with four tables and eight tags, one of them unreachable."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2, quaternion_from_yaw
from lupin_runtime.graph import Topic
from lupin_runtime.record.definitions import schema_text
from lupin_runtime.record.writer import RecordingWriter

START_NS = 2_000_000_000
WALL_START_NS = 1_773_480_413_000_000_000
SLOW_S, SLOWDOWN = (60.0, 90.0), 0.5  # for these seconds, the simulation runs at half speed
RESOLUTION_M = 0.05
WALLS = (-1.5, -1.2, 7.5, 5.4)  # x0, y0, x1, y1
TABLES = ((1.2, 0.6, 2.4, 1.0), (3.8, 0.6, 5.0, 1.0), (1.2, 2.6, 2.4, 3.0), (3.8, 2.6, 5.0, 3.0))
CLIMATE = ("temperature", "humidity", "co2", "light", "soil_moisture")
ROUTE = (
    *((0, 0), (3.1, 0.1), (5.9, -0.3), (5.9, 1.8), (3.1, 1.7), (0.3, 1.8), (0.4, 3.9), (3.1, 3.8), (6.0, 3.7), (5.9, 1.9)),
    *((3.1, 1.9), (0.2, 1.7), (0.3, -0.3), (3.1, -0.2), (5.8, -0.2), (6.0, 3.8), (3.1, 3.8), (0.3, 3.8), (0.2, 1.8), (0, 0)),
)
_VISITS_FROM = 9
HOSTILE = '<script>alert("x")</script> & </style>'


@dataclass(frozen=True)
class Plant:
    """A tag of the synthetic greenhouse: position, direction of its face, readings and flowers."""

    tag_id: str
    x: float
    y: float
    yaw: float
    readings: dict[str, float]
    species: str = "tulip_red"
    flowers: int = 4
    bugs: int = 0
    status: int = 0
    detail: str = ""


PLANTS = (
    Plant("1", 1.8, 0.6, -math.pi / 2, {"temperature": 22.4, "co2": 640.0}),
    Plant("2", 4.4, 0.6, -math.pi / 2, {"temperature": 27.9, "soil_moisture": 0.22}, "tulip_white", 5),
    Plant("3", 4.4, 1.0, math.pi / 2, {"humidity": 55.0, "light": 320.0, "co2": 1480.0}, "tulip_pink", 3, 2),
    Plant("7", 1.8, 1.0, math.pi / 2, {"temperature": 19.1, "humidity": 61.0}, "tulip_red", 6),
    Plant("9", 1.8, 2.6, -math.pi / 2, {"light": 840.0}, "tulip_white", 4),
    Plant(
        "12",
        1.8,
        3.0,
        math.pi / 2,
        {"temperature": 21.0, "humidity": 48.0, "co2": 505.0, "light": 610.0, "soil_moisture": 44.0},
    ),
    Plant("13", 4.4, 3.0, math.pi / 2, {"soil_moisture": 52.0}, "tulip_pink", 2),
    Plant("21", 5.0, 2.8, 0.0, {}, "", 0, 0, 1, "nav_status_6"),
)


@dataclass
class Writer:
    """Writes messages to a recording; a channel is added for each new topic."""

    writer: RecordingWriter
    channels: dict[str, int] = field(default_factory=dict)

    def add(self, row: Topic, t_s: float, message: Any) -> None:
        from rclpy.serialization import serialize_message

        if row.name not in self.channels:
            self.channels[row.name] = self.writer.add_channel(row.name, row.type, schema_text(row.type), row.qos)
        at_ns = START_NS + round(t_s * 1e9)
        wall_ns = WALL_START_NS + round(wall_s(t_s) * 1e9)
        self.writer.write(self.channels[row.name], bytes(serialize_message(message)), at_ns, wall_ns)


def wall_s(t_s: float) -> float:
    """Return the seconds of the wall clock that the simulation took until `t_s`."""
    slow_s = min(max(t_s - SLOW_S[0], 0.0), SLOW_S[1] - SLOW_S[0])
    return t_s + slow_s * (1.0 / SLOWDOWN - 1.0)


def stamp(t_s: float) -> Any:
    from lupin_runtime.ros import stamp_from_ns

    return stamp_from_ns(START_NS + round(t_s * 1e9))


def greenhouse() -> NDArray[np.bool_]:
    """Return the solid cells of the greenhouse, bool (height, width)."""
    x0, y0, x1, y1 = WALLS
    solid = np.zeros((round((y1 - y0) / RESOLUTION_M), round((x1 - x0) / RESOLUTION_M)), bool)
    solid[:2], solid[-2:], solid[:, :2], solid[:, -2:] = True, True, True, True
    for a, b, c, d in TABLES:
        solid[round((b - y0) / 0.05) : round((d - y0) / 0.05), round((a - x0) / 0.05) : round((c - x0) / 0.05)] = True
    return solid


def scan_from(
    solid: NDArray[np.bool_], pose: Pose2, beams: int = 180, reach_m: float = 8.0
) -> tuple[NDArray[np.float32], NDArray[np.intp], NDArray[np.intp]]:
    """Return the ranges of a lidar at `pose`, and rows and columns of the cells that its beams cross."""
    steps = np.arange(0.05, reach_m, 0.04)
    angles = pose.yaw + np.linspace(-math.pi, math.pi, beams, endpoint=False)
    rows = ((pose.y + np.sin(angles)[:, None] * steps - WALLS[1]) / RESOLUTION_M).astype(int).clip(0, solid.shape[0] - 1)
    columns = ((pose.x + np.cos(angles)[:, None] * steps - WALLS[0]) / RESOLUTION_M).astype(int).clip(0, solid.shape[1] - 1)
    hit = solid[rows, columns]
    first = np.where(hit.any(axis=1), hit.argmax(axis=1), len(steps) - 1)
    seen = np.arange(len(steps))[None, :] <= first[:, None]
    return steps[first].astype(np.float32), rows[seen], columns[seen]


def drive() -> list[tuple[float, Pose2, str]]:
    """Return (time, true pose, tag being scanned or "") at 10 Hz along the route, with a stop at each plant."""
    samples: list[tuple[float, Pose2, str]] = []
    t_s, waiting = 8.0, {p.tag_id: p for p in PLANTS if p.status == 0}
    for _ in range(80):
        samples.append((len(samples) * 0.1, Pose2(), ""))
    yaw = 0.0
    for lap, ((ax, ay), (bx, by)) in enumerate(pairwise(ROUTE)):
        length = math.hypot(bx - ax, by - ay)
        for k in range(max(1, int(length / 0.035))):
            share = k * 0.035 / length
            x, y = ax + (bx - ax) * share, ay + (by - ay) * share
            yaw += 0.15 * ((math.atan2(by - ay, bx - ax) - yaw + math.pi) % (2 * math.pi) - math.pi)
            samples.append((t_s, Pose2(x, y, yaw), ""))
            t_s += 0.1
            for plant in list(waiting.values()):
                away = math.hypot(x - plant.x - 0.8 * math.cos(plant.yaw), y - plant.y - 0.8 * math.sin(plant.yaw))
                if lap >= _VISITS_FROM and away < 0.35:
                    del waiting[plant.tag_id]
                    for _ in range(40):
                        samples.append((t_s, Pose2(x, y, yaw), plant.tag_id))
                        t_s += 0.1
    for _ in range(30):
        samples.append((t_s, Pose2(0.0, 0.0, yaw), ""))
        t_s += 0.1
    return samples


def picture(text: str, shade: int) -> bytes:
    """Return a JPEG with a text in it."""
    image = np.full((240, 320, 3), (60, 90 + shade % 90, 70), np.uint8)
    image[150:] = (70, 80, 95)
    cv2.rectangle(image, (110, 60), (210, 160), (250, 250, 250), -1)
    cv2.putText(image, text, (118, 122), cv2.FONT_HERSHEY_SIMPLEX, 0.9, (20, 20, 20), 2)
    return cv2.imencode(".jpg", image)[1].tobytes()


def write_mission(path: Path, hostile: bool = False) -> dict[str, Any]:
    """Record the mission to `path`; return its truth, in the form of the simulator's truth.json."""
    from builtin_interfaces.msg import Time
    from geometry_msgs.msg import Pose, TransformStamped, Twist
    from lupin_msgs.msg import (
        DiscoveredTag,
        DiscoveredTags,
        FlowerObservation,
        FlowerPoint,
        MissionState,
        Observation,
        SensorReading,
        TagReading,
        TwinState,
        TwinTagState,
    )
    from nav_msgs.msg import OccupancyGrid, Odometry
    from rcl_interfaces.msg import Log
    from sensor_msgs.msg import BatteryState, CompressedImage, LaserScan
    from tf2_msgs.msg import TFMessage

    out = Writer(RecordingWriter(path))
    out.writer.add_metadata("lupin", {"started_at": "2026-03-14T09:26:53+00:00", "domain": "7"})
    solid = greenhouse()
    known: NDArray[np.int8] = np.full(solid.shape, -1, np.int8)
    samples = drive()
    rng = np.random.default_rng(7)

    def transform(parent: str, child: str, t_s: float, pose: Pose2) -> TransformStamped:
        message = TransformStamped()
        message.header.frame_id, message.child_frame_id, message.header.stamp = parent, child, stamp(t_s)
        message.transform.translation.x, message.transform.translation.y = pose.x, pose.y
        q = message.transform.rotation
        q.x, q.y, q.z, q.w = quaternion_from_yaw(pose.yaw)
        return message

    def tag_pose(plant: Plant) -> Pose:
        """Return a pose whose +z points out of the tag: a rotation by 90 degrees about y, then by the tag's yaw about z."""
        pose = Pose()
        pose.position.x, pose.position.y, pose.position.z = plant.x + 0.01, plant.y - 0.02, 0.4
        half, c = plant.yaw / 2.0, math.sqrt(0.5)
        q = pose.orientation
        q.x, q.y, q.z, q.w = -math.sin(half) * c, math.cos(half) * c, math.sin(half) * c, math.cos(half) * c
        return pose

    def flower_points(plant: Plant) -> list[FlowerPoint]:
        points = []
        for k in range(plant.flowers):
            point = FlowerPoint(species=plant.species, confidence=0.9, height_m=0.2, anomaly=k < plant.bugs)
            along = (k + 0.5) / plant.flowers - 0.5
            point.position.x = plant.x - 0.2 * math.cos(plant.yaw) - along * math.sin(plant.yaw)
            point.position.y = plant.y - 0.2 * math.sin(plant.yaw) + along * math.cos(plant.yaw)
            points.append(point)
        return points

    def readings(plant: Plant) -> list[SensorReading]:
        return [SensorReading(name=name, value=value) for name, value in plant.readings.items()]

    out.add(graph.TF_STATIC, 0.0, TFMessage(transforms=[transform("base_link", "laser", 0.0, Pose2(0.1, 0.0, 0.0))]))
    discovered: dict[str, int] = {}
    read: dict[str, float] = {}
    drift = Pose2()
    map_from_odom = Pose2()
    scanning_before = ""
    end_s = samples[-1][0]
    for n, (t_s, true, scanning) in enumerate(samples):
        drift = Pose2(drift.x + rng.normal(0, 4e-4), drift.y + rng.normal(2e-4, 4e-4), drift.yaw + rng.normal(2e-5, 1e-4))
        odom = drift.inverse() @ true
        if n % 20 == 0:
            map_from_odom = Pose2(drift.x + rng.normal(0, 0.004), drift.y + rng.normal(0, 0.004), drift.yaw)
        if n == 1400:
            map_from_odom = Pose2(map_from_odom.x + 0.14, map_from_odom.y - 0.05, map_from_odom.yaw)
        moving = [transform("odom", "base_link", t_s, odom)]
        if t_s > 1.0:
            moving.append(transform("map", "odom", t_s + 0.1, map_from_odom))
        out.add(graph.TF, t_s, TFMessage(transforms=moving))
        twist = Twist()
        if n + 1 < len(samples):
            twist.linear.x = math.hypot(samples[n + 1][1].x - true.x, samples[n + 1][1].y - true.y) / 0.1
            twist.angular.z = (samples[n + 1][1].yaw - true.yaw) / 0.1
        odometry = Odometry()
        odometry.twist.twist = twist
        out.add(graph.ODOM, t_s, odometry)
        out.add(graph.CMD_VEL_SINK_SIM, t_s, twist)
        if n % 5 == 0:
            ranges, rows, columns = scan_from(solid, true)
            known[rows, columns] = np.where(solid[rows, columns], 100, 0)
            scan = LaserScan(angle_min=-math.pi, angle_increment=2 * math.pi / 180, range_min=0.05, range_max=12.0)
            scan.ranges = (ranges + rng.normal(0, 0.01, ranges.size)).astype(np.float32).tolist()
            out.add(graph.SCAN, t_s, scan)
            body = CompressedImage(format="jpeg")
            body.data = picture(f"#{scanning}" if scanning else f"{t_s:.0f} s", n)
            if n % 10 == 0:
                out.add(graph.compressed(graph.BODY_IMAGE_SIM), t_s, body)
        if n % 50 == 0:
            grid = OccupancyGrid(data=known.ravel().tolist())
            grid.info.resolution = RESOLUTION_M
            grid.info.height, grid.info.width = known.shape
            grid.info.origin.position.x, grid.info.origin.position.y = WALLS[0], WALLS[1]
            out.add(graph.MAP, t_s, grid)
            out.add(graph.BATTERY, t_s, BatteryState(percentage=max(0.2, 0.91 - t_s / 3000.0)))
        for plant in PLANTS:
            if plant.tag_id not in discovered and t_s > 9 and math.hypot(true.x - plant.x, true.y - plant.y) < 1.4:
                discovered[plant.tag_id] = 0
            if plant.tag_id in discovered:
                discovered[plant.tag_id] += n % 3 == 0
        if n % 10 == 0:
            tags = [
                DiscoveredTag(tag_id=p.tag_id, pose_in_map=tag_pose(p), species=p.species, sightings=discovered[p.tag_id])
                for p in PLANTS
                if p.tag_id in discovered
            ]
            out.add(graph.DISCOVERED_TAGS, t_s, DiscoveredTags(tags=tags))
        if scanning_before and not scanning:
            plant = next(p for p in PLANTS if p.tag_id == scanning_before)
            read[plant.tag_id] = t_s
            reading = TagReading(tag_id=plant.tag_id, readings=readings(plant), sim_time_of_day_seconds=40_000.0)
            common = {"mission_id": "lupin-0a1b2c3d", "source": "MonitoringMission", "tag_pose_in_map": tag_pose(plant)}
            out.add(graph.OBSERVATIONS, t_s, Observation(kind=0, tag_reading=reading, **common))
            look = FlowerObservation(
                tag_id=plant.tag_id,
                species=plant.species,
                confidence=0.93,
                anomaly=plant.bugs > 0,
                flower_count=plant.flowers,
                bug_count=plant.bugs,
                flowers=flower_points(plant),
            )
            out.add(graph.OBSERVATIONS, t_s, Observation(kind=1, flower=look, source="perception_aggregator"))
        if scanning != scanning_before:
            scanning_before = scanning
        if n % 2 == 0:
            target = scanning or next((p.tag_id for p in PLANTS if p.status == 0 and p.tag_id not in read), "")
            state = MissionState(mission_id="lupin-0a1b2c3d", mission_type="ExplorationMission", started_at=Time(sec=3))
            state.lifecycle_state = lifecycle(t_s, end_s)
            if state.lifecycle_state in ("BOOT", "READY"):
                state.mission_id = ""
            if state.lifecycle_state == "MONITORING":
                state.current_target = target
                state.mission_phase = "SCANNING" if scanning else "NAVIGATING"
            state.targets_total, state.targets_completed, state.targets_unreachable = 8, len(read), 1
            state.estop_engaged = state.paused = 120.0 < t_s < 131.0
            if 120.0 < t_s < 140.0:
                state.last_error, state.last_event, state.last_event_severity = "estop_engaged", "e-stop engaged", 1
            if 70.0 < t_s < 80.0:
                state.last_error = state.last_event = HOSTILE if hostile else "navigation retry"
                state.last_event_severity = 1
            out.add(graph.MISSION_STATE, t_s, state)
        if n == 1500:
            lost = next(p for p in PLANTS if p.status)
            text = HOSTILE if hostile else lost.detail
            failed = Observation(kind=0, status=lost.status, status_detail=text, source="MonitoringMission")
            failed.tag_reading.tag_id = lost.tag_id
            out.add(graph.OBSERVATIONS, t_s, failed)
        if n in (400, 800, 1600):
            text = HOSTILE if hostile else f"scan dropped: {n} beams of 180 are not finite"
            out.add(graph.ROSOUT, t_s, Log(level=30, name=HOSTILE if hostile else "slam_toolbox", msg=text))
    states = []
    for plant in PLANTS:
        if plant.status == 0:
            state = TwinTagState(tag_id=plant.tag_id, pose=tag_pose(plant), readings=readings(plant), species=plant.species)
            state.flowers, state.flower_count = flower_points(plant), plant.flowers
            state.box_footprint.points = footprint(plant)
            states.append(state)
    out.add(graph.TWIN_STATE, end_s, TwinState(tags=states))
    out.writer.finish()
    return truth()


def lifecycle(t_s: float, end_s: float) -> str:
    """Return the state of the synthetic mission at a time."""
    borders = (
        (2.0, "BOOT"),
        (5.0, "READY"),
        (8.0, "PREPARE"),
        (104.0, "EXPLORING"),
        (end_s - 22.0, "MONITORING"),
        (end_s - 3.0, "RETURNING"),
    )
    return next((name for border, name in borders if t_s < border), "DONE")


def footprint(plant: Plant) -> list[Any]:
    """Return the corners of a plant's box: front left, front right, back right, back left."""
    from geometry_msgs.msg import Point32

    nx, ny = math.cos(plant.yaw), math.sin(plant.yaw)
    corners = ((0.55, 0.0), (-0.55, 0.0), (-0.55, -0.4), (0.55, -0.4))
    return [Point32(x=plant.x - ny * a + nx * d, y=plant.y + nx * a + ny * d) for a, d in corners]


def truth() -> dict[str, Any]:
    """Return the content of the simulator's truth.json."""
    places = [(p.tag_id, p.x, p.y, p.yaw, p.status == 0) for p in PLANTS] + [("30", 7.3, 5.0, math.pi, True)]
    tags = [{"id": i, "x": x, "y": y, "z": 0.4, "yaw_normal": yaw, "reachable": free} for i, x, y, yaw, free in places]
    boxes = [
        {"id": f"box{i}", "kind": "table", "x": (a + c) / 2, "y": (b + d) / 2, "width": c - a, "depth": d - b}
        for i, (a, b, c, d) in enumerate(TABLES)
    ]
    return {
        "world": "made-up",
        "seed": 7,
        "start": {"x": 0.0, "y": 0.0, "yaw": 0.0},
        "bounds": list(WALLS),
        "tags": tags,
        "boxes": [{**box, "yaw": math.pi / 2, "height": 0.7} for box in boxes],
        "walls": [],
        "pillars": [{"id": "post", "x": 6.6, "y": 2.2, "radius": 0.1, "height": 2.0}],
    }


def facts() -> dict[str, Any]:
    """Return the supervisor's facts at the end of a run."""
    names = ("sim", "drive", "slam", "navigation", "perception", "greenhouse", "twin", "mission", "recorder")
    stages = [
        {
            "name": name,
            "phase": "stopped",
            "up_after_s": 0.9 + 0.8 * i,
            "cpu_percent": 38.0 / (i + 1),
            "memory_mb": 180.0 - 11 * i,
            "restarts": int(i == 6),
            "why": "",
        }
        for i, name in enumerate(names)
    ]
    return {
        "exit_status": 0,
        "state": "DONE",
        "sentence": "mission DONE",
        "drivable_s": 3.4,
        "ready_s": 9.8,
        "wall_time_s": 214.2,
        "memory_mb": 986.4,
        "stages": stages,
        "deaths": [{"stage": "twin", "status": "was killed by SIGKILL", "consequence": "restarted"}],
        "options": {"target": "sim", "world": "made-up"},
        "real_time_factor": 1.04,
        "sim_time_s": 210.0,
        "collisions": 0,
    }


def score(_: Path) -> dict[str, Any]:
    """Return a comparison with the truth, in the form of `lupin_sim.scoring`."""
    return {
        "tags_total": 9,
        "tags_reachable": 8,
        "tags_found": 7,
        "tags_read": 7,
        "trajectory_rmse_m": 0.0312,
        "tag_error_median_m": 0.0224,
        "tag_errors_m": {p.tag_id: 0.0224 for p in PLANTS},
        "flowers_total": 7,
        "flowers_right": 7,
        "bugs_total": 1,
        "bugs_found": 1,
        "bugs_imagined": 0,
        "map_from_world": {"x": 0.0, "y": 0.0, "yaw": 0.0},
    }


@pytest.fixture(scope="session")
def mission_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run directory with a recording and the truth, built once per session."""
    folder = tmp_path_factory.mktemp("runs") / "20260314-092653-0a1b"
    make_run(folder)
    return folder


def make_run(folder: Path, hostile: bool = False) -> None:
    """Write a run directory."""
    folder.mkdir(parents=True)
    (folder / "truth.json").write_text(json.dumps(write_mission(folder / "recording.mcap", hostile)))
    (folder / "truth_trajectory.tum").write_text("".join(f"{true_line(t_s, pose)}\n" for t_s, pose, _ in drive()))


def true_line(t_s: float, pose: Pose2) -> str:
    """Return a line of the true trajectory; its stamps are ROS time."""
    heading = f"0 0 0 {math.sin(pose.yaw / 2):.7f} {math.cos(pose.yaw / 2):.7f}"
    return f"{t_s + START_NS / 1e9:.3f} {pose.x:.5f} {pose.y:.5f} {heading}"
