"""Message definitions in a recording are complete, whether installed or rebuilt from the class."""

from __future__ import annotations

from pathlib import Path

import pytest

from lupin_runtime import graph
from lupin_runtime.record.definitions import DefinitionMissing, schema_text
from lupin_runtime.ros.interfaces import interface

DELIMITER = "=" * 80


def fields(type_name: str) -> dict[str, str]:
    return dict(interface(type_name).get_fields_and_field_types())


def sections(text: str) -> dict[str, str]:
    first, *rest = text.split(f"\n{DELIMITER}\n")
    named = dict(part.split("\n", 1) for part in rest)
    return {"": first} | {name.removeprefix("MSG: "): body for name, body in named.items()}


def test_schema_contains_each_dependency_once() -> None:
    parts = sections(schema_text("lupin_msgs/msg/TwinState"))
    assert set(parts) == {
        "",
        "std_msgs/Header",
        "builtin_interfaces/Time",
        "lupin_msgs/TwinTagState",
        "lupin_msgs/SensorReading",
        "lupin_msgs/FlowerPoint",
        "geometry_msgs/Pose",
        "geometry_msgs/Point",
        "geometry_msgs/Quaternion",
        "geometry_msgs/Polygon",
        "geometry_msgs/Point32",
    }
    assert "TwinTagState[] tags" in parts[""]


def test_schema_keeps_constants() -> None:
    assert "STATUS_UNREACHABLE = 1" in schema_text("lupin_msgs/msg/Observation")


@pytest.mark.parametrize("type_name", sorted({topic.type for topic in graph.topics()}))
def test_every_type_of_the_graph_has_an_installed_definition(type_name: str) -> None:
    assert schema_text(type_name)


@pytest.mark.parametrize("type_name", ["sensor_msgs/msg/LaserScan", "lupin_msgs/msg/Observation", "sensor_msgs/msg/Imu"])
def test_schema_rebuilt_from_the_class_has_the_same_fields(type_name: str) -> None:
    def bare(text: str) -> list[tuple[str, ...]]:
        lines = (line.split("#")[0].split() for line in text.splitlines())
        return [tuple(words[:2]) for words in lines if words and not any("=" in word for word in words)]

    rebuilt = sections(schema_text(type_name, shares=[], fields=fields))
    installed = sections(schema_text(type_name))
    assert set(rebuilt) == set(installed)
    for name, text in rebuilt.items():
        short = [(kind.split("/")[-1], field) for kind, field in bare(text)]
        assert short == [(kind.split("/")[-1], field) for kind, field in bare(installed[name])]


def test_missing_definition_is_named() -> None:
    with pytest.raises(DefinitionMissing, match=r"share/nowhere_msgs/msg/Thing\.msg"):
        schema_text("nowhere_msgs/msg/Thing", shares=[Path("/nonexistent")])
