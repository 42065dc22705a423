"""Node `box_layout_publisher`: the boxes of a layout file, in the map."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from lupin_msgs.msg import DiscoveredTags
from std_msgs.msg import String

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_runtime.layout import load_layout
from lupin_runtime.perception.box_layout import boxes_of, register, registered
from lupin_runtime.ros import LupinNode

# The fit is published again when it has moved by this much: tags come in, and their poses settle.
MOVED_M, MOVED_RAD = 0.02, 0.01


class BoxLayoutPublisher(LupinNode):
    """Registers the layout to the discovered tags and publishes its boxes; nothing until two tags agree.

    `layout_file` "" is the layout inside the greenhouse package. A file that cannot be used stops the node from starting.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("box_layout_publisher", parameters)
        path = str(self.parameter("layout_file", ""))
        height_m = float(self.parameter("box_height", 0.30))
        self._boxes = boxes_of(load_layout(Path(path).expanduser() if path else None), height_m)
        self._last: Pose2 | None = None
        self._geometry = self.publisher(graph.BOX_GEOMETRY)
        self.subscription(graph.DISCOVERED_TAGS, self._on_tags)

    def _on_tags(self, message: DiscoveredTags) -> None:
        found = {tag.tag_id: (tag.pose_in_map.position.x, tag.pose_in_map.position.y) for tag in message.tags}
        motion = register(self._boxes, found)
        if motion is None or (self._last is not None and not _moved(self._last, motion)):
            return
        if self._last is None:
            self.get_logger().info(f"layout registered by {len(found.keys() & self._boxes.keys())} tags")
        self._last = motion
        self._geometry.publish(String(data=json.dumps(registered(self._boxes, motion))))


def _moved(before: Pose2, after: Pose2) -> bool:
    return before.distance_to(after) > MOVED_M or abs(wrap_angle(before.yaw - after.yaw)) > MOVED_RAD
