"""The recorder under the load of a mission: CPU time and lost messages, compared with a recorder that uses callbacks.

Another process publishes the recorded topics at the rates of a mission in the simulator, with messages of realistic size. Lost
messages are counted on the topics of which every message is to be recorded.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import psutil

from bench.processes import child_command, private_graph, terminate
from bench.runner import Figures, Seconds, benchmark
from lupin_runtime import graph
from lupin_runtime.record.reader import Recording
from lupin_runtime.record.recorded_topics import STANDARD, camera_topics

WARM_UP_S = 4.0  # until both processes have started and the load is published
START_DELAY_S = 1.0  # the load is published only after this, when its publishers are matched; part of WARM_UP_S
END_MARGIN_S = 1.0  # CPU time is measured until this long before the load ends
RECORDED = STANDARD + camera_topics(body="always", gripper="off", body_hz=1.0, gripper_hz=2.0)
# Rates during a mission: of topics without a nominal rate, and of /tf, which several processes publish.
MISSION_HZ = {
    graph.TAG_DETECTIONS.name: 10.0,
    graph.FLOWER_DETECTIONS.name: 5.0,
    graph.PLAN.name: 1.0,
    graph.ROSOUT.name: 1.0,
    graph.OBSERVATIONS.name: 0.2,
    graph.TF.name: 60.0,
}
UNPUBLISHED = {  # during a mission in the simulator
    graph.CMD_VEL_JOY.name,
    graph.CMD_VEL_SINK_ROBOT.name,
    graph.TF_STATIC.name,
    graph.compressed(graph.BODY_IMAGE_ROBOT).name,
    graph.compressed(graph.GRIPPER_IMAGE).name,
}


@dataclass
class LoadTopic:
    """A topic that is published at a fixed rate. Times are in seconds of the monotonic clock."""

    name: str
    publisher: Any
    message: Any
    period_s: float
    next_s: float = 0.0
    sent: int = 0


def make_message(message_type: Any, topic_name: str) -> Any:
    """Return a message of realistic size."""
    message = message_type()
    if topic_name == graph.SCAN.name:
        message.ranges = message.intensities = [1.0] * 360
    elif topic_name == graph.MAP.name:
        message.data = [0] * (300 * 300)
    elif topic_name.endswith("/compressed"):
        message.data = list(os.urandom(25_000))
    elif topic_name == graph.TF.name:
        message.transforms = [_transform(), _transform()]
    elif topic_name == graph.JOINT_STATES.name:
        message.name, message.position = [f"joint_{i}" for i in range(9)], [0.0] * 9
    elif topic_name == graph.TAG_DETECTIONS.name:
        message.data = json.dumps([{"id": 41, "corners": [[10.5, 10.5]] * 4, "dist": 0.83}] * 2)
    return message


def _transform() -> Any:
    from geometry_msgs.msg import TransformStamped

    message = TransformStamped(child_frame_id="base_link")
    message.header.frame_id = "odom"
    return message


def publish(seconds: float) -> int:
    """Publish the load for some seconds, and print the number of sent messages per topic as JSON."""
    import rclpy

    from lupin_runtime.ros import LupinNode
    from lupin_runtime.ros.interfaces import interface

    rclpy.init(args=[])
    node = LupinNode("load")
    load = []
    for row in RECORDED:
        topic = row.topic
        rate_hz = MISSION_HZ.get(topic.name) or topic.rate_hz
        if rate_hz and topic.name not in UNPUBLISHED:
            message = make_message(interface(topic.type), topic.name)
            load.append(LoadTopic(topic.name, node.publisher(topic), message, 1.0 / rate_hz))
    started = time.monotonic()
    for each in load:
        each.next_s = started + START_DELAY_S
    while (now := time.monotonic()) < started + seconds:
        for each in load:
            if now >= each.next_s:
                each.publisher.publish(each.message)
                each.next_s += each.period_s
                each.sent += 1
        time.sleep(0.002)
    time.sleep(1.0)  # until the last messages have arrived
    print(json.dumps({each.name: each.sent for each in load}))
    return 0


def record(output: str, with_callbacks: bool) -> int:
    """Run Lupin's recorder, or one whose executor calls Python for every message.

    Lupin's recorder takes the messages of all topics from the middleware at fixed intervals, without an executor.
    """
    from lupin_runtime.ros import run

    if not with_callbacks:
        from lupin_runtime.record.node import Recorder

        return run([lambda: Recorder({"output": output})])

    from lupin_runtime.record.definitions import schema_text
    from lupin_runtime.record.writer import RecordingWriter
    from lupin_runtime.ros import LupinNode

    class CallbackRecorder(LupinNode):
        """Records every message of the topics, serialized, in the callbacks of subscriptions."""

        def __init__(self) -> None:
            super().__init__("callback_recorder")
            self.writer = RecordingWriter(Path(output))
            for row in RECORDED:
                topic = row.topic
                channel = self.writer.add_channel(topic.name, topic.type, schema_text(topic.type), topic.qos)
                self.subscription(topic, partial(self.write, channel), row.qos(), raw=True)
            self.create_timer(2.0, self.writer.flush)

        def write(self, channel: int, data: bytes) -> None:
            self.writer.write(channel, data, self.now_ns(), 0)

        def before_shutdown(self) -> None:
            self.writer.finish()

    return run([CallbackRecorder])


def measure(seconds: float, with_callbacks: bool) -> dict[str, Any]:
    """Measure one of the recorders under the load, on a private graph."""
    with private_graph() as environment, tempfile.TemporaryDirectory() as folder, ExitStack() as exits:
        output = Path(folder) / "record.mcap"
        record_command = child_command(record, output=str(output), with_callbacks=with_callbacks)
        process = subprocess.Popen(record_command, env=environment, stderr=subprocess.DEVNULL)
        exits.callback(terminate, process, 20.0)
        load_command = child_command(publish, seconds=seconds + WARM_UP_S)
        load = subprocess.Popen(load_command, env=environment, stdout=subprocess.PIPE)
        exits.callback(terminate, load)
        recorder = psutil.Process(process.pid)
        time.sleep(WARM_UP_S)
        before, started = recorder.cpu_times(), time.monotonic()
        time.sleep(seconds - END_MARGIN_S)
        after, wall_s = recorder.cpu_times(), time.monotonic() - started
        memory_mb = recorder.memory_full_info().pss / 1e6
        sent = json.loads(load.communicate(timeout=60)[0])
        terminate(process, 20.0)
        summary, size_mb = Recording(output).summary(), output.stat().st_size / 1e6
    recorded = {topic.channel.topic: topic.messages for topic in summary.topics}
    in_full = [row.topic.name for row in RECORDED if row.max_rate_hz is None and row.topic.name in sent]
    used_s = (after.user + after.system) - (before.user + before.system)
    return {
        "cpu_percent": 100.0 * used_s / wall_s,
        "memory_mb": memory_mb,
        "sent": sum(sent.values()),
        "sent_on_topics_recorded_in_full": sum(sent[name] for name in in_full),
        "lost": sum(sent[name] - recorded.get(name, 0) for name in in_full),
        "megabytes": size_mb,  # of the file
    }


@benchmark(at_most={"recorder.cpu_percent": 8.0})
def main(seconds: Seconds = 20.0) -> Figures:
    """Measure both recorders under load."""
    ours, callbacks = (measure(seconds, with_callbacks) for with_callbacks in (False, True))
    return {
        "recorders": {"recorder": ours, "callback_recorder": callbacks},
        "messages_per_s": ours["sent"] / (seconds + WARM_UP_S - START_DELAY_S),
        "ratio_to_callback_recorder": ours["cpu_percent"] / callbacks["cpu_percent"],
    }


if __name__ == "__main__":
    sys.exit(main())
