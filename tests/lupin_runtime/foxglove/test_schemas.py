"""Definitions of all installed message types in Foxglove's format."""

from __future__ import annotations

import re

import pytest

from lupin_runtime import graph
from lupin_runtime.foxglove.schemas import ros2msg_schema
from lupin_runtime.ros import type_names
from tests.support.random_messages import installed_classes

SEPARATOR = "\n" + "=" * 80 + "\nMSG: "
PRIMITIVES = {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)} | {
    *("bool", "byte", "char", "float32", "float64", "string", "wstring")
}
FIELD = re.compile(r"^(?P<type>[A-Za-z][\w/]*)(?:<=\d+)?(?:\[(?:<=)?\d*\])?\s+(?P<name>[a-z]\w*)\s*(?P<rest>.*)$")


def topic_types() -> list[str]:
    """Return the types that a topic can have: messages, and the feedback of actions."""
    found = []
    for message_class in installed_classes():
        package, kind, _ = message_class.__module__.split(".", 2)
        if kind == "msg" or message_class.__name__.endswith("_FeedbackMessage"):
            found.append(f"{package}/{kind}/{message_class.__name__}")
    return found


def fields(text: str) -> list[tuple[str, str]]:
    """Return type and name of every field of one definition."""
    lines = (line.split("#", 1)[0].strip() for line in text.splitlines())
    found = [FIELD.match(line) for line in lines if line]
    return [(each["type"], each["name"]) for each in found if each and not each["rest"].startswith("=")]


@pytest.mark.parametrize("type_name", topic_types())
def test_every_contained_type_is_defined_with_all_its_fields(type_name: str) -> None:
    root, *others = ros2msg_schema(type_name).split(SEPARATOR)
    package, _, name = type_name.split("/")
    definitions = {f"{package}/{name}": root, **{each.partition("\n")[0]: each.partition("\n")[2] for each in others}}
    assert len(definitions) == len(others) + 1
    for owner, text in definitions.items():
        for kind, _ in fields(text):
            if kind not in PRIMITIVES:
                assert (kind if "/" in kind else f"{owner.split('/')[0]}/{kind}") in definitions
    names = list(type_names.find(type_name, "msg").get_fields_and_field_types())
    if names != ["structure_needs_at_least_one_member"]:
        assert [field for _, field in fields(root)] == names


def test_types_of_the_graph_are_defined() -> None:
    assert {row.type for row in graph.topics()} <= set(topic_types())
    assert any(name.endswith("_FeedbackMessage") for name in topic_types())


def test_type_that_is_not_installed_is_refused() -> None:
    with pytest.raises(type_names.UnknownType, match="no_such_msgs"):
        ros2msg_schema("no_such_msgs/msg/Thing")
