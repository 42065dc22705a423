"""`lupin_recorder`: takes serialized messages from the graph and writes them to an MCAP file.

No executor waits for the subscriptions. A steady timer empties their queues twenty times a second, at a fifth of the cost of
one callback per message; the middleware's receive stamps keep the times exact.
"""

from __future__ import annotations

import os
import shutil
import threading
import time
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from lupin_runtime import graph
from lupin_runtime.record.definitions import schema_text
from lupin_runtime.record.recorded_topics import STANDARD, Recorded, camera_topics, select_topics
from lupin_runtime.record.writer import RecordingStopped, RecordingWriter, free_name
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.interfaces import interface
from lupin_runtime.ros.node import qos_profile
from lupin_runtime.ros.polled_subscription import PolledGroup

DRAIN_PERIOD_S = 0.05
# A recorder that is killed loses at most this much.
FLUSH_PERIOD_S = 2.0
# Discovery of publishers takes time, so silent topics are checked only after this.
MISMATCH_CHECK_S = 10.0
# Messages wait at most this long for a first /clock; then the recording starts at time zero.
CLOCK_PATIENCE_S = 30.0

_SCANNING_PHASES = ("SCANNING", "CONFIRMING")


@dataclass
class _RecordedTopic:
    """A recorded topic with its subscription, while there is one, and its channel in the file, once it has a message."""

    row: Recorded
    kind: type
    subscription: Subscription | None = None
    channel: int | None = None
    kept_ns: int | None = None  # when its last message was taken, on the monotonic clock

    def is_due(self, now_ns: int) -> bool:
        """Return whether the next message is to be kept. `now_ns` is monotonic: the wall clock may be set while recording."""
        limit_hz = self.row.max_rate_hz
        if limit_hz is None or self.kept_ns is None:
            return True
        return now_ns - self.kept_ns >= (1.0 / limit_hz - DRAIN_PERIOD_S / 2.0) * 1e9


@dataclass(frozen=True)
class _Message:
    entry: _RecordedTopic
    data: bytes
    received_ns: int
    sequence: int


