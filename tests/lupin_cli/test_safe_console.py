"""Text from elsewhere reaches a terminal as text: no escape sequence, no markup, no change of direction."""

from __future__ import annotations

import io
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from lupin_cli.safe_console import SafeConsole

HOSTILE = (
    "\x1b]52;c;ZWNobyBoaQ==\x07",
    "\x1b]0;title\x1b\\",
    "\x9b2J",
    "\x9d0;title\x9c",
    "a\rb",
    "\u202egnp.exe",
    "\u2066x\u2069",
    "\x7f",
)


def printed(renderable: object) -> str:
    """Return what a console that is no terminal writes."""
    stream = io.StringIO()
    SafeConsole(file=stream).print(renderable, soft_wrap=True)
    return stream.getvalue()


def as_table(text: str) -> Table:
    table = Table(title=text)
    table.add_column(text)
    table.add_row(text)
    return table


DIRECTIONS = ("LRE", "RLE", "PDF", "LRO", "RLO", "LRI", "RLI", "FSI", "PDI")
SHAPES = [str, Text, Panel, as_table]


@pytest.mark.parametrize("shape", SHAPES)
@given(text=st.text() | st.sampled_from(HOSTILE) | st.tuples(st.sampled_from(HOSTILE), st.text()).map("".join))
def test_no_control_character_is_written(shape: type, text: str) -> None:
    characters = set(printed(shape(text))) - {"\n", "\t"}
    assert not {each for each in characters if unicodedata.category(each) in ("Cc", "Zl", "Zp")}
    assert not {each for each in characters if unicodedata.bidirectional(each) in DIRECTIONS}


@pytest.mark.parametrize("text", ["[bold]x[/bold]", "[/]", "/tmp/[red]/x", ":smile:", "[link=http://x]y", "\\[x]"])
def test_markup_stays_text(text: str) -> None:
    assert printed(text) == text + "\n"
    assert text in printed(as_table(text))
