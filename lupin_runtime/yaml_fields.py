"""Reads the fields of a YAML mapping as yaml-cpp does: as text, and of a key that is given twice the first."""

from __future__ import annotations

from pathlib import Path

import yaml

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.yaml_text import compose_yaml, where_and_why


class YamlFields:
    """The values of a file that holds a mapping; errors name the line of the key."""

    def __init__(self, path: Path, text: str, expected: str) -> None:
        """Parse `text`. Raises MalformedFile, with `expected` if it is no mapping."""
        try:
            root = compose_yaml(text)
        except yaml.YAMLError as error:
            raise MalformedFile(path, *where_and_why(error)) from error
        if not isinstance(root, yaml.MappingNode):
            raise MalformedFile(path, 1, f"expected {expected}")
        self._path = path
        self.nodes: dict[str, yaml.Node] = {
            key.value: value for key, value in reversed(root.value) if isinstance(key, yaml.ScalarNode)
        }

    def line(self, key: str) -> int | None:
        """Return the line of a value; None without the key."""
        node = self.nodes.get(key)
        return node.start_mark.line + 1 if node is not None else None

    def refuse(self, key: str, problem: str) -> MalformedFile:
        """Return the error that names a key, its line and what is wrong with it."""
        return MalformedFile(self._path, self.line(key), f"{key}: {problem}")

    def node(self, key: str) -> yaml.Node:
        """Return the value of a key. Raises MalformedFile without it."""
        if key not in self.nodes:
            raise MalformedFile(self._path, None, f"the key {key!r} is missing")
        return self.nodes[key]
