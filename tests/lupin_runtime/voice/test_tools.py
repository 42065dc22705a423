"""The table of tools is that of the contract, and checks what a model sends."""

from __future__ import annotations

import json
from typing import Any

import pytest

from lupin_runtime.voice.arguments import BadArgument
from lupin_runtime.voice.declarations import function_declarations
from lupin_runtime.voice.tools import BY_NAME, COLORS, TOOLS, Effect, Gate
from tests.support.voice_session import CALLS

ESTOPPED = [
    "drive",
    "nav_goto",
    "nav_forward",
    "rotate",
    "nav_goto_named",
    "gripper",
    "arm_preset",
    "arm_goto_pose",
    "arm_run_sequence",
]
UNGATED = [
    "stop",
    "set_speed_cap",
    "nav_cancel",
    "list_named_locations",
    "save_named_location",
    "arm_save_pose",
    "arm_list_library",
    "arm_stop",
    "query_state",
    "engage_estop",
    "speak",
    "set_light",
]


def test_table_has_the_23_tools_of_the_contract() -> None:
    assert [tool.name for tool in TOOLS] == list(CALLS)
    assert not {"scan_apriltags", "detect_flowers", "record_observation"} & BY_NAME.keys()


def test_gates_are_those_of_the_contract() -> None:
    by_gate = {gate: [tool.name for tool in TOOLS if tool.gate is gate] for gate in Gate}
    assert by_gate == {Gate.ESTOP: ESTOPPED, Gate.NONE: UNGATED, Gate.ESTOP_ON_START: ["arm_record", "calibrate_arm"]}
    assert [tool.name for tool in TOOLS if tool.needs_pose] == ["nav_forward", "rotate", "save_named_location"]


def test_only_four_tools_stop_and_none_releases() -> None:
    assert [tool.name for tool in TOOLS if tool.effect is Effect.STOP] == ["stop", "nav_cancel", "arm_stop", "engage_estop"]
    assert not [tool.name for tool in TOOLS if "release" in tool.name]


@pytest.mark.parametrize("tool", TOOLS, ids=lambda tool: tool.name)
def test_complete_call_of_each_tool_is_accepted(tool: Any) -> None:
    checked = tool.check(CALLS[tool.name])
    assert checked.items() >= CALLS[tool.name].items()
    is_burst_or_no_motion = tool.effect is not Effect.MOTION or tool.name == "drive"
    assert (tool.sentence(checked) == "") is is_burst_or_no_motion


