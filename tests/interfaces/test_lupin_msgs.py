"""The definitions of lupin_msgs match the tables below, which record what nodes of other projects expect."""

from __future__ import annotations

import importlib
from typing import Any

import pytest

MESSAGES = {
    "SensorReading": "string name, float64 value",
    "TagReading": "string tag_id, builtin_interfaces/Time stamp, float64 sim_time_of_day_seconds, SensorReading[] readings",
    "FlowerPoint": "geometry_msgs/Point position, float32 height_m, string species, float32 confidence, bool anomaly",
    "FlowerObservation": """string tag_id, geometry_msgs/PoseStamped pose, string species, float32 confidence, bool anomaly,
        uint16 flower_count, uint16 bug_count, FlowerPoint[] flowers, geometry_msgs/Polygon box_footprint""",
    "AnomalyReport": "geometry_msgs/PoseStamped pose, string description, uint8 severity",
    "Observation": """std_msgs/Header header, string mission_id, string source, uint8 kind, uint8 status,
        string status_detail, TagReading tag_reading, FlowerObservation flower, AnomalyReport anomaly,
        geometry_msgs/Pose tag_pose_in_map""",
    "MissionState": """std_msgs/Header header, string mission_id, string mission_type, string lifecycle_state,
        string mission_phase, string current_target, uint16 targets_total, uint16 targets_completed, uint16 targets_failed,
        uint16 targets_unreachable, uint16 targets_skipped, string last_error, string last_event, uint8 last_event_severity,
        uint16 tags_discovered, uint16 discovery_goal, bool estop_engaged, bool paused, float32 battery_percentage,
        bool battery_low, builtin_interfaces/Time started_at""",
    "TwinTagState": """string tag_id, geometry_msgs/Pose pose, SensorReading[] readings, builtin_interfaces/Time last_observed,
        float32 stale_seconds, string species, float32 species_confidence, bool anomaly, uint16 flower_count,
        uint16 bug_count, FlowerPoint[] flowers, geometry_msgs/Polygon box_footprint""",
    "TwinState": "std_msgs/Header header, TwinTagState[] tags",
    "DiscoveredTag": """string tag_id, geometry_msgs/Pose pose_in_map, string species, float32 species_confidence,
        bool anomaly, uint32 sightings""",
    "DiscoveredTags": "std_msgs/Header header, DiscoveredTag[] tags",
}

SERVICES = {
    "GetTagReading": ("string tag_id", "uint8 status, string error_message, TagReading reading"),
    "StartMission": (
        "string mission_type, string[] tag_sequence, uint16 discovery_goal",
        "bool accepted, string mission_id, string error_message",
    ),
    "ConfirmTag": (
        "string expected_tag_id",
        "bool detected, float64 detection_confidence, geometry_msgs/Pose tag_pose_in_map, string error_message",
    ),
    "GetField": (
        """string sensor_type, float32 resolution, float32 bbox_min_x, float32 bbox_min_y, float32 bbox_max_x,
        float32 bbox_max_y""",
        """bool ok, string error_message, float32[] values, uint32 width, uint32 height, float32 origin_x, float32 origin_y,
        float32 resolution_used, float32 value_min, float32 value_max, uint32 sample_count""",
    ),
    "SetArmPreset": ("string name", "bool success, string message"),
    "CalibrateArm": (
        "string action",
        """bool success, string state, string message, string[] joint_names, int32[] offsets_applied,
        int32[] diffs_observed""",
    ),
    "GetArmLibrary": ("", "bool success, string json"),
    "SaveArmPose": (
        """string name, bool from_current, float64[] arm_rad, float64 gripper_rad, bool has_gripper, bool overwrite""",
        "bool success, string message",
    ),
    "ArmRecord": (
        "string action, string name, string mode, bool include_gripper, bool overwrite",
        "bool success, string message, float64 duration_s, int32 n_waypoints",
    ),
    "PlayArmSequence": ("string name, float64 speed", "bool success, string message"),
    "ArmLibraryEdit": ("string kind, string name, string new_name", "bool success, string message"),
}

CONSTANTS = {
    "msg.Observation": {
        "KIND_TAG_READING": 0,
        "KIND_FLOWER": 1,
        "KIND_ANOMALY": 2,
        "STATUS_OK": 0,
        "STATUS_UNREACHABLE": 1,
        "STATUS_SCAN_FAILED": 2,
        "STATUS_SKIPPED": 3,
    },
    "msg.MissionState": {"SEVERITY_INFO": 0, "SEVERITY_WARN": 1, "SEVERITY_ERROR": 2},
    "srv.GetTagReading.Response": {"STATUS_OK": 0, "STATUS_UNKNOWN_TAG": 1},
}

PYTHON_NAMES = {"bool": "boolean", "float32": "float", "float64": "double"}
"""Names of primitive types in rosidl_generator_py, if they differ from the ROS names."""


def expected_fields(text: str) -> list[tuple[str, str]]:
    """``"float64[] x, Tag t"`` → ``[("x", "sequence<double>"), ("t", "lupin_msgs/Tag")]``."""
    fields = []
    for field in text.split(",") if text else []:
        type_name, name = field.split()
        base = type_name.removesuffix("[]")
        base = PYTHON_NAMES.get(base, base)
        base = f"lupin_msgs/{base}" if base[0].isupper() else base
        fields.append((name, f"sequence<{base}>" if type_name.endswith("[]") else base))
    return fields


def lookup(dotted: str) -> Any:
    """``"srv.GetField.Request"`` → the class of lupin_msgs."""
    kind, name, *nested = dotted.split(".")
    found = getattr(importlib.import_module(f"lupin_msgs.{kind}"), name)
    return getattr(found, nested[0]) if nested else found


CLASSES = {f"msg.{name}": fields for name, fields in MESSAGES.items()}
for service, parts in SERVICES.items():
    CLASSES |= {f"srv.{service}.{part}": fields for part, fields in zip(("Request", "Response"), parts)}


@pytest.mark.parametrize("dotted", CLASSES)
def test_fields_have_the_agreed_names_types_and_order(dotted: str) -> None:
    assert list(lookup(dotted).get_fields_and_field_types().items()) == expected_fields(CLASSES[dotted])


@pytest.mark.parametrize(("kind", "agreed"), [("msg", MESSAGES), ("srv", SERVICES)])
def test_package_has_only_the_agreed_types(kind: str, agreed: dict[str, Any]) -> None:
    module = importlib.import_module(f"lupin_msgs.{kind}")
    assert {name for name in vars(module) if name[0].isupper() and "_" not in name} == set(agreed)
    assert len(agreed) == 11


@pytest.mark.parametrize("dotted", CONSTANTS)
def test_constants_have_the_agreed_values(dotted: str) -> None:
    found = lookup(dotted)
    assert {name: getattr(found, name) for name in CONSTANTS[dotted]} == CONSTANTS[dotted]


def test_new_message_has_the_agreed_defaults() -> None:
    assert lookup("msg.TwinState")().tags == []
    observation = lookup("msg.Observation")()
    assert (observation.kind, observation.status, observation.mission_id) == (0, 0, "")
