"""The recorder and the player as processes on a graph, also when killed or out of disk space."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.record.reader import Recording
from tests.support.optional import present
from tests.support.rosbag2_folders import write_split
from tests.support.waiting import WAIT_S, wait_for_nothing, wait_until

if TYPE_CHECKING:
    from geometry_msgs.msg import Twist
    from nav_msgs.msg import OccupancyGrid
    from std_msgs.msg import Bool

    from lupin_runtime.graph import Topic
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


def count(path: Path, topic: str) -> int:
    return sum(1 for _ in Recording(path).raw({topic})) if path.exists() else 0


def run_recorder(output: Path, **parameters: object) -> subprocess.Popen[str]:
    code = (
        "import sys, json; from lupin_runtime.ros import run; from lupin_runtime.record.node import Recorder;"
        "sys.exit(run([lambda: Recorder(json.loads(sys.argv[1]))]))"
    )
    arguments = json.dumps({"output": str(output), **parameters})
    return subprocess.Popen([sys.executable, "-c", code, arguments], stderr=subprocess.PIPE, text=True)


def messages() -> dict[Topic, Twist | OccupancyGrid | Bool]:
    from geometry_msgs.msg import Twist
    from nav_msgs.msg import OccupancyGrid
    from std_msgs.msg import Bool

    twist = Twist()
    twist.linear.x = 0.25
    grid = OccupancyGrid(data=[-1, 0, 100, 50])
    grid.info.width = grid.info.height = 2
    return {graph.CMD_VEL_SINK_SIM: twist, graph.MAP: grid, graph.ESTOP_STATE: Bool(data=True)}


def test_recorder_records_topics_of_every_qos(graph_host: GraphHost, tmp_path: Path) -> None:
    from lupin_runtime.record.node import Recorder
    from lupin_runtime.ros import LupinNode

    source = graph_host.add(LupinNode("source"))
    publishers = {row: source.publisher(row) for row in messages()}
    publishers[graph.MAP].publish(messages()[graph.MAP])  # latched, before the recorder starts
    recorder = graph_host.add(Recorder({"output": str(tmp_path / "r.mcap")}))
    moving = (graph.CMD_VEL_SINK_SIM, graph.ESTOP_STATE)
    wait_until(lambda: all(publishers[row].get_subscription_count() for row in publishers), "the recorder listens")
    for _ in range(50):
        for row in moving:
            publishers[row].publish(messages()[row])
        time.sleep(0.01)
    # The messages that are queued when the process is stopped are recorded too.
    recorder.before_shutdown()
    recording = Recording(tmp_path / "r.mcap")
    got = {row.name: [m.message for m in recording.messages({row.name})] for row in messages()}
    assert [len(got[row.name]) for row in (graph.MAP, *moving)] == [1, 50, 50]
    for row, message in messages().items():
        assert all(received == message for received in got[row.name])
    assert recording.damage == []


def test_recorded_times_are_ros_time_in_arrival_order(graph_host: GraphHost, tmp_path: Path) -> None:
    from std_msgs.msg import Bool

    from lupin_runtime.record.node import Recorder
    from lupin_runtime.ros import LupinNode

    source = graph_host.add(LupinNode("source"))
    stop, hmi = source.publisher(graph.ESTOP_STATE), source.publisher(graph.HMI_ESTOP)
    recorder = graph_host.add(Recorder({"output": str(tmp_path / "r.mcap")}))
    wait_until(lambda: stop.get_subscription_count() and hmi.get_subscription_count(), "the recorder listens")
    entries = {entry.row.topic: entry for entry in recorder._recorded}
    sent = []

    def send(publisher: Any, entry: Any) -> None:
        taken_ns = entry.kept_ns
        sent.append(time.time_ns())
        publisher.publish(Bool())
        wait_until(lambda: entry.kept_ns != taken_ns, "the message")

    for _ in range(10):
        send(hmi, entries[graph.HMI_ESTOP])
        send(stop, entries[graph.ESTOP_STATE])
    recorder.before_shutdown()
    read = list(Recording(tmp_path / "r.mcap").raw({graph.ESTOP_STATE.name, graph.HMI_ESTOP.name}))
    assert [m.topic for m in read] == [graph.HMI_ESTOP.name, graph.ESTOP_STATE.name] * 10
    # The recorder converts them between two clocks, which it cannot read at the same moment.
    assert all(sent_ns - 10**9 < m.log_ns < time.time_ns() for m, sent_ns in zip(read, sent))


def test_limited_topic_is_recorded_after_the_clock_steps_back(
    graph_host: GraphHost, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from std_msgs.msg import Bool

    from lupin_runtime.record import node
    from lupin_runtime.record.recorded_topics import Recorded
    from lupin_runtime.ros import LupinNode

    source = graph_host.add(LupinNode("source"))
    stop = source.publisher(graph.ESTOP_STATE)
    monkeypatch.setattr(node, "STANDARD", (Recorded(graph.ESTOP_STATE, max_rate_hz=20.0),))
    recorder = graph_host.add(node.Recorder({"output": str(tmp_path / "r.mcap")}))
    wait_until(stop.get_subscription_count, "the recorder listens")
    entry = next(entry for entry in recorder._recorded if entry.row.topic is graph.ESTOP_STATE)
    stop.publish(Bool())
    wait_until(lambda: entry.channel is not None, "the first message")
    wall_ns, first_ns = time.time_ns, entry.kept_ns
    monkeypatch.setattr(time, "time_ns", lambda: wall_ns() - 3600 * 10**9)
    stop.publish(Bool())
    wait_until(lambda: entry.kept_ns != first_ns, "the second message")
    recorder.before_shutdown()
    assert count(tmp_path / "r.mcap", graph.ESTOP_STATE.name) == 2


def test_gripper_camera_is_recorded_only_while_scanning(graph_host: GraphHost, tmp_path: Path) -> None:
    from lupin_msgs.msg import MissionState
    from sensor_msgs.msg import CompressedImage

    from lupin_runtime.record.node import Recorder
    from lupin_runtime.record.recorded_topics import GRIPPER_CAMERA
    from lupin_runtime.ros import LupinNode

    source = graph_host.add(LupinNode("source"))
    state, camera = source.publisher(graph.MISSION_STATE), source.publisher(GRIPPER_CAMERA)
    recorder = graph_host.add(Recorder({"output": str(tmp_path / "r.mcap"), "gripper_images_hz": 20.0}))
    wait_until(lambda: state.get_subscription_count(), "the recorder follows the mission")
    assert camera.get_subscription_count() == 0
    state.publish(MissionState(lifecycle_state="MONITORING", mission_phase="SCANNING"))
    wait_until(lambda: camera.get_subscription_count(), "the camera is recorded while scanning")
    entry = next(entry for entry in recorder._recorded if entry.row.topic is GRIPPER_CAMERA)
    camera.publish(CompressedImage(format="jpeg", data=[1, 2, 3]))
    wait_until(lambda: entry.channel is not None, "the image")
    state.publish(MissionState(lifecycle_state="MONITORING", mission_phase="NAVIGATING"))
    wait_until(lambda: not camera.get_subscription_count(), "the camera is left alone while driving")
    recorder.before_shutdown()
    assert count(tmp_path / "r.mcap", GRIPPER_CAMERA.name) == 1


def test_killed_recorder_loses_at_most_two_seconds(graph_host: GraphHost, tmp_path: Path) -> None:
    from geometry_msgs.msg import Twist

    from lupin_runtime.ros import LupinNode

    source = graph_host.add(LupinNode("source"))
    publisher = source.publisher(graph.CMD_VEL_NAV)
    path = tmp_path / "r.mcap"
    process = run_recorder(path, body_images="off")
    try:
        wait_until(lambda: publisher.get_subscription_count(), "the recorder listens")
        sent = []
        source.create_timer(0.02, lambda: (publisher.publish(Twist()), sent.append(time.monotonic())))  # type: ignore[func-returns-value]
        wait_until(lambda: len(sent) >= 250, "five seconds of messages")
        process.send_signal(signal.SIGKILL)
        killed = time.monotonic()
        process.wait(WAIT_S)
    finally:
        process.kill()
        present(process.stderr).close()
    recording = Recording(path)
    recorded = sum(1 for _ in recording.raw({graph.CMD_VEL_NAV.name}))
    assert recorded >= sum(at < killed - 2.5 for at in sent) > 0
    assert "killed" in recording.damage[0]


def test_full_disk_stops_the_recording_not_the_process(graph_host: GraphHost, tmp_path: Path) -> None:
    from std_msgs.msg import String

    from lupin_runtime.ros import LupinNode

    source = graph_host.add(LupinNode("source"))
    publisher = source.publisher(graph.TAG_DETECTIONS)
    path = tmp_path / "r.mcap"
    code = f"import resource, runpy, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, {resource.RLIM_INFINITY}));"
    code += (
        "from lupin_runtime.ros import run; from lupin_runtime.record.node import Recorder;"
        "sys.exit(run([lambda: Recorder({'output': sys.argv[1], 'topics': '/camera/tag_detections_json'})]))"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(path)], stderr=subprocess.PIPE, text=True)
    try:
        wait_until(lambda: publisher.get_subscription_count(), "the recorder listens")
        # Noise, which cannot be compressed.
        source.create_timer(0.02, lambda: publisher.publish(String(data=os.urandom(2000).hex())))
        wait_until(lambda: not publisher.get_subscription_count(), "the recorder lets its topics go")
        wait_for_nothing(0.5, "the end of the process")
        assert process.poll() is None
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=WAIT_S)
    finally:
        process.kill()
    assert process.returncode == 0
    assert said.count("recording of") == 1
    assert "File too large" in said
    assert path.stat().st_size <= 60_000
    assert Recording(path).summary().messages >= 0


def test_recording_ends_complete_at_its_size_limit(graph_host: GraphHost, tmp_path: Path) -> None:
    from std_msgs.msg import String

    from lupin_runtime.record.node import Recorder
    from lupin_runtime.ros import LupinNode

    source = graph_host.add(LupinNode("source"))
    publisher = source.publisher(graph.TAG_DETECTIONS)
    parameters = {"output": str(tmp_path / "r.mcap"), "topics": graph.TAG_DETECTIONS.name, "max_size_mb": 0.03}
    graph_host.add(Recorder(parameters))
    wait_until(lambda: publisher.get_subscription_count(), "the recorder listens")
    source.create_timer(0.02, lambda: publisher.publish(String(data=os.urandom(2000).hex())))
    wait_until(lambda: not publisher.get_subscription_count(), "the recorder stops at its limit")
    wait_until(lambda: Recording(tmp_path / "r.mcap").summary().damage == [], "the file has its end")
    assert Recording(tmp_path / "r.mcap").summary().messages > 5


def test_unwritable_folder_leaves_the_recorder_running(graph_host: GraphHost, tmp_path: Path) -> None:
    from lupin_runtime.record.node import Recorder

    (tmp_path / "file").write_text("in the way")
    recorder = graph_host.add(Recorder({"output": str(tmp_path / "file" / "r.mcap")}))
    recorder.before_shutdown()
    assert (tmp_path / "file").read_text() == "in the way"


def test_replay_publishes_every_recorded_byte(graph_host: GraphHost, tmp_path: Path) -> None:
    from lupin_msgs.msg import MissionState
    from rclpy.serialization import serialize_message
    from sensor_msgs.msg import LaserScan

    from lupin_runtime.record.definitions import schema_text
    from lupin_runtime.record.node import Recorder
    from lupin_runtime.record.writer import RecordingWriter

    rows = {graph.SCAN: LaserScan, graph.MISSION_STATE: MissionState}
    writer = RecordingWriter(tmp_path / "in.mcap")
    channels = {row: writer.add_channel(row.name, row.type, schema_text(row.type), row.qos) for row in rows}
    sent: dict[str, list[bytes]] = {row.name: [] for row in rows}
    for i in range(40):
        for row, kind in rows.items():
            message = kind(ranges=[float(i)] * 90) if kind is LaserScan else kind(current_target=str(i))
            sent[row.name].append(bytes(serialize_message(message)))
            writer.write(channels[row], sent[row.name][-1], 5_000_000_000 + i * 50_000_000, i)
    writer.finish()

    topics = ",".join(row.name for row in (*rows, graph.CLOCK))
    recorder = graph_host.add(Recorder({"output": str(tmp_path / "out.mcap"), "topics": topics}))
    player = subprocess.run(
        [sys.executable, "-m", "lupin_runtime.record.player", str(tmp_path / "in.mcap"), "--wait-s", "10"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert player.returncode == 0, player.stderr
    recorder.before_shutdown()
    replayed = Recording(tmp_path / "out.mcap")
    assert {row.name: [m.data for m in replayed.raw({row.name})] for row in rows} == sent
    times = [m.message.clock.sec + m.message.clock.nanosec / 1e9 for m in replayed.messages({graph.CLOCK.name})]
    assert times == sorted(times)
    assert 5.0 <= times[0] < 5.5 < 6.8 < times[-1] <= 7.0
    progress = [json.loads(line) for line in player.stdout.splitlines()]
    assert progress[-1] == {"at_s": 1.95, "of_s": 1.95, "published": 80}


@pytest.mark.usefixtures("private_graph")
def test_cut_off_message_is_not_played(tmp_path: Path) -> None:
    row = graph.ESTOP_STATE
    good = b"\x00\x01\x00\x00\x01"
    messages = [(row.name, row.type, number, data) for number, data in enumerate((good, b"", good[:2], good[:4], good))]
    write_split(tmp_path / "cut.mcap", messages)
    command = [sys.executable, "-m", "lupin_runtime.record.player", str(tmp_path / "cut.mcap")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert json.loads(done.stdout.splitlines()[-1])["published"] == 2
    assert f"{row.name}: 3 messages do not fit their type and were not played" in done.stderr


def test_interrupted_player_stops_at_once_and_exits_130(graph_host: GraphHost, tmp_path: Path) -> None:

    from lupin_runtime.record.definitions import schema_text
    from lupin_runtime.record.writer import RecordingWriter
    from lupin_runtime.ros import LupinNode

    writer = RecordingWriter(tmp_path / "long.mcap")
    row = graph.ESTOP_STATE
    channel = writer.add_channel(row.name, row.type, schema_text(row.type), row.qos)
    for i in (0, 3600):
        writer.write(channel, b"\x00\x01\x00\x00\x01", i * 1_000_000_000, i)
    writer.finish()
    received: list[Bool] = []
    listener = graph_host.add(LupinNode("listener"))
    listener.subscription(row, received.append)
    command = [sys.executable, "-m", "lupin_runtime.record.player", str(tmp_path / "long.mcap"), "--wait-s", "10"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        wait_until(lambda: received, "the first message is played")
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=WAIT_S)
    finally:
        process.kill()
    assert process.returncode == 130
