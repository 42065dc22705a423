"""A console of rich's for text that comes from elsewhere: it stays text, whatever a name, a path or a log line holds."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from lupin_cli.terminal import printable


class SafeConsole(Console):
    """Prints strings without markup, emoji codes or highlighting, and replaces control characters; styles are given as Text."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Render to segments, in whose text only line feeds and tabs are left of the control characters."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(printable(segment.text), segment.style)