@pytest.mark.parametrize(
    ("name", "values", "text"),
    [
        ("nav_goto", {"x": 1.0}, "y is missing: a number from -1000 to 1000 m"),
        ("nav_goto", {"x": float("nan"), "y": 0}, "x must be a number from -1000 to 1000 m, not nan"),
        ("nav_goto", {"x": True, "y": 0}, "x must be a number from -1000 to 1000 m, not True"),
        ("nav_goto", {"x": "1", "y": 0}, "not '1'"),
        ("nav_goto", {"x": 1001, "y": 0}, "not 1001"),
        ("nav_goto", {"x": 10**5000, "y": 0}, "not a huge number"),
        ("nav_goto", {"x": 1, "y": 0, "yaw": 90}, "yaw must be a number from -3.1416 to 3.1416 rad, not 90"),
        ("nav_goto", {"x": 1, "y": 0, "speed": 1}, "unknown argument 'speed'; expected confirmation, x, y, yaw"),
        ("nav_goto", [1, 2], "arguments must be an object, not a list"),
        ("nav_goto", None, "arguments must be an object, not None"),
        ("drive", {"duration_s": 1.0}, "expected at least one of linear_x, linear_y, angular_z"),
        ("drive", {"linear_x": [], "duration_s": 1.0}, "linear_x must be a number"),
        ("drive", {"linear_x": 1e300, "duration_s": 1.0}, "linear_x must be a number"),
        ("gripper", {"action": "set"}, "percent is missing, which set needs"),
        ("gripper", {"action": "release"}, "action must be one of open, close, set, not 'release'"),
        ("gripper", {"action": "set", "percent": 101}, "not 101"),
        ("arm_preset", {"name": "dance"}, "name must be one of home, zero, tuck, pick, place, inspect, not 'dance'"),
        ("arm_save_pose", {"name": "a\x1b[2Jb"}, "name must be 1 to 64 printable characters"),
        ("arm_save_pose", {"name": "x" * 65}, "name must be 1 to 64 printable characters"),
        ("arm_save_pose", {"name": "  "}, "name must be 1 to 64 printable characters"),
        ("set_light", {}, "expected at least one of color, mode"),
        ("set_light", {"color": "battery_low"}, "color must be one of red"),
        ("set_speed_cap", {"value": 50}, "value must be a number from 0 to 1, not 50"),
        ("query_state", {"fields": []}, "fields must be a list of pose, battery, estop, not a list"),
        ("query_state", {"fields": ["secrets"]}, "not 'secrets'"),
        ("speak", {"text": ""}, "text must be text of 1 to 1000 characters"),
        ("speak", {"text": "x" * 1001}, "text must be text of 1 to 1000 characters"),
        ("stop", {"now": 1}, "unknown argument 'now'; expected none"),
    ],
)
def test_wrong_arguments_are_refused_with_the_reason(name: str, values: Any, text: str) -> None:
    with pytest.raises(BadArgument) as caught:
        BY_NAME[name].check(values)
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("given", "used"),
    [(0.0, 0.1), (-3, 0.1), (60, 2.0), (1.5, 1.5), (None, 0.5), ("long", 0.5), (True, 0.5), (float("inf"), 0.5), (1e12, 0.5)],
)
def test_duration_of_a_burst_is_limited_or_half_a_second(given: Any, used: float) -> None:
    assert BY_NAME["drive"].check({"linear_x": 0.1, "duration_s": given})["duration_s"] == used
    assert BY_NAME["drive"].check({"linear_x": 0.1})["duration_s"] == 0.5


def test_choices_are_trimmed_and_their_case_is_ignored() -> None:
    assert BY_NAME["set_light"].check({"color": " Spring "}) == {"color": "spring"}
    assert BY_NAME["query_state"].check({"fields": ["ESTOP", "pose", "pose"]}) == {"fields": ("pose", "estop")}


def test_palette_has_the_12_colors_of_the_page() -> None:
    assert len(COLORS) == 12 and COLORS["amber"] == (255, 191, 0) and COLORS["off"] == (0, 0, 0)


def test_calibration_and_recording_read_back_what_moves() -> None:
    by_action = {
        (name, action): bool(BY_NAME[name].sentence(BY_NAME[name].check({"action": action})))
        for name, actions in (("calibrate_arm", "start commit cancel status"), ("arm_record", "start save cancel"))
        for action in actions.split()
    }
    assert {key for key, is_read_back in by_action.items() if is_read_back} == {
        ("calibrate_arm", "start"), ("calibrate_arm", "commit"), ("arm_record", "start"),
    }  # fmt: skip


def test_declarations_are_json_with_the_required_arguments() -> None:
    declared = {each["name"]: each for each in json.loads(json.dumps(function_declarations(), allow_nan=False))}
    assert list(declared) == list(BY_NAME)
    drive = declared["drive"]["parameters"]
    assert drive["required"] == ["duration_s"]
    assert drive["properties"]["duration_s"] == {
        "type": "number", "description": "how long to drive in s", "minimum": 0.1, "maximum": 2.0,
    }  # fmt: skip
    assert "to voiceMaxLinearMps m/s, times the speed cap" in drive["properties"]["linear_x"]["description"]
    assert "confirmation" in declared["rotate"]["parameters"]["properties"]
    assert "confirmation" not in declared["set_light"]["parameters"]["properties"]
    assert "parameters" not in declared["stop"]
    assert declared["set_light"]["parameters"]["properties"]["color"]["enum"] == list(COLORS)
