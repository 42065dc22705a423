"""The shipped layout: viewers accept it, and it shows topics that the graph has."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from lupin_runtime import graph
from lupin_runtime.foxglove.layout import LAYOUT
from lupin_runtime.ros import type_names

DOCUMENT: dict[str, Any] = json.loads(LAYOUT.read_text(encoding="utf-8"))
PANELS: dict[str, dict[str, Any]] = DOCUMENT["configById"]
TYPES = {row.name: row.type for row in graph.topics()}
DISPLAY_PANELS = {"3D", "Image", "Plot", "RosOut", "StateTransitions", "Tab"}  # panels that can't publish or call services


def panels_in(layout: Any) -> Iterator[str]:
    if isinstance(layout, str):
        yield layout
        return
    assert layout["direction"] in ("row", "column")
    assert 0 < layout["splitPercentage"] < 100
    yield from panels_in(layout["first"])
    yield from panels_in(layout["second"])


def of_kind(*kinds: str) -> list[dict[str, Any]]:
    return [panel for identifier, panel in PANELS.items() if identifier.split("!")[0] in kinds]


def test_document_has_what_viewers_require() -> None:
    assert isinstance(DOCUMENT["globalVariables"], dict)
    assert isinstance(DOCUMENT["userNodes"], dict)
    assert DOCUMENT["playbackConfig"] == {"speed": 1}


def test_every_panel_is_placed_once() -> None:
    placed = list(panels_in(DOCUMENT["layout"]))
    placed += [name for panel in of_kind("Tab") for tab in panel["tabs"] for name in panels_in(tab["layout"])]
    assert sorted(placed) == sorted(PANELS)


def test_no_panel_can_move_or_change_anything() -> None:
    assert {identifier.split("!")[0] for identifier in PANELS} <= DISPLAY_PANELS


def test_robot_is_drawn_from_its_description_in_both_views() -> None:
    for panel in of_kind("3D"):
        robot = panel["layers"]["robot"]
        assert (robot["layerId"], robot["sourceType"]) == ("foxglove.Urdf", "topic")
        assert robot["topic"] == graph.ROBOT_DESCRIPTION.name


def test_named_topics_are_in_the_graph_with_a_fitting_type() -> None:
    for panel in of_kind("3D"):
        assert panel["topics"].keys() <= TYPES.keys()
        assert panel["followTf"] in (graph.MAP_FRAME, graph.BASE_FRAME)
    for panel in of_kind("Image"):
        mode = panel["imageMode"]
        assert TYPES[mode["imageTopic"]] == "sensor_msgs/msg/CompressedImage"
        assert TYPES[mode["calibrationTopic"]] == "sensor_msgs/msg/CameraInfo"
    for panel in of_kind("RosOut"):
        assert TYPES[panel["topicToRender"]] == graph.ROSOUT.type


@pytest.mark.parametrize("path", [path["value"] for panel in of_kind("Plot", "StateTransitions") for path in panel["paths"]])
def test_plotted_paths_name_fields_of_topics(path: str) -> None:
    topic, *fields = path.split(".")
    value = type_names.find(TYPES[topic], "msg")()
    for field in fields:
        value = getattr(value, field)
    assert isinstance(value, int | float | str)


def test_map_robot_markers_cameras_and_log_are_shown() -> None:
    shown = LAYOUT.read_text(encoding="utf-8")
    rows = (graph.MAP, graph.SCAN, graph.PLAN, graph.ODOM, graph.BATTERY, graph.ROSOUT, graph.MISSION_STATE, graph.ESTOP_STATE)
    drawn = (graph.ROBOT_DESCRIPTION, graph.TAG_MARKERS, graph.BOX_MARKERS, graph.GOAL_MARKERS, graph.LOCAL_COSTMAP)
    cameras = (graph.BODY_IMAGE_SIM, graph.BODY_IMAGE_ROBOT, graph.GRIPPER_IMAGE)
    for row in (*rows, *drawn, *map(graph.compressed, cameras)):
        assert row.name in shown
