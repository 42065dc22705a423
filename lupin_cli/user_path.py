"""Paths of the user as options take them: ~ is the home folder, also in --map=~/x.yaml, which bash does not expand."""

from __future__ import annotations

from pathlib import Path

from lupin_runtime.bounded_file import expand_home


def path(text: str) -> Path:
    """Return the path with ~ expanded. Its name is what the help shows for an option that is parsed by it."""
    return expand_home(text)
