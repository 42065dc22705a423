"""The map in the terminal: walls, way, plan, tags and the robot at their places; damaged states give none."""

from __future__ import annotations

from typing import Any

import pytest

from lupin_cli.run.map_drawing import draw_map

ROOM: dict[str, Any] = {
    "map": {"x": 0.0, "y": 0.0, "cell_m": 0.25, "rows": ["#" * 16, *["#" + 14 * "." + "#"] * 14, "#" * 16]},
    "pose": [3.25, 0.75, 1.6],
    "trail": [[0.75, 0.75], [3.25, 0.75]],
    "plan": [[3.25, 0.75], [3.25, 2.0]],
    "tags": [{"id": "12", "x": 0.75, "y": 2.5, "read": True}, {"id": "13", "x": None, "y": None, "read": False}],
}


def test_room_is_drawn_with_its_robot_and_tags() -> None:
    lines = draw_map(ROOM, 8, 4)
    assert [line.plain for line in lines] == ["⡏⠉⠉⠉⠉⠉⠉⢹", "⡇12⠀⠀⠀x⢸", "⡇⠀⠀⠀⠀⠀⢸⢸", "⣇⣈⣉⣉⣉⣉▲⣸"]
    styles = {span.style for line in lines for span in line.spans}
    assert {"bold bright_green", "bright_green", "bright_black"} <= styles


@pytest.mark.parametrize(("yaw", "arrow"), [(0.0, "▶"), (1.5, "▲"), (3.1, "◀"), (-3.1, "◀"), (-1.5, "▼"), (7.0, "▶")])
def test_arrow_points_where_the_robot_does(yaw: float, arrow: str) -> None:
    drawn = "".join(line.plain for line in draw_map({**ROOM, "pose": [2.0, 2.0, yaw]}, 30, 12))
    assert [letter for letter in drawn if letter in "▶▲◀▼"] == [arrow]


@pytest.mark.parametrize("size", [(8, 4), (78, 22), (20, 3), (3, 20)])
def test_map_stays_within_its_size(size: tuple[int, int]) -> None:
    lines = draw_map({**ROOM, "pose": [900.0, -900.0, 0.0], "trail": [[-1e9, 1e9], [1e9, -1e9]]}, *size)
    assert 0 < len(lines) <= size[1] and {len(line.plain) for line in lines} == {size[0]}


@pytest.mark.parametrize(
    "damage",
    [
        {"map": None},
        {"map": {}},
        {"map": {"x": "a", "y": 0, "cell_m": 1, "rows": ["#"]}},
        {"map": {"x": 0, "y": 0, "cell_m": 0, "rows": ["#"]}},
        {"map": {"x": 0, "y": 0, "cell_m": 1, "rows": []}},
        {"map": {"x": float("nan"), "y": 0, "cell_m": 1, "rows": ["#"]}},
        {"pose": [1.0]},
        {"tags": [{}]},
        {"plan": 7},
        {"trail": [[1.0, 2.0, 3.0]]},
    ],
)
def test_damaged_state_has_no_map(damage: dict[str, Any]) -> None:
    assert draw_map({**ROOM, **damage}, 20, 10) == []
