"""Markers for RViz and Foxglove."""

from __future__ import annotations

from collections.abc import Iterable

from builtin_interfaces.msg import Time
from visualization_msgs.msg import Marker, MarkerArray


def make_marker(namespace: str, index: int, kind: int, size: tuple[float, float, float], color: tuple[float, ...]) -> Marker:
    """Return a marker of a `kind` of Marker's, of `size` in meters and `color` (red, green, blue, opacity)."""
    marker = Marker(ns=namespace, id=index, type=kind, action=Marker.ADD)
    marker.scale.x, marker.scale.y, marker.scale.z = size
    marker.color.r, marker.color.g, marker.color.b, marker.color.a = color
    return marker


def marker_array(frame: str, stamp: Time, markers: Iterable[Marker]) -> MarkerArray:
    """Return an array that replaces all markers of its topic."""
    message = MarkerArray(markers=[Marker(action=Marker.DELETEALL), *markers])
    for marker in message.markers:
        marker.header.frame_id, marker.header.stamp = frame, stamp
    return message
