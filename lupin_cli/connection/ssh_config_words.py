"""The words of ssh_config(5) as OpenSSH 9 reads them: how lines are split, what patterns match, what tokens and hops mean."""

from __future__ import annotations

import getpass
import hashlib
import os
import re
import socket
from collections.abc import Mapping
from pathlib import Path

MAX_PATTERN = 1023  # characters of one pattern of a list
BLANKS = " \t\r\n"


class ConfigError(ValueError):
    """A configuration that ssh would refuse, or that only ssh can apply. The message names file and line."""


def split_word(text: str | None) -> tuple[str | None, str | None]:
    """Return the first word of a line and the rest, as OpenSSH's strdelim does: an = may stand between them.

    The word is None at the end, and for a quotation mark that is not closed.
    """
    if text is None:
        return None, None
    found = re.search(r'[ \t\r\n"=]', text)
    if found is None:
        return text, None
    start = found.start()
    if found[0] == '"':
        text = text[:start] + text[start + 1 :]
        end = text.find('"', start)
        return (None, None) if end < 0 else (text[:end], text[end + 1 :].lstrip(BLANKS))
    rest = text[start + 1 :].lstrip(BLANKS)
    if found[0] != "=" and rest.startswith("="):
        rest = rest[1:].lstrip(BLANKS)
    return text[:start], rest


def split_line(line: str) -> tuple[str, str]:
    """Return the keyword of a line, in small letters, and the rest; both are empty for a comment."""
    word, rest = split_word(line.rstrip(BLANKS + "\f"))
    if word == "":
        word, rest = split_word(rest)
    if not word or word.startswith("#"):
        return "", ""
    return word.lower(), (rest or "").lstrip(BLANKS)


def split_arguments(text: str) -> list[str]:
    """Return the arguments of a keyword, up to a comment. Raises ValueError for a quotation mark that is not closed."""
    arguments: list[str] = []
    at = 0
    while at < len(text):
        if text[at] in " \t":
            at += 1
            continue
        if text[at] == "#":
            break
        quote, word = "", ""
        while at < len(text) and (quote or text[at] not in " \t"):
            mark, following = text[at], text[at + 1 : at + 2]
            if mark == "\\" and ((following and following in "'\"\\") or (not quote and following == " ")):
                word += following
                at += 1
            elif not quote and mark in "\"'":
                quote = mark
            elif mark == quote:
                quote = ""
            else:
                word += mark
            at += 1
        if quote:
            raise ValueError("invalid quotes")
        arguments.append(word)
    return arguments


def matches(pattern: str, text: str) -> bool:
    """Return whether a pattern with the wildcards * and ? stands for `text`."""
    expression = re.escape(pattern).replace(r"\*", ".*").replace(r"\?", ".")
    return re.fullmatch(expression, text, re.DOTALL) is not None


def matches_list(patterns: str, text: str, *, lower: bool = False) -> bool:
    """Return whether a list of patterns with commas stands for `text`. One with ! that matches excludes it."""
    included = False
    for pattern in patterns.lower().split(",") if lower else patterns.split(","):
        if len(pattern.removeprefix("!")) >= MAX_PATTERN:
            return False
        if matches(pattern.removeprefix("!"), text):
            if pattern.startswith("!"):
                return False
            included = True
    return included


def expand(text: str, tokens: Mapping[str, str]) -> str:
    """Return `text` with its %-tokens replaced. Raises ConfigError for one that is not in `tokens`."""

    def replaced(found: re.Match[str]) -> str:
        if found[1] == "%":
            return "%"
        if found[1] not in tokens:
            raise ConfigError(f"unknown token {found[0]} in {text!r}")
        return tokens[found[1]]

    return re.sub(r"%(.?)", replaced, text, flags=re.DOTALL)


def expand_variables(text: str) -> str:
    """Return `text` with each ${VARIABLE} replaced. Raises ConfigError for one that is not set."""

    def replaced(found: re.Match[str]) -> str:
        if found[1] not in os.environ:
            raise ConfigError(f"the environment variable {found[1]} of {text!r} is not set")
        return os.environ[found[1]]

    return re.sub(r"\$\{([^}]*)\}", replaced, text)


def tokens_of(host: str, original_host: str, user: str, port: int, host_key_alias: str, home: Path) -> dict[str, str]:
    """Return the %-tokens of a connection that stand in paths."""
    this = socket.gethostname()
    return {
        "C": hashlib.sha1(f"{this}{host}{port}{user}".encode("utf-8", "surrogateescape"), usedforsecurity=False).hexdigest(),
        "L": this.partition(".")[0],
        "d": str(home),
        "h": host,
        "i": str(os.getuid()),
        "k": host_key_alias or original_host,
        "l": this,
        "n": original_host,
        "p": str(port),
        "r": user,
        "u": getpass.getuser(),
    }


def expand_path(text: str, tokens: Mapping[str, str], home: Path) -> str:
    """Return a path with ~, %-tokens and ${VARIABLES} replaced. Raises ConfigError."""
    return expand(expand_variables(expand_tilde(text, home)), tokens)


def expand_tilde(text: str, home: Path) -> str:
    """Return a path with a leading ~ replaced: alone by `home`, before a name by that user's."""
    if text == "~" or text.startswith("~/"):
        return f"{home}/{text[1:].lstrip('/')}"
    return os.path.expanduser(text)  # noqa: PTH111 -- Path.expanduser raises for an unknown user


def parse_port(text: str) -> int:
    """Return the number of a port, which may be named by its service; 0 for none."""
    if text.isascii() and text.isdigit():
        return int(text) if len(text) < 10 and int(text) < 65536 else 0
    try:
        return socket.getservbyname(text, "tcp")
    except (OSError, ValueError):
        return 0


def parse_hop(text: str) -> tuple[str, str, int]:
    """Split a hop of ProxyJump, [user@]host[:port] or ssh://[user@]host[:port]/, into user (or ""), host and port (or 0).

    Raises ValueError.
    """
    from urllib.parse import unquote

    refused = ValueError(f'Invalid ProxyJump "{text}"')
    is_uri = text.startswith("ssh://")
    if is_uri:
        text = text.removeprefix("ssh://")
        user, at, place = text.partition("@") if "@" in text else ("", "", text)
        user = unquote(user.partition(";")[0])
    else:
        user, at, place = text.rpartition("@")  # user@corp.example@host
    found = re.fullmatch(r"(\[[^\]]*\]|[^:/]+)(?:([:/])(.*))?", place)
    if found is None or (at and not user) or not found[1].strip("[]"):
        raise refused
    _, mark, rest = found.groups()
    port = 0
    if is_uri and rest and mark == ":":
        rest, _, path = rest.partition("/")
        port = parse_port(rest)
        if path or not port:
            raise refused
    elif is_uri and rest:
        raise refused  # a path
    elif rest and not (port := parse_port(rest)):
        raise refused
    return user, found[1].removeprefix("[").removesuffix("]"), port
