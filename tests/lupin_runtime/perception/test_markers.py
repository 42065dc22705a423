"""Markers of tags and boxes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rclpy", reason="needs the message packages: pip install ./interfaces")

from builtin_interfaces.msg import Time
from lupin_msgs.msg import DiscoveredTag
from visualization_msgs.msg import Marker

from lupin_runtime.geometry import Pose2, yaw_from_quaternion
from lupin_runtime.perception.box_geometry import BoxSize, box_from_map
from lupin_runtime.perception.markers import ChangedMarkers, box_markers, tag_markers

if TYPE_CHECKING:
    from visualization_msgs.msg import MarkerArray


def tag(name: str, x: float) -> Any:
    found = DiscoveredTag(tag_id=name)
    found.pose_in_map.position.x, found.pose_in_map.position.z = x, 0.1
    return found


def test_a_tag_is_a_plate_at_its_pose_and_its_number_above() -> None:
    plate, text = tag_markers([tag("7", 2.0)])
    assert (plate.type, plate.pose.position.x, plate.pose.position.z) == (Marker.CUBE, 2.0, 0.1)
    assert (text.type, text.text, text.pose.position.x) == (Marker.TEXT_VIEW_FACING, "7", 2.0)
    assert text.pose.position.z > 0.2


def test_a_box_is_a_cube_that_faces_along_its_normal() -> None:
    box = box_from_map(Pose2(1.0, 2.0, math.pi / 2), BoxSize(0.8, 0.4, 0.3))
    flat = box_from_map(Pose2(), BoxSize(0.0, 0.4, 0.3))
    (cube,) = box_markers({"3": box, "4": flat})
    at, q = cube.pose.position, cube.pose.orientation
    assert (at.x, at.y, at.z) == pytest.approx((1.0, 2.0, 0.15))
    assert yaw_from_quaternion(q.x, q.y, q.z, q.w) == pytest.approx(math.pi / 2)
    assert (cube.scale.x, cube.scale.y, cube.scale.z) == pytest.approx((0.4, 0.8, 0.3))


def test_markers_are_published_after_changes_and_replace_all() -> None:
    published: list[MarkerArray] = []
    markers = ChangedMarkers(published.append, "map")

    def update(*positions: tuple[str, float]) -> int:
        markers.update({name: (x,) for name, x in positions}, lambda: tag_markers([tag(n, x) for n, x in positions]), Time())
        return len(published)

    assert update() == 0
    assert update(("7", 2.0)) == 1
    assert update(("7", 2.005)) == 1
    assert update(("7", 2.02)) == 2
    assert update(("7", 2.02), ("8", 1.0)) == 3
    assert update() == 4
    assert [array.markers[0].action for array in published] == [Marker.DELETEALL] * 4
    assert [len(array.markers) for array in published] == [3, 3, 5, 1]
    assert {marker.header.frame_id for marker in published[2].markers} == {"map"}
