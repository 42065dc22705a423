"""YAML from elsewhere is plain, and nested only so deep."""

from __future__ import annotations

import pytest
import yaml

from lupin_runtime.yaml_text import MAX_DEPTH, compose_yaml, load_yaml


def test_document_of_the_greatest_depth_is_read() -> None:
    text = "[" * (MAX_DEPTH - 1) + "1" + "]" * (MAX_DEPTH - 1)
    assert isinstance(compose_yaml(text), yaml.SequenceNode)


@pytest.mark.parametrize("bracket", ["[", "{", "- "])
def test_deeper_document_is_refused_with_its_line(bracket: str) -> None:
    with pytest.raises(yaml.MarkedYAMLError, match="nested more than") as error:
        load_yaml("a: 1\nb:\n  " + bracket * 5000)
    assert error.value.problem_mark is not None and error.value.problem_mark.line == 2


def test_tag_builds_no_object() -> None:
    with pytest.raises(yaml.YAMLError):
        load_yaml("!!python/object/apply:os.getpid []")
