"""Descriptions of all installed message types."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from lupin_runtime.console.type_definitions import full_text, type_definitions
from lupin_runtime.ros import type_names
from lupin_runtime.ros.type_names import message_class_of
from tests.support.random_messages import installed_classes

SEPARATOR = "\n" + "=" * 80 + "\nMSG: "
NUMBERS = {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)} | {"octet"}


def definitions(type_name: str) -> list[dict[str, Any]]:
    return type_definitions(type_names.find(type_name, "msg"))


def contained_types(message_class: Any, found: dict[str, Any]) -> dict[str, Any]:
    for kind in message_class.SLOT_TYPES:
        kind = getattr(kind, "value_type", kind)
        if hasattr(kind, "namespaces"):
            name = f"{kind.namespaces[0]}/{kind.name}"
            found[name] = message_class_of(kind)
            contained_types(found[name], found)
    return found


def test_installed_types_include_services_and_actions() -> None:
    names = {message_class.__name__ for message_class in installed_classes()}
    assert {"LaserScan", "SetCameraInfo_Request", "LookupTransform_Goal", "LookupTransform_FeedbackMessage"} <= names


def test_definitions_of_every_type_are_complete() -> None:
    for message_class in installed_classes():
        root, *others = type_definitions(message_class)
        assert root["type"].endswith(f"/{message_class.__name__}")
        assert root["fieldnames"] == list(message_class.get_fields_and_field_types())
        expected = contained_types(message_class, {})
        assert {each["type"] for each in others} == set(expected) and len(others) == len(expected)
        for each in others:
            assert each["fieldnames"] == list(expected[each["type"]].get_fields_and_field_types())


def test_columns_of_every_definition_have_equal_length() -> None:
    for message_class in installed_classes():
        defined = type_definitions(message_class)
        known = {each["type"] for each in defined}
        for each in defined:
            rows = list(zip(each["fieldtypes"], each["fieldarraylen"], each["examples"]))
            assert len(each["fieldnames"]) == len(each["fieldtypes"]) == len(each["fieldarraylen"]) == len(each["examples"])
            for kind, length, example in rows:
                assert kind in known or "/" not in kind
                assert not set(kind) & set("<>[], ")
                assert (example == "[]") == (length >= 0)
                assert length >= 0 or (example == "{}") == (kind in known)
                assert length >= 0 or kind not in NUMBERS or int(example) is not None
                assert length >= 0 or kind != "boolean" or example in ("True", "False")


def test_constants_of_every_definition_match_the_class() -> None:
    for message_class in installed_classes():
        root = type_definitions(message_class)[0]
        values = [getattr(message_class, name) for name in root["constnames"]]
        assert root["constvalues"] == [str(value[0] if isinstance(value, bytes) else value) for value in values]
        assert not set(root["constnames"]) & {*root["fieldnames"], "SLOT_TYPES"}


def test_definitions_are_in_depth_first_order() -> None:
    assert [each["type"] for each in definitions("nav_msgs/msg/Odometry")] == [
        "nav_msgs/Odometry",
        "std_msgs/Header",
        "builtin_interfaces/Time",
        "geometry_msgs/PoseWithCovariance",
        "geometry_msgs/Pose",
        "geometry_msgs/Point",
        "geometry_msgs/Quaternion",
        "geometry_msgs/TwistWithCovariance",
        "geometry_msgs/Twist",
        "geometry_msgs/Vector3",
    ]


def test_definition_of_time_has_its_fields() -> None:
    assert definitions("builtin_interfaces/Time") == [
        {
            "type": "builtin_interfaces/Time",
            "fieldnames": ["sec", "nanosec"],
            "fieldtypes": ["int32", "uint32"],
            "fieldarraylen": [-1, -1],
            "examples": ["0", "0"],
            "constnames": [],
            "constvalues": [],
        }
    ]


def test_arrays_have_length_and_type_of_their_elements() -> None:
    info = definitions("sensor_msgs/msg/CameraInfo")[0]
    columns = zip(info["fieldtypes"], info["fieldarraylen"], info["examples"])
    rows = dict(zip(info["fieldnames"], columns))
    assert rows["d"] == ("double", 0, "[]")
    assert rows["k"] == ("double", 9, "[]")
    assert rows["roi"] == ("sensor_msgs/RegionOfInterest", -1, "{}")
    assert rows["distortion_model"] == ("string", -1, "")
    bounded = definitions("shape_msgs/msg/SolidPrimitive")[0]
    assert (bounded["fieldtypes"][1], bounded["fieldarraylen"][1]) == ("double", 0)
    assert dict(zip(bounded["constnames"], bounded["constvalues"]))["CYLINDER"] == "3"


def test_octets_are_numbers_in_examples_and_constants() -> None:
    status = definitions("diagnostic_msgs/msg/DiagnosticStatus")[0]
    assert status["fieldtypes"][0] == "octet" and status["examples"][0] == "0"
    assert dict(zip(status["constnames"], status["constvalues"]))["STALE"] == "3"


def test_full_text_has_every_contained_type_once() -> None:
    for message_class in installed_classes():
        package, kind, *_ = message_class.__module__.split(".")
        if kind != "msg":
            continue
        first, *others = full_text(f"{package}/msg/{message_class.__name__}").split(SEPARATOR)
        assert first == Path(sys.prefix, "share", package, "msg", f"{message_class.__name__}.msg").read_text(encoding="utf-8")
        names = [other.split("\n", 1)[0] for other in others]
        assert sorted(names) == sorted(contained_types(message_class, {}))


def test_full_text_is_ordered_from_the_last_field() -> None:
    text = full_text("sensor_msgs/msg/CameraInfo")
    names = [part.split("\n", 1)[0] for part in text.split(SEPARATOR)[1:]]
    assert names == ["sensor_msgs/RegionOfInterest", "std_msgs/Header", "builtin_interfaces/Time"]


def test_full_text_of_unknown_type_says_so() -> None:
    for name in ("nosuch_msgs/msg/Thing", "std_msgs/msg/Thing", "std_msgs/String", "HelloWorld", ""):
        text = full_text(name)
        assert text.startswith(f"# failed to get full definition text for {name}: ") and "\n" not in text
