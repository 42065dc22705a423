"""What is recorded: the topics that a run's report and a later look at it need, each with its upper rate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from difflib import get_close_matches

from lupin_runtime import graph
from lupin_runtime.graph import Qos, Topic

# A process that is busy for a while must not lose what arrives meanwhile: the reader's queue is this deep in seconds.
QUEUE_S = 4.0
_QUEUE_AT_LEAST = 20


@dataclass(frozen=True)
class Recorded:
    """One topic of the recording. `max_rate_hz` drops what comes faster, before it is written; None keeps all.

    `while_scanning` subscribes only while the mission looks at a tag: a subscription makes a camera encode.
    """

    topic: Topic
    max_rate_hz: float | None = None
    while_scanning: bool = False

    def qos(self) -> Qos:
        """The subscription's QoS: what the publisher offers, with a queue that survives a busy moment.

        A throttled topic keeps the newest message only: what would be dropped is not even taken from the middleware.
        """
        offered = self.topic.qos
        if self.max_rate_hz is not None:
            return replace(offered, depth=1)
        return replace(offered, depth=max(offered.depth, _QUEUE_AT_LEAST, int(QUEUE_S * (self.topic.rate_hz or 0.0))))


# The camera topics of both targets stand here: one of them has no publisher, and a topic without a publisher costs nothing.
STANDARD: tuple[Recorded, ...] = (
    Recorded(graph.TF),
    Recorded(graph.TF_STATIC),
    Recorded(graph.ODOM),
    Recorded(graph.SCAN),
    Recorded(graph.IMU, max_rate_hz=10.0),
    Recorded(graph.JOINT_STATES, max_rate_hz=10.0),
    Recorded(graph.BATTERY),
    Recorded(graph.CMD_VEL_JOY),
    Recorded(graph.CMD_VEL_MANUAL),
    Recorded(graph.CMD_VEL_NAV),
    Recorded(graph.CMD_VEL_AUTO),
    Recorded(graph.CMD_VEL_SINK_ROBOT),
    Recorded(graph.CMD_VEL_SINK_SIM),
    Recorded(graph.ESTOP_STATE),
    Recorded(graph.HMI_ESTOP),
    Recorded(graph.ESTOP_BUTTON, max_rate_hz=2.0),
    Recorded(graph.MAP),
    Recorded(graph.AMCL_POSE),
    Recorded(graph.PLAN, max_rate_hz=2.0),
    Recorded(graph.GOAL_POSE),
    Recorded(graph.TAG_DETECTIONS),
    Recorded(graph.FLOWER_DETECTIONS),
    Recorded(graph.BOX_GEOMETRY),
    Recorded(graph.DISCOVERED_TAGS),
    Recorded(graph.OBSERVATIONS),
    Recorded(graph.MISSION_STATE),
    Recorded(graph.TWIN_STATE),
    Recorded(graph.ARM_TRAJECTORY),
    Recorded(graph.ROSOUT),
)

BODY_CAMERAS = (graph.compressed(graph.BODY_IMAGE_SIM), graph.compressed(graph.BODY_IMAGE_ROBOT))
GRIPPER_CAMERA = graph.compressed(graph.GRIPPER_IMAGE)

IMAGE_MODES = ("always", "scanning", "off")


def cameras(body: str, gripper: str, body_hz: float, gripper_hz: float) -> tuple[Recorded, ...]:
    """The rows of both cameras' JPEG topics; `body` and `gripper` are each one of IMAGE_MODES. Raises ValueError."""
    rows = []
    for topics, mode, rate_hz in ((BODY_CAMERAS, body, body_hz), ((GRIPPER_CAMERA,), gripper, gripper_hz)):
        if mode not in IMAGE_MODES:
            raise ValueError(f"images of {topics[0].name} are recorded {' | '.join(IMAGE_MODES)}, not {mode!r}")
        if mode != "off":
            rows += [Recorded(topic, rate_hz, while_scanning=mode == "scanning") for topic in topics]
    return tuple(rows)


def chosen(names: str, rows: tuple[Recorded, ...]) -> tuple[Recorded, ...]:
    """The rows of a comma-separated list of topic names; "" keeps them all.

    A name outside `rows` but in the graph is recorded at its full rate; any other raises ValueError with the nearest names.
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
