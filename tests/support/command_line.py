"""The real command line of `lupin`: all its commands, and what is wrong with one that somebody is told to type."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import typer

from lupin_cli.app import app
from lupin_cli.printed_commands import repeat_inventory

FIELD = "FIELD"  # stands for the value of an f-string's field
ALLOWED_PLACEHOLDERS = {"NAME"}  # `lupin console revoke NAME`, below a list of the names
GROUP: Any = typer.main.get_command(app)


def all_commands() -> Iterator[tuple[str, Any]]:
    """Yield every command and group with the words that call it, `lupin` first."""
    waiting = [("lupin", GROUP, typer.Context(GROUP))]
    while waiting:
        words, command, context = waiting.pop()
        yield words, command
        for name in command.list_commands(context) if hasattr(command, "list_commands") else ():
            following = command.get_command(context, name)
            waiting.append((f"{words} {name}", following, typer.Context(following, parent=context)))


def parse_words(words: list[str]) -> str:
    """Return what the parser of `lupin` says against the words after `lupin`; empty if it accepts them. Runs nothing."""
    found, context = GROUP, typer.Context(GROUP)
    rest = list(words)
    try:
        while hasattr(found, "resolve_command") and rest and not rest[0].startswith("-"):
            name, following, rest = found.resolve_command(context, rest)
            found, context = following, typer.Context(following, info_name=name, parent=context)
        if hasattr(found, "resolve_command") and not (found.invoke_without_command and not rest):
            return f"{' '.join(words)}: {found.name} needs a command"
        found.make_context(found.name, rest, parent=context.parent)
    except typer.Exit:
        return ""
    except Exception as error:  # of click, or of the copy of click in newer versions of typer
        if not hasattr(error, "format_message"):
            raise
        return f"{' '.join(words)}: {error.format_message()}"
    finally:
        repeat_inventory(None)  # parsing --config sets it
    return ""


def mistake_in(command: str) -> str:
    """Return what is wrong with the words after `lupin`; empty if the command line of `lupin` has them."""
    words = [word.rstrip(".:") for word in command.replace(FIELD, f" {FIELD} ").split()]
    found = GROUP
    context = typer.Context(found)
    while words and hasattr(found, "get_command"):
        if words[0].startswith("-"):
            break
        following = found.get_command(context, words[0])
        if following is None:
            return "" if words[0] == FIELD else f"there is no command {words[0]!r}"
        found, context, words = following, typer.Context(following, parent=context), words[1:]
    known = {option for parameter in found.params for option in (*parameter.opts, *parameter.secondary_opts)} | {"--help", "-h"}
    for word in words:
        if word == "--":  # a program with options of its own follows
            break
        if word.startswith("-") and word.partition("=")[0] not in known:
            return f"there is no option {word}"
        if re.fullmatch(r"[A-Z][A-Z_]+(\.json)?", word) and word != FIELD and word not in ALLOWED_PLACEHOLDERS:
            return f"{word} cannot be pasted"
    return ""
