"""Values in a playbook's YAML: templates, conditions, numbers and truth values, checked where they are read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import yaml

from lupin_cli.playbook.expressions import Expression, ExpressionError, Name
from lupin_cli.playbook.expressions import parse as parse_expression
from lupin_cli.playbook.model import BUILTINS
from lupin_cli.playbook.templates import names_in, read_template
from lupin_cli.playbook.yaml_source import PlaybookError, YamlSource, suggest

Entries = Mapping[str, tuple[yaml.Node, yaml.Node]]  # key and value nodes by key

_MAX_RETRIES = 100
_MAX_DURATION_S = 3600.0


class NameScope:
    """The names that a place in one file may use: the file's variables, and the results of earlier steps."""

    def __init__(self) -> None:
        self.known: dict[str, tuple[str, ...] | None] = dict(BUILTINS)  # None: a value without parts

    def check(self, name: Name, fail: Callable[[str], PlaybookError]) -> None:
        """Raise `fail(message)` if the name cannot be used here."""
        first, rest = name.path[0], name.path[1:]
        if first not in self.known:
            raise fail(f"{first!r} is neither a variable nor the result of an earlier step{suggest(first, self.known)}")
        parts = self.known[first]
        if parts is None and rest:
            raise fail(f"{first!r} is a plain value and has no {rest[0]!r}")
        if parts is not None and (not rest or rest[0] not in parts):
            word = rest[0] if rest else ""
            raise fail(
                f"{first!r} has no value {word!r}{suggest(word, parts)}"
                if rest
                else f"say which value of {first!r}: {', '.join(parts)}"
            )


def require_known_keys(source: YamlSource, entries: Entries, known: tuple[str, ...], what: str) -> None:
    """Raise PlaybookError for a key of the mapping `what` that is not known."""
    for key, (node, _) in entries.items():
        if key not in known:
            raise source.error(node, f"{what} has no key {key!r}{suggest(key, known)}")


def read_value(source: YamlSource, node: yaml.Node, names: NameScope) -> Any:
    """Return a value whose texts may be templates over `names`; raises PlaybookError."""
    if isinstance(node, yaml.MappingNode):
        return {key: read_value(source, value, names) for key, (_, value) in source.mapping(node, "this mapping").items()}
    if isinstance(node, yaml.SequenceNode):
        return [read_value(source, item, names) for item in node.value]
    value = source.plain(node)
    if not isinstance(value, str):
        return value
    try:
        template = read_template(value)
    except ExpressionError as error:
        raise source.error(node, f"in {{{{ }}}}: {error}", error.column) from error
    for name in names_in(template):
        names.check(name, lambda message: source.error(node, message))
    return template


def read_condition(source: YamlSource, node: yaml.Node, names: NameScope) -> Expression:
    """Return a condition over `names`; raises PlaybookError."""
    text = node.value if isinstance(node, yaml.ScalarNode) else source.text_of(node, "a condition")
    try:
        expression = parse_expression(text)
    except ExpressionError as error:
        raise source.error(node, f"the condition {text!r}: {error}", error.column) from error
    for name in expression.names():
        names.check(name, partial(_condition_error, source, node, name.column))
    return expression


def _condition_error(source: YamlSource, node: yaml.Node, column: int, message: str) -> PlaybookError:
    return source.error(node, message, column)


def read_count(source: YamlSource, node: yaml.Node, what: str) -> int:
    """Return a whole number from 0 to 100; raises PlaybookError."""
    value = source.plain(node)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= _MAX_RETRIES:
        raise source.error(node, f"{what} is a whole number from 0 to {_MAX_RETRIES}, not {value!r}")
    return value


def read_seconds(source: YamlSource, node: yaml.Node, what: str) -> float:
    """Return a number of seconds, more than 0 and at most 3600; raises PlaybookError."""
    value = source.plain(node)
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not 0 < value <= _MAX_DURATION_S:
        raise source.error(node, f"{what} is a number of seconds, more than 0 and at most {_MAX_DURATION_S:g}, not {value!r}")
    return float(value)


def read_truth(source: YamlSource, node: yaml.Node) -> bool:
    """Return true or false; raises PlaybookError."""
    value = source.plain(node)
    if not isinstance(value, bool):
        raise source.error(node, f"expected true or false, found {node.value!r}")
    return value
