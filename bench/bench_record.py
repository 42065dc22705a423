"""The recorder under the load of a mission: CPU time and lost messages, compared with a recorder that uses callbacks.

Limit: 8 % of a core. Another process publishes the recorded topics at the rates of a mission in the simulator, with messages of
realistic size. Lost messages are counted on the topics of which every message is to be recorded.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import psutil

from lupin_runtime import graph
from lupin_runtime.record.reader import Recording
from lupin_runtime.record.recorded_topics import STANDARD, camera_topics
from lupin_runtime.stack.dds import claim_domain, loopback_environment

LIMIT_PERCENT = 8.0
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


def measure(role: str, seconds: float, folder: Path) -> dict[str, Any]:
    """Measure one of the recorders, `recorder` or `callbacks`, under the load in a separate DDS domain."""
    claim = claim_domain()
    environment = loopback_environment(claim.domain, folder)
    output = folder / f"{role}.mcap"
    command = [sys.executable, "-m", "bench.bench_record"]
    recorder = psutil.Popen([*command, "--as", role, "--output", str(output)], env=environment, stderr=subprocess.DEVNULL)
    load = psutil.Popen(
        [*command, "--as", "load", "--seconds", str(seconds + WARM_UP_S)], env=environment, stdout=subprocess.PIPE
    )
    try:
        time.sleep(WARM_UP_S)
        before, started = recorder.cpu_times(), time.monotonic()
        time.sleep(seconds - END_MARGIN_S)
        after, wall_s = recorder.cpu_times(), time.monotonic() - started
        memory_mb = recorder.memory_full_info().pss / 1e6
        sent = json.loads(load.communicate(timeout=60)[0])
        recorder.terminate()
        recorder.wait(20)
    finally:
        for process in (recorder, load):
            if process.is_running():
                process.kill()
        claim.release()
    recorded = {topic.channel.topic: topic.messages for topic in Recording(output).summary().topics}
    in_full = [row.topic.name for row in RECORDED if row.max_rate_hz is None and row.topic.name in sent]
    used_s = (after.user + after.system) - (before.user + before.system)
    return {
        "cpu_percent": round(100.0 * used_s / wall_s, 2),
        "memory_mb": round(memory_mb, 1),
        "sent": sum(sent.values()),
        "sent_on_topics_recorded_in_full": sum(sent[name] for name in in_full),
        "lost": sum(sent[name] - recorded.get(name, 0) for name in in_full),
        "megabytes": round(output.stat().st_size / 1e6, 2),  # of the file
    }


def main() -> int:
    """Measure both recorders under load; return 1 if Lupin's exceeds the limit. With `--as`, run only one of the processes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="measure each recorder for this long")
    parser.add_argument("--json", action="store_true", help="print only the JSON line")
    parser.add_argument("--as", dest="role", choices=("load", "recorder", "callbacks"), help=argparse.SUPPRESS)
    parser.add_argument("--output", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.role == "load":
        return publish(options.seconds)
    if options.role:
        return record(options.output, options.role == "callbacks")
    with tempfile.TemporaryDirectory() as folder:
        ours, callbacks = (measure(role, options.seconds, Path(folder)) for role in ("recorder", "callbacks"))
    result = {
        "recorder": ours,
        "callback_recorder": callbacks,
        "messages_per_s": round(ours["sent"] / (options.seconds + WARM_UP_S - START_DELAY_S)),
        "limit_percent": LIMIT_PERCENT,
        "ratio_to_limit": round(ours["cpu_percent"] / LIMIT_PERCENT, 2),
        "ratio_to_callback_recorder": round(ours["cpu_percent"] / callbacks["cpu_percent"], 2),
    }
    if not options.json:
        for name, row in (("recorder", ours), ("callback_recorder", callbacks)):
            lost = f"{row['lost']} of {row['sent_on_topics_recorded_in_full']} messages lost on topics recorded in full"
            print(f"{name}: {row['cpu_percent']} % of a core, {row['memory_mb']} MB, {lost}")
        print(f"{result['messages_per_s']} messages/s, ratio to limit {result['ratio_to_limit']}")
    print(json.dumps(result))
    return 0 if ours["cpu_percent"] <= LIMIT_PERCENT else 1


if __name__ == "__main__":
    sys.exit(main())
