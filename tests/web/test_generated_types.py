"""The page's generated modules are those of the tables that the rest of Lupin uses."""

from __future__ import annotations

from pathlib import Path

from tools import write_page_types
from tools.build_page import is_new_enough


def test_only_changed_modules_are_written(tmp_path: Path) -> None:
    assert set(write_page_types.write(tmp_path)) == set(write_page_types.modules())
    robot = tmp_path / "robot.ts"
    robot.write_text(robot.read_text(encoding="utf-8").replace("0.6", "0.7"), encoding="utf-8")
    assert write_page_types.write(tmp_path) == ["robot.ts"] and write_page_types.write(tmp_path) == []


def test_every_topic_that_clients_may_publish_has_a_type() -> None:
    messages, graph_module = write_page_types.modules()["messages.ts"], write_page_types.modules()["graph.ts"]
    assert '"geometry_msgs/msg/Twist": geometry_msgs_Twist;' in messages
    assert '"name": "/cmd_vel_manual"' in graph_module and '"console": "operator"' in graph_module


def test_only_node_versions_that_vite_supports_are_used() -> None:
    versions = ("v18.20.4", "v20.18.9", "v20.19.0", "v21.9.0", "v22.11.0", "v22.12.0", "v24.1.0", "", "garbage")
    assert [is_new_enough(version) for version in versions] == [False, False, True, False, False, True, True, False, False]
