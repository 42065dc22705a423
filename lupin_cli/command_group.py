"""How a group of commands, such as `lupin sim`, is made."""

from __future__ import annotations

import inspect
from typing import Any

import typer


def command_group(description: str, example: str, **options: Any) -> typer.Typer:
    """Return a group without commands; its help is `description` and `example`, `options` are more of Typer's.

    Help and errors are plain text: they are also read by scripts and in terminals without colors.
    """
    return typer.Typer(
        help=f"{inspect.cleandoc(description)}\n\nExample: {example}",
        add_completion=False,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        **options,
    )
