"""Parses YAML that comes from elsewhere: plain values only, and nested only so deep that neither stack nor time run out."""

from __future__ import annotations

from typing import Any

import yaml

MAX_DEPTH = 50  # PyYAML's time grows with the square of the depth, and its stack with the depth


class BoundedLoader(yaml.SafeLoader):
    """PyYAML's safe loader, which refuses a document that is nested more than MAX_DEPTH deep with a MarkedYAMLError."""

    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Compose a node and what it contains."""
        self._depth += 1
        if self._depth > MAX_DEPTH:
            mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.composer.ComposerError(None, None, f"it is nested more than {MAX_DEPTH} deep", mark)
        try:
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1


def compose_yaml(text: str) -> yaml.Node | None:
    """Return the nodes of a document; None if it is empty. Raises yaml.YAMLError."""
    root: yaml.Node | None = yaml.compose(text, Loader=BoundedLoader)
    return root


def where_and_why(error: Exception) -> tuple[int | None, str]:
    """Return the line at which a document is not YAML, None if it is not known, and the reason in one line."""
    mark = getattr(error, "problem_mark", None)
    reason = str(getattr(error, "problem", None) or error).replace("\n", " ")
    return mark.line + 1 if mark is not None else None, f"not YAML: {reason}"


def load_yaml(text: str | bytes) -> Any:
    """Return the value of a document. Raises yaml.YAMLError, and ValueError for a value such as the date 2024-13-45."""
    return yaml.load(text, Loader=BoundedLoader)  # noqa: S506 -- a safe loader
