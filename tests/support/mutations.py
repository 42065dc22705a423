"""Seeded damage to valid files: what a person, a robot or a failing disk may leave in one."""

from __future__ import annotations

import json
import os
import random
import re
from pathlib import Path
from typing import Any

from lupin_runtime.json_text import parse_json

# What readers of text forget: numbers beyond every type, deep nesting, terminal sequences, and text that is none.
HOSTILE_TEXTS = (
    "",
    "\0",
    "\x1b]52;c;cm0gLXJmIH4=\x07",
    "\x9b2J",
    "\u202ehtml.exe\u2066",
    "[bold]x[/nothing]",
    "nan",
    "-inf",
    "1e400",
    "-1",
    "0",
    "9" * 25,
    "9" * 5000,
    "[" * 3000,
    "{" * 3000,
    "(" * 3000,
    "x" * 300,
    "../" * 40,
    "~nouser/x.yaml",
    "/dev/zero",
    "null",
    "[]",
    "{}",
    "true",
    "2024-13-45",
    "!!python/object/apply:os.getpid []",
    "&a [*a]",
    "*a",
    "\udcff",
    "é\u0301",
    "\r",
    "\u2028",
)
HOSTILE_VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 10**30, -(10**30), 1e308, float("nan"), float("inf"), "", "x", "\0", "\x1b]0;title\x07", "\u202etxt",
    "x" * 300, [], {}, [[]], [None], {"": None}, {"x": {"y": [1]}}, "../" * 40, "~nouser/x",
)  # fmt: skip
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")
_WORD = re.compile(rb"[A-Za-z_/~.-][A-Za-z0-9_/~.-]*")


def damage(data: bytes, dice: random.Random) -> bytes:
    """Return the content of a file with one to three kinds of damage."""
    for _ in range(dice.choice((1, 1, 1, 2, 3))):
        data = dice.choice(_DAMAGES)(data, dice)
    return data


def replace_by_special_file(path: Path, dice: random.Random) -> str:
    """Replace a file by something that is none, or that never ends; return what it is."""
    path.unlink(missing_ok=True)
    kind = dice.choice(("fifo", "folder", "loop", "dangling", "endless", "missing"))
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "loop":
        path.symlink_to(path)
    elif kind == "dangling":
        path.symlink_to(path.with_name("nothing"))
    elif kind == "endless":
        path.symlink_to("/dev/zero")
    return kind


def _flip(data: bytes, dice: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(min(len(data), dice.choice((1, 1, 4, 16)))):
        changed[dice.randrange(len(data))] = dice.randrange(256)
    return bytes(changed)


def _truncate(data: bytes, dice: random.Random) -> bytes:
    return data[: dice.randrange(len(data) + 1)]


def _append(data: bytes, dice: random.Random) -> bytes:
    return data + dice.randbytes(dice.randrange(1, 9))


def _cut(data: bytes, dice: random.Random) -> bytes:
    start = dice.randrange(len(data) + 1)
    return data[:start] + data[start + dice.randrange(1, 40) :]


def _repeat(data: bytes, dice: random.Random) -> bytes:
    start = dice.randrange(len(data) + 1)
    end = start + dice.randrange(1, 200)
    return data[:end] + data[start:end] * dice.choice((1, 2, 50)) + data[end:]


def _insert(data: bytes, dice: random.Random) -> bytes:
    at = dice.randrange(len(data) + 1)
    return data[:at] + _hostile(dice) + data[at:]


def _replace_line(data: bytes, dice: random.Random) -> bytes:
    lines = data.split(b"\n")
    chosen = dice.randrange(len(lines))
    lines[chosen : chosen + 1] = dice.choice(([], [_hostile(dice)], [lines[chosen]] * 2))
    return b"\n".join(lines)


def _replace_number(data: bytes, dice: random.Random) -> bytes:
    return _replace(_NUMBER, data, dice)


def _replace_word(data: bytes, dice: random.Random) -> bytes:
    return _replace(_WORD, data, dice)


def _replace(pattern: re.Pattern[bytes], data: bytes, dice: random.Random) -> bytes:
    found = [*pattern.finditer(data)]
    if not found:
        return _insert(data, dice)
    chosen = dice.choice(found)
    return data[: chosen.start()] + _hostile(dice) + data[chosen.end() :]


def _replace_json_value(data: bytes, dice: random.Random) -> bytes:
    """Replace or remove one value of a JSON document, or of one line of JSON lines; other files get another damage."""
    lines = [data] if data[:1] in b"[" or b"\n{" not in data else data.split(b"\n")
    chosen = dice.randrange(len(lines))
    try:
        document = parse_json(lines[chosen])
    except ValueError:
        return _replace_number(data, dice)
    lines[chosen] = json.dumps(_with_other_value(document, dice)).encode("utf-8", "replace")
    return b"\n".join(lines)


def _with_other_value(document: Any, dice: random.Random) -> Any:
    holders = [(document, key) for key in _keys(document)]
    for holder, key in holders:  # grows while it is read: every value of the document
        holders += [(holder[key], inner) for inner in _keys(holder[key])]
    if not holders or dice.random() < 0.1:
        return dice.choice(HOSTILE_VALUES)
    holder, key = dice.choice(holders)
    if dice.random() < 0.25:
        del holder[key]
    else:
        holder[key] = dice.choice(HOSTILE_VALUES)
    return document


def _keys(value: Any) -> list[Any]:
    if isinstance(value, dict):
        return [*value]
    return [*range(len(value))] if isinstance(value, list) else []


def _hostile(dice: random.Random) -> bytes:
    return dice.choice(HOSTILE_TEXTS).encode("utf-8", "surrogateescape")


_DAMAGES = (
    _flip, _truncate, _append, _cut, _repeat, _insert, _replace_line, _replace_number, _replace_number, _replace_word,
    _replace_json_value, _replace_json_value, _replace_json_value,
)  # fmt: skip
