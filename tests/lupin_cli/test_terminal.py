"""Text from elsewhere reaches a terminal without control characters."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import lupin_cli
from lupin_cli.terminal import echo, printable, status_line


@given(st.text())
def test_printable_keeps_text_and_replaces_control_characters(text: str) -> None:
    shown = printable(text)
    assert all(character in "\n\t" or not (character < " " or "\x7f" <= character <= "\x9f") for character in shown)
    assert printable(shown) == shown
    if text.isprintable():
        assert shown == text


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x1b]0;title\x07", "�]0;title�"),
        ("\x9b2J", "�2J"),
        ("a\r\nb\tc\n", "a\nb\tc\n"),
        ("1 %\r2 %", "1 %�2 %"),
        ("del\x7f", "del�"),
        ("Grüße, 植物", "Grüße, 植物"),
    ],
)
def test_printable_replaces_what_a_terminal_obeys(text: str, shown: str) -> None:
    assert printable(text) == shown


def test_echo_prints_no_escape_sequences(capsys: pytest.CaptureFixture[str]) -> None:
    echo("\x1b[2Jout")
    echo("\x1b[2Jerr", err=True)
    echo("same line", nl=False)
    captured = capsys.readouterr()
    assert captured.out == "�[2Jout\nsame line" and captured.err == "�[2Jerr\n"


def test_json_escapes_control_characters_itself() -> None:
    assert "\x1b" not in json.dumps("\x1b[2J")


def test_status_line_is_erased_after_the_block(capsys: pytest.CaptureFixture[str]) -> None:
    with status_line("asking greenhouse ...", shown=True):
        pass
    with status_line("not shown", shown=False):
        pass
    assert capsys.readouterr().err == "asking greenhouse ...\r\x1b[K"


def test_only_terminal_prints_through_typer() -> None:
    package = Path(lupin_cli.__file__).parent
    callers = {path.name for path in package.rglob("*.py") if "typer.echo(" in path.read_text()}
    assert callers == {"terminal.py"}
