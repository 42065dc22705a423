"""Reads the climate of tags that are discovered while no mission runs, once each. An option of the aggregator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from lupin_msgs.msg import MissionState, Observation
from lupin_msgs.srv import GetTagReading

from lupin_runtime import graph
from lupin_runtime.perception.pose_messages import transform_pose_message
from lupin_runtime.perception.registry import KnownTag
from lupin_runtime.ros import LupinNode, stamp_from_ns

IDLE_STATES = ("", "READY", "DONE")
# A request without an answer is repeated after this time.
ANSWER_TIMEOUT_S = 5.0


@dataclass
class ReadingPlan:
    """Which tags to request from the bridge: each once, or again after `refresh_s` if that is positive."""

    refresh_s: float = 0.0
    _read_ns: dict[str, int] = field(default_factory=dict)
    _requested_ns: dict[str, int] = field(default_factory=dict)

    def due(self, tag_ids: Sequence[str], now_ns: int) -> list[str]:
        """Return the tags to request now, and mark them as requested."""
        due = [tag_id for tag_id in tag_ids if not self._is_pending(tag_id, now_ns) and self._is_wanted(tag_id, now_ns)]
        self._requested_ns.update((tag_id, now_ns) for tag_id in due)
        return due

    def answered(self, tag_id: str, now_ns: int) -> None:
        """Note that the bridge has answered for this tag, even if it does not know it."""
        self._requested_ns.pop(tag_id, None)
        self._read_ns[tag_id] = now_ns

    def failed(self, tag_id: str) -> None:
        """Note that the call failed, so that it is repeated."""
        self._requested_ns.pop(tag_id, None)

    def _is_pending(self, tag_id: str, now_ns: int) -> bool:
        asked_ns = self._requested_ns.get(tag_id)
        return asked_ns is not None and now_ns - asked_ns < ANSWER_TIMEOUT_S * 1e9

    def _is_wanted(self, tag_id: str, now_ns: int) -> bool:
        read_ns = self._read_ns.get(tag_id)
        return read_ns is None or (self.refresh_s > 0.0 and now_ns - read_ns >= self.refresh_s * 1e9)


class PassiveObserver:
    """Requests the readings of discovered tags while the mission is idle, and publishes the answers."""

    def __init__(self, node: LupinNode) -> None:
        self._node = node
        self._plan = ReadingPlan(float(node.parameter("passive_refresh_period_s", 0.0)))
        self._bridge = node.client(graph.GET_TAG_READING)
        self._observations = node.publisher(graph.OBSERVATIONS)

    def tick(self, mission: MissionState | None, tags: Sequence[KnownTag]) -> None:
        """Called a few times a second."""
        if (mission is not None and mission.lifecycle_state not in IDLE_STATES) or not self._bridge.service_is_ready():
            return
        by_id = {tag.id: tag for tag in tags}
        for tag_id in self._plan.due(list(by_id), self._node.elapsed_clock_ns()):
            future = self._bridge.call_async(GetTagReading.Request(tag_id=tag_id))
            future.add_done_callback(lambda done, tag=by_id[tag_id]: self._answered(tag, done))

    def _answered(self, tag: KnownTag, future: Any) -> None:
        if future.cancelled() or future.exception() is not None:
            self._plan.failed(tag.id)
            return
        response: GetTagReading.Response = future.result()
        self._plan.answered(tag.id, self._node.elapsed_clock_ns())
        if response.status != GetTagReading.Response.STATUS_OK:
            return
        message = Observation(source="passive_observer", kind=Observation.KIND_TAG_READING)
        message.header.stamp = stamp_from_ns(self._node.now_ns())
        message.header.frame_id = graph.MAP_FRAME
        message.status = Observation.STATUS_OK
        message.tag_reading = response.reading
        message.tag_pose_in_map = transform_pose_message(tag.pose)
        self._observations.publish(message)
