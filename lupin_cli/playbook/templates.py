"""Values that contain `{{ expressions }}`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from lupin_cli.playbook.expressions import Expression, ExpressionError, Name, parse

_EXPRESSION = re.compile(r"\{\{(.*?)\}\}", re.DOTALL)


@dataclass(frozen=True)
class Template:
    """Text that contains expressions. A template of only one expression keeps the type of its value."""

    parts: tuple[str | Expression, ...]

    def resolve(self, scope: Mapping[str, Any]) -> Any:
        """Return the value for the names in `scope`; raises ExpressionError."""
        values = [part if isinstance(part, str) else part.evaluate(scope) for part in self.parts]
        if len(values) == 1:
            return values[0]
        return "".join(_as_text(value) for value in values)


def _as_text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(value)


def read_template(text: str) -> Template | str:
    """Return a Template, or the text itself if it has no expression; raises ExpressionError with the column in `text`."""
    parts: list[str | Expression] = []
    position = 0
    for match in _EXPRESSION.finditer(text):
        if match.start() > position:
            parts.append(text[position : match.start()])
        try:
            parts.append(parse(match.group(1)))
        except ExpressionError as error:
            raise ExpressionError(str(error), match.start(1) + error.column) from error
        position = match.end()
    if not parts:
        if "{{" in text:
            raise ExpressionError("'{{' is never closed with '}}'", text.index("{{"))
        return text
    if position < len(text):
        parts.append(text[position:])
    return Template(tuple(parts))


def resolve(value: Any, scope: Mapping[str, Any]) -> Any:
    """Return a value with every template resolved, also in lists and mappings; raises ExpressionError."""
    if isinstance(value, Template):
        return value.resolve(scope)
    if isinstance(value, list):
        return [resolve(item, scope) for item in value]
    if isinstance(value, dict):
        return {key: resolve(item, scope) for key, item in value.items()}
    return value


def names_in(value: Any) -> Iterator[Name]:
    """Yield every name that a value's templates use."""
    if isinstance(value, Template):
        for part in value.parts:
            if isinstance(part, Expression):
                yield from part.names()
    elif isinstance(value, list):
        for item in value:
            yield from names_in(item)
    elif isinstance(value, dict):
        for item in value.values():
            yield from names_in(item)
