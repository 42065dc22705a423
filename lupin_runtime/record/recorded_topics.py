"""The recorder's topics, taken from the `recorded_hz` column of `graph.py`, and its camera topics."""

from __future__ import annotations

from dataclasses import dataclass, replace
from difflib import get_close_matches

from lupin_runtime import graph
from lupin_runtime.graph import Qos, Topic

# The subscription's queue holds this many seconds of messages, so that a recorder that is busy for a while loses none.
QUEUE_S = 4.0
_MIN_QUEUE_DEPTH = 20


@dataclass(frozen=True)
class Recorded:
    """One topic of the recording.

    `max_rate_hz` drops messages that arrive faster, before they are written; None keeps all. `while_scanning` subscribes only
    while the mission scans a tag, because a subscription makes a camera encode.
    """

    topic: Topic
    max_rate_hz: float | None = None
    while_scanning: bool = False

    def qos(self) -> Qos:
        """The subscription's QoS: what the publisher offers, with a queue that bridges a busy moment.

        A throttled topic keeps only the newest message, so that messages to be dropped are not taken from the middleware.
        """
        offered = self.topic.qos
        if self.max_rate_hz is not None:
            return replace(offered, depth=1)
        return replace(offered, depth=max(offered.depth, _MIN_QUEUE_DEPTH, int(QUEUE_S * (self.topic.rate_hz or 0.0))))


# Topics of both targets are included: those of the other target have no publisher, and then a subscription costs nothing.
STANDARD: tuple[Recorded, ...] = tuple(
    Recorded(topic, None if topic.recorded_hz == graph.ALL else topic.recorded_hz)
    for topic in graph.topics()
    if topic.recorded_hz > 0.0
)

BODY_CAMERAS = (graph.compressed(graph.BODY_IMAGE_SIM), graph.compressed(graph.BODY_IMAGE_ROBOT))
GRIPPER_CAMERA = graph.compressed(graph.GRIPPER_IMAGE)

IMAGE_MODES = ("always", "scanning", "off")


def camera_topics(body: str, gripper: str, body_hz: float, gripper_hz: float) -> tuple[Recorded, ...]:
    """The JPEG topics of both cameras; `body` and `gripper` are each one of IMAGE_MODES. Raises ValueError."""
    recorded = []
    for topics, mode, rate_hz in ((BODY_CAMERAS, body, body_hz), ((GRIPPER_CAMERA,), gripper, gripper_hz)):
        if mode not in IMAGE_MODES:
            raise ValueError(f"the recording mode of {topics[0].name} must be {' | '.join(IMAGE_MODES)}, not {mode!r}")
        if mode != "off":
            recorded += [Recorded(topic, rate_hz, while_scanning=mode == "scanning") for topic in topics]
    return tuple(recorded)


def select_topics(names: str, rows: tuple[Recorded, ...]) -> tuple[Recorded, ...]:
    """The topics of a comma-separated list of names; all of `rows` where the list is empty.

    A topic of the graph that is not in `rows` is recorded at its full rate. Raises ValueError, with the nearest names, for a
    name that is not in the graph.
    """
    wanted = [name.strip() for name in names.split(",") if name.strip()]
    if not wanted:
        return rows
    known = {topic.name: Recorded(topic) for topic in graph.topics()} | {row.topic.name: row for row in rows}
    for name in wanted:
        if name not in known:
            near = get_close_matches(name, known, n=3)
            raise ValueError(f"{name} is no topic of the graph" + (f"; nearest: {', '.join(near)}" if near else ""))
    return tuple(known[name] for name in dict.fromkeys(wanted))
