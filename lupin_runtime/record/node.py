"""`lupin_recorder`: takes serialised messages off the graph and writes them to an MCAP file.

The subscriptions are parked: no executor waits on them. A steady timer empties their queues twenty times a second, which
costs a fifth of a callback per message; the middleware's own receive stamps keep the times exact.
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

from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from lupin_runtime import graph
from lupin_runtime.record.definitions import schema_text
from lupin_runtime.record.table import STANDARD, Recorded, cameras, chosen
from lupin_runtime.record.writer import RecordingStopped, RecordingWriter, free_name
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.node import interface, qos_profile

DRAIN_PERIOD_S = 0.05
# A recorder that is killed loses at most this much.
FLUSH_PERIOD_S = 2.0
# Publishers need a while to be found before a silent topic is worth a word.
MISMATCH_CHECK_S = 10.0
# Messages wait this long for a first /clock; then the recording starts at time zero.
CLOCK_PATIENCE_S = 30.0

_LOOKING = ("SCANNING", "CONFIRMING")


class _Parked(CallbackGroup):
    """A group whose entities the executor never waits for."""

    def can_execute(self, entity: Any) -> bool:
        return False

    def beginning_execution(self, entity: Any) -> bool:
        return False

    def ending_execution(self, entity: Any) -> None:
        """Nothing was begun."""


@dataclass
class _Tap:
    """One recorded topic: its row, its subscription while there is one, its channel once it has a message."""

    row: Recorded
    kind: type
    subscription: Subscription | None = None
    channel: int | None = None
    last_kept_ns: int = 0


@dataclass(frozen=True)
class _Taken:
    tap: _Tap
    data: bytes
    received_ns: int
    sequence: int


class Recorder(LupinNode):
    """Records the graph to one file. The process outlives a full disk; nothing is ever deleted or overwritten."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("lupin_recorder", parameters)
        output = Path(self.parameter("output", "recording.mcap"))
        topics = self.parameter("topics", "")
        self._max_bytes = int(self.parameter("max_size_mb", 4096.0) * 1e6)
        self._keep_free_bytes = int(self.parameter("keep_free_mb", 200.0) * 1e6)
        images = cameras(
            self.parameter("body_images", "always"),
            self.parameter("gripper_images", "scanning"),
            self.parameter("body_images_hz", 1.0),
            self.parameter("gripper_images_hz", 2.0),
        )
        self._parked = _Parked()
        self._taps = self._open_taps(chosen(topics, STANDARD + images))
        self._waiting: list[_Taken] = []
        self._looking = False
        self._writer = self._open_writer(output)
        self._flushed_at_s = self._started_at_s = time.monotonic()
        self._busy = threading.Lock()
        if self._writer is not None:
            for tap in self._taps:
                if not tap.row.while_scanning:
                    self._subscribe(tap)
            # Steady time, not ROS time: a killed recorder loses real seconds, and a stopped /clock must not fill a queue.
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self._drain = self.create_timer(DRAIN_PERIOD_S, self._tick, clock=steady)
            self._mismatch_check = self.create_timer(MISMATCH_CHECK_S, self._check_silent_topics, clock=steady)

    # -- opening ------------------------------------------------------------------------------------------------------
    def _open_taps(self, rows: tuple[Recorded, ...]) -> list[_Tap]:
        taps = []
        for row in rows:
            try:
                taps.append(_Tap(row, interface(row.topic.type)))
            except (ImportError, AttributeError) as error:
                self.get_logger().warning(f"{row.topic.name} is not recorded: {row.topic.type}: {error}")
        return taps

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
            self.get_logger().error(f"nothing is recorded: {path} can't be written: {error.strerror or error}")
            return None
        self.get_logger().info(f"recording {len(self._taps)} topics to {path}")
        return writer

    def _subscribe(self, tap: _Tap) -> None:
        tap.subscription = self.create_subscription(
            tap.kind,
            tap.row.topic.name,
            lambda _: None,
            qos_profile(tap.row.qos()),
            callback_group=self._parked,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=True,
        )

    def _unsubscribe(self, tap: _Tap) -> None:
        if tap.subscription is not None:
            self.destroy_subscription(tap.subscription)
            tap.subscription = None

    # -- every 50 ms --------------------------------------------------------------------------------------------------
    def _tick(self) -> None:
        with self._busy:
            writer = self._writer
            if writer is None:
                return
            for tap in self._taps:
                if tap.subscription is not None:
                    self._take(tap, tap.subscription)
            self._follow_mission()
            try:
                self._write(writer)
                if time.monotonic() - self._flushed_at_s >= FLUSH_PERIOD_S:
                    self._flush(writer)
            except RecordingStopped as error:
                self._stop(writer, f"{error.strerror}; what was written until now stays and reads", whole=False)

    def _take(self, tap: _Tap, subscription: Subscription) -> None:
        limit_hz = tap.row.max_rate_hz
        if limit_hz is not None and time.time_ns() - tap.last_kept_ns < (1.0 / limit_hz - DRAIN_PERIOD_S / 2.0) * 1e9:
            return
        while True:
            with subscription.handle:
                taken = subscription.handle.take_message(tap.kind, True)
            if taken is None:
                return
            data, info = taken
            received_ns = info.get("received_timestamp") or time.time_ns()
            tap.last_kept_ns = received_ns
            self._waiting.append(_Taken(tap, data, received_ns, info.get("publication_sequence_number") or 0))
            if limit_hz is not None:
                return

    def _follow_mission(self) -> None:
        """Open the cameras that are recorded only while the mission looks at a tag, and close them after."""
        state = next((t for t in reversed(self._waiting) if t.tap.row.topic is graph.MISSION_STATE), None)
        if state is None:
            return
        looking = deserialize_message(state.data, state.tap.kind).mission_phase in _LOOKING
        if looking != self._looking:
            self._looking = looking
            for tap in self._taps:
                if tap.row.while_scanning:
                    (self._subscribe if looking else self._unsubscribe)(tap)

    def _write(self, writer: RecordingWriter) -> None:
        """Write what was taken, oldest first, at the ROS time of its arrival."""
        now_ns, wall_ns = self.now_ns(), time.time_ns()
        if now_ns == 0 and time.monotonic() - self._started_at_s < CLOCK_PATIENCE_S:
            return  # no /clock yet: a latched message at time zero would stretch the recording by the clock's offset
        self._waiting.sort(key=lambda taken: taken.received_ns)
        for taken in self._waiting:
            tap = taken.tap
            if tap.channel is None:
                topic = tap.row.topic
                tap.channel = writer.add_channel(
                    topic.name, topic.type, schema_text(topic.type, fields=_class_fields), topic.qos
                )
            # Under a simulated clock the two run at nearly the same rate over these few milliseconds.
            log_ns = max(0, now_ns - max(0, wall_ns - taken.received_ns))
            writer.write(tap.channel, taken.data, log_ns, taken.received_ns, taken.sequence)
        self._waiting.clear()

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
        """Stop recording, say so once, and go on living; `whole` writes the file's index first."""
        self._writer = None
        self._waiting.clear()
        self._drain.cancel()
        self._mismatch_check.cancel()
        for tap in self._taps:
            self._unsubscribe(tap)
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
        with self._busy:
            writer, self._writer = self._writer, None
            if writer is None:
                return
            try:
                writer.finish()
            except RecordingStopped as error:
                self.get_logger().error(f"the index of {writer.path} could not be written: {error.strerror}")

    def _check_silent_topics(self) -> None:
        """Name every topic that is published with a QoS that this node's subscription can't hear, once."""
        self._mismatch_check.cancel()
        for tap in self._taps:
            if tap.channel is not None or tap.subscription is None:
                continue
            wanted = tap.row.qos()
            for publisher in self.get_publishers_info_by_topic(tap.row.topic.name):
                offered = publisher.qos_profile
                if (wanted.reliable and offered.reliability == ReliabilityPolicy.BEST_EFFORT) or (
                    wanted.latched and offered.durability == DurabilityPolicy.VOLATILE
                ):
                    self.get_logger().warning(
                        f"{tap.row.topic.name} of {publisher.node_name} is not recorded: it offers "
                        f"{offered.reliability.name}, {offered.durability.name}; the graph's table says otherwise"
                    )


def _class_fields(type_name: str) -> dict[str, str]:
    return dict(interface(type_name).get_fields_and_field_types())
