"""YAML with the place of each node, so that errors name file, line and column."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import yaml
from yaml.events import AliasEvent, CollectionEndEvent, CollectionStartEvent

from lupin_runtime.bounded_file import NotUtf8, decode_text, read_bounded

MAX_BYTES = 256 * 1024
MAX_DEPTH = 20


@dataclass(frozen=True)
class Place:
    """A place in a file; lines and columns count from 1, as in editors."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


class PlaybookError(Exception):
    """A playbook that cannot be played, with the place of the mistake. Raised before anything runs."""

    def __init__(self, message: str, place: Place | str) -> None:
        super().__init__(f"{place}: {message}")
        self.place = place
        self.message = message


def suggest(word: str, words: Iterable[str]) -> str:
    """Return the end of a message about an unknown word: the most similar known word, or all known words."""
    known = sorted(words)
    near = get_close_matches(word, known, n=1, cutoff=0.5)
    if near:
        return f"; did you mean {near[0]!r}?"
    return f"; known are: {', '.join(known)}" if known else ""


class _CoreLoader(yaml.SafeLoader):
    """The core schema of YAML 1.2, where `on`, `yes` and `10:30` are text, not truth values and seconds."""


_CoreLoader.yaml_implicit_resolvers = {}
for _tag, _pattern, _first in (
    ("bool", r"^(?:true|false)$", "tf"),
    ("int", r"^[-+]?[0-9]+$", "-+0123456789"),
    ("float", r"^[-+]?(?:[0-9]+\.[0-9]*|\.[0-9]+|[0-9]+)(?:[eE][-+]?[0-9]+)?$", "-+.0123456789"),
    ("null", r"^(?:null|~|)$", "n~\0"),
):
    _CoreLoader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(_pattern), list(_first) + [""] * (_tag == "null"))

_PLAIN_TAGS = {f"tag:yaml.org,2002:{name}" for name in ("str", "int", "float", "bool", "null", "map", "seq")}

_SCALARS: dict[str, Callable[[str], Any]] = {
    "int": int,
    "float": float,
    "bool": {"true": True, "false": False}.__getitem__,
    "null": lambda _text: None,
}


class YamlSource:
    """One YAML file, and the values of its nodes."""

    def __init__(self, file: str, text: str) -> None:
        """Parse `text`; raises PlaybookError with the first place that isn't plain YAML."""
        self.file = file
        self.text = text
        self.root = self._compose(text)

    @classmethod
    def read(cls, path: Path) -> YamlSource:
        """Read a file; raises PlaybookError if it cannot be read."""
        try:
            data = read_bounded(path)
            if len(data) > MAX_BYTES:
                raise PlaybookError(f"has {len(data)} bytes; a playbook has at most {MAX_BYTES}", str(path))
            text = decode_text(data, path)
        except NotUtf8 as error:
            raise PlaybookError(error.problem, Place(str(path), error.line, error.column)) from error
        except OSError as error:
            raise PlaybookError(f"cannot be read: {error.strerror or error}", str(path)) from error
        return cls(str(path), text)

    def _compose(self, text: str) -> yaml.Node:
        try:
            depth = 0
            for event in yaml.parse(text, Loader=_CoreLoader):
                depth += isinstance(event, CollectionStartEvent) - isinstance(event, CollectionEndEvent)
                if depth > MAX_DEPTH:
                    raise PlaybookError(f"is nested more than {MAX_DEPTH} deep", self._place(event.start_mark))
                if isinstance(event, AliasEvent):
                    raise PlaybookError("aliases (*name) are not allowed: use a variable", self._place(event.start_mark))
            root = yaml.compose(text, Loader=_CoreLoader)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            place = self._place(mark) if mark else self.file
            raise PlaybookError(f"is not YAML: {error.problem or error.context}", place) from error
        except yaml.YAMLError as error:
            raise PlaybookError(f"is not YAML: {error}".replace("\n", " "), self.file) from error
        if root is None:
            raise PlaybookError("is empty: expected 'name' and 'steps'", Place(self.file, 1, 1))
        return root

    def _place(self, mark: Any) -> Place:
        return Place(self.file, mark.line + 1, mark.column + 1)

    def place(self, node: yaml.Node, column_offset: int = 0) -> Place:
        """Return where a node begins; in a scalar on one line, `column_offset` columns further."""
        place = self._place(node.start_mark)
        if column_offset and isinstance(node, yaml.ScalarNode) and node.style not in ("|", ">"):
            return Place(place.file, place.line, place.column + column_offset + (1 if node.style in ("'", '"') else 0))
        return place

    def error(self, node: yaml.Node, message: str, column_offset: int = 0) -> PlaybookError:
        """Return an error at a node, to be raised."""
        return PlaybookError(message, self.place(node, column_offset))

    def mapping(self, node: yaml.Node, what: str) -> dict[str, tuple[yaml.Node, yaml.Node]]:
        """Return the key and value nodes of a mapping by key; raises PlaybookError for another node or a duplicate key."""
        if not isinstance(node, yaml.MappingNode):
            raise self.error(node, f"{what} is a mapping of keys to values, not {kind(node)}")
        entries: dict[str, tuple[yaml.Node, yaml.Node]] = {}
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise self.error(key, f"a key of {what} is a word, not {kind(key)}")
            if key.value in entries:
                first = self.place(entries[key.value][0])
                raise self.error(key, f"{key.value!r} is in {what} twice; first in line {first.line}")
            entries[key.value] = (key, value)
        return entries

    def sequence(self, node: yaml.Node, what: str) -> list[yaml.Node]:
        """Return the nodes of a list; raises PlaybookError for another node."""
        if not isinstance(node, yaml.SequenceNode):
            raise self.error(node, f"{what} is a list, not {kind(node)}")
        return list(node.value)

    def plain(self, node: yaml.Node) -> Any:
        """Return the value of a node: text, a number, true, false, None, or lists and mappings of them."""
        if node.tag not in _PLAIN_TAGS:
            raise self.error(
                node, f"the tag {node.tag!r} is not allowed: values are text, numbers, true, false, lists and mappings"
            )
        if isinstance(node, yaml.MappingNode):
            return {name: self.plain(value) for name, (_, value) in self.mapping(node, "this mapping").items()}
        if isinstance(node, yaml.SequenceNode):
            return [self.plain(item) for item in node.value]
        read = _SCALARS.get(node.tag.rpartition(":")[2], str)
        try:
            return read(node.value)
        except (KeyError, ValueError) as error:
            raise self.error(node, f"{node.value!r} is not {kind(node)}") from error

    def text_of(self, node: yaml.Node, what: str) -> str:
        """Return the value of a node that must be non-empty text."""
        value = self.plain(node)
        if not isinstance(value, str) or not value:
            raise self.error(node, f"{what} is text, not {kind(node)}")
        return value


def kind(node: yaml.Node) -> str:
    """Return what kind of value a node is, in words for error messages."""
    names = {"str": "text", "int": "a number", "float": "a number", "bool": "true or false", "null": "nothing"}
    if isinstance(node, yaml.MappingNode):
        return "a mapping"
    if isinstance(node, yaml.SequenceNode):
        return "a list"
    return names.get(node.tag.rpartition(":")[2], "this")