class Recorder(LupinNode):
    """Records the graph to one file. A full disk stops the recording, not the process; no file is deleted or overwritten."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("lupin_recorder", parameters)
        output = Path(self.parameter("output", "recording.mcap"))
        topics = self.parameter("topics", "")
        self._max_bytes = int(self.parameter("max_size_mb", 4096.0) * 1e6)
        self._keep_free_bytes = int(self.parameter("keep_free_mb", 200.0) * 1e6)
        images = camera_topics(
            self.parameter("body_images", "always"),
            self.parameter("gripper_images", "scanning"),
            self.parameter("body_images_hz", 1.0),
            self.parameter("gripper_images_hz", 2.0),
        )
        self._group = PolledGroup()
        self._recorded = self._open_topics(select_topics(topics, STANDARD + images))
        self._pending: list[_Message] = []
        self._scanning = False
        self._writer = self._open_writer(output)
        self._flushed_at_s = self._started_at_s = time.monotonic()
        self._lock = threading.Lock()
        if self._writer is not None:
            for entry in self._recorded:
                if not entry.row.while_scanning:
                    self._subscribe(entry)
            # Steady time, not ROS time: FLUSH_PERIOD_S is real time, and a stopped /clock must not let a queue fill up.
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self._drain = self.create_timer(DRAIN_PERIOD_S, self._tick, clock=steady)
            self._mismatch_check = self.create_timer(MISMATCH_CHECK_S, self._check_silent_topics, clock=steady)

    # -- opening ------------------------------------------------------------------------------------------------------
    def _open_topics(self, rows: tuple[Recorded, ...]) -> list[_RecordedTopic]:
        recorded = []
        for row in rows:
            try:
                recorded.append(_RecordedTopic(row, interface(row.topic.type)))
            except (ImportError, AttributeError) as error:
                self.get_logger().warning(f"{row.topic.name} is not recorded, as {row.topic.type} is not available: {error}")
        return recorded

    def _open_writer(self, output: Path) -> RecordingWriter | None:
        path = free_name(output)
        try:
            writer = RecordingWriter(path)
            writer.add_metadata(
                "lupin",
                {
                    "started_at": datetime.now(timezone.utc).isoformat(timespec="seconds"),
                    "domain": os.environ.get("ROS_DOMAIN_ID", "0"),
                },
            )
        except OSError as error:
            self.get_logger().error(f"nothing is recorded, because {path} cannot be written: {error.strerror or error}")
            return None
        self.get_logger().info(f"recording {len(self._recorded)} topics to {path}")
        return writer

    def _subscribe(self, entry: _RecordedTopic) -> None:
        entry.subscription = self.create_subscription(
            entry.kind,
            entry.row.topic.name,
            lambda _: None,
            qos_profile(entry.row.qos()),
            callback_group=self._group,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=True,
        )

    def _unsubscribe(self, entry: _RecordedTopic) -> None:
        if entry.subscription is not None:
            self.destroy_subscription(entry.subscription)
            entry.subscription = None

    # -- every 50 ms --------------------------------------------------------------------------------------------------
    def _tick(self) -> None:
        with self._lock:
            writer = self._writer
            if writer is None:
                return
            for entry in self._recorded:
                if entry.subscription is not None:
                    self._take(entry, entry.subscription)
            self._follow_mission()
            try:
                self._write(writer)
                if time.monotonic() - self._flushed_at_s >= FLUSH_PERIOD_S:
                    self._flush(writer)
            except RecordingStopped as error:
                self._stop(writer, f"{error.strerror}; the messages written until now remain readable", whole=False)

    def _take(self, entry: _RecordedTopic, subscription: Subscription) -> None:
        now_ns = time.monotonic_ns()
        if not entry.is_due(now_ns):
            return
        while True:
            with subscription.handle:
                taken = subscription.handle.take_message(entry.kind, True)
            if taken is None:
                return
            data, info = taken
            received_ns = info.get("received_timestamp") or time.time_ns()
            entry.kept_ns = now_ns
            self._pending.append(_Message(entry, data, received_ns, info.get("publication_sequence_number") or 0))
            if entry.row.max_rate_hz is not None:
                return

    def _follow_mission(self) -> None:
        """Subscribe to the cameras that are recorded while the mission scans a tag, and unsubscribe afterwards."""
        state = next((t for t in reversed(self._pending) if t.entry.row.topic is graph.MISSION_STATE), None)
        if state is None:
            return
        scanning = deserialize_message(state.data, state.entry.kind).mission_phase in _SCANNING_PHASES
        if scanning != self._scanning:
            self._scanning = scanning
            for entry in self._recorded:
                if entry.row.while_scanning:
                    (self._subscribe if scanning else self._unsubscribe)(entry)

    def _write(self, writer: RecordingWriter) -> None:
        """Write the pending messages, oldest first, at the ROS time of their arrival."""
        now_ns, wall_ns = self.now_ns(), time.time_ns()
        if now_ns == 0 and time.monotonic() - self._started_at_s < CLOCK_PATIENCE_S:
            return  # no /clock yet: a latched message at time zero would stretch the recording by the clock's offset
        self._pending.sort(key=lambda taken: taken.received_ns)
        for taken in self._pending:
            entry = taken.entry
            if entry.channel is None:
                topic = entry.row.topic
                entry.channel = writer.add_channel(
                    topic.name, topic.type, schema_text(topic.type, fields=_class_fields), topic.qos
                )
            # Simulated and wall time advance at nearly the same rate over these few milliseconds.
            log_ns = max(0, now_ns - max(0, wall_ns - taken.received_ns))
            writer.write(entry.channel, taken.data, log_ns, taken.received_ns, taken.sequence)
        self._pending.clear()

    def _flush(self, writer: RecordingWriter) -> None:
        self._flushed_at_s = time.monotonic()
        writer.flush()
        if self._max_bytes and writer.size_bytes >= self._max_bytes:
            self._stop(writer, f"the file reached max_size_mb = {self._max_bytes / 1e6:.0f}", whole=True)
        elif shutil.disk_usage(writer.path.parent).free < self._keep_free_bytes:
            limit_mb = self._keep_free_bytes / 1e6
            self._stop(writer, f"the disk has less than keep_free_mb = {limit_mb:.0f} left; free some space", whole=True)

    # -- ending -------------------------------------------------------------------------------------------------------
    def _stop(self, writer: RecordingWriter, reason: str, whole: bool) -> None:
        """Stop recording and log the reason; the node keeps running. `whole` writes the file's index first."""
        self._writer = None
        self._pending.clear()
        self._drain.cancel()
        self._mismatch_check.cancel()
        for entry in self._recorded:
            self._unsubscribe(entry)
        if whole:
            try:
                writer.finish()
            except RecordingStopped as error:
                reason = f"{reason}; its index could not be written: {error.strerror}"
        else:
            writer.abandon()
        self.get_logger().error(f"recording of {writer.path} stopped: {reason}")

    def before_shutdown(self) -> None:
        """Write the last messages and the file's index."""
        self._tick()
        with self._lock:
            writer, self._writer = self._writer, None
            if writer is None:
                return
            try:
                writer.finish()
            except RecordingStopped as error:
                self.get_logger().error(f"the index of {writer.path} could not be written: {error.strerror}")

    def _check_silent_topics(self) -> None:
        """Log once every topic whose publisher has a QoS that this node's subscription does not match."""
        self._mismatch_check.cancel()
        for entry in self._recorded:
            if entry.channel is not None or entry.subscription is None:
                continue
            wanted = entry.row.qos()
            for publisher in self.get_publishers_info_by_topic(entry.row.topic.name):
                offered = publisher.qos_profile
                if (wanted.reliable and offered.reliability == ReliabilityPolicy.BEST_EFFORT) or (
                    wanted.latched and offered.durability == DurabilityPolicy.VOLATILE
                ):
                    self.get_logger().warning(
                        f"{entry.row.topic.name} of {publisher.node_name} is not recorded: it offers "
                        f"{offered.reliability.name}, {offered.durability.name}, which differs from graph.py"
                    )


def _class_fields(type_name: str) -> dict[str, str]:
    return dict(interface(type_name).get_fields_and_field_types())
