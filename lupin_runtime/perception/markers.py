"""Markers of tags and boxes for RViz and Foxglove."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping

from builtin_interfaces.msg import Time
from lupin_msgs.msg import DiscoveredTag
from visualization_msgs.msg import Marker, MarkerArray

from lupin_runtime.geometry import quaternion_from_yaw
from lupin_runtime.perception.box_geometry import Box
from lupin_runtime.ros.markers import make_marker, marker_array

_TAG_SIDE_M, _TAG_THICKNESS_M, _TEXT_HEIGHT_M = 0.10, 0.005, 0.12
_TAG_COLOR = (0.78, 0.96, 0.26, 1.0)
_BOX_COLOR = (0.55, 0.40, 0.25, 0.45)


def tag_markers(tags: Iterable[DiscoveredTag]) -> list[Marker]:
    """Return a plate and its number for each tag."""
    markers = []
    for index, tag in enumerate(tags):
        plate = make_marker("tag", index, Marker.CUBE, (_TAG_SIDE_M, _TAG_SIDE_M, _TAG_THICKNESS_M), _TAG_COLOR)
        plate.pose = tag.pose_in_map
        text = make_marker("tag_id", index, Marker.TEXT_VIEW_FACING, (0.0, 0.0, _TEXT_HEIGHT_M), (1.0, 1.0, 1.0, 1.0))
        text.text = tag.tag_id
        at = tag.pose_in_map.position
        text.pose.position.x, text.pose.position.y = at.x, at.y
        text.pose.position.z = at.z + _TAG_SIDE_M / 2 + _TEXT_HEIGHT_M
        markers += [plate, text]
    return markers


def box_markers(boxes: Mapping[str, Box]) -> list[Marker]:
    """Return a cube for each box that has an area."""
    markers = []
    for index, box in enumerate(box for box in boxes.values() if not box.degenerate):
        cube = make_marker("box", index, Marker.CUBE, (box.size.depth, box.size.width, box.size.height), _BOX_COLOR)
        center, q = box.center(), cube.pose.orientation
        cube.pose.position.x, cube.pose.position.y, cube.pose.position.z = center.x, center.y, box.size.height / 2
        q.x, q.y, q.z, q.w = quaternion_from_yaw(center.yaw)
        markers.append(cube)
    return markers


class ChangedMarkers:
    """Publishes the markers of named things, but only after one was added, removed, or moved by a centimeter or a degree.

    A thing is its name and the numbers that its markers depend on, in meters or as parts of a quaternion.
    """

    def __init__(self, publish: Callable[[MarkerArray], None], frame: str) -> None:
        self._publish, self._frame = publish, frame
        self._published: Mapping[str, tuple[float, ...]] = {}

    def update(self, things: Mapping[str, tuple[float, ...]], markers: Callable[[], list[Marker]], stamp: Time) -> None:
        """Publish what `markers` returns if the things differ from those published last."""
        before = self._published
        if list(things) == list(before) and all(math.dist(things[name], before[name]) < 0.01 for name in things):
            return
        self._published = things
        self._publish(marker_array(self._frame, stamp, markers()))
