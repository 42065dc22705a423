"""Redaction: first everything that goes into an archive is read for secrets, then each of its files is written without them.

Two passes, since what a settings file calls a password may stand in a log without any word beside it. Files that are JSON are
redacted by their values, so that they stay JSON; all else is text, whatever bytes it has.
"""

from __future__ import annotations

import functools
import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from html import unescape
from typing import Any
from urllib.parse import quote, unquote

from lupin_cli.bundle.pseudonyms import Pseudonyms
from lupin_cli.masking import MASK, mask_secrets

_SHORTEST_GIVEN = 3  # of secrets that somebody typed: no doubt what they are
_SHORTEST_LEARNT, _LONGEST_LEARNT = 6, 512
_PLACEHOLDER = re.compile(r"[/~$%{<]|.{0,16}://|\w+\(")  # a path, a variable, a template, a call: names where a secret is
_SECRET_NAME = re.compile(r"(?:pass|pwd)\Z", re.I)


class Redactor:
    """Takes secrets and identities out of texts. `given` are secrets that are known beforehand."""

    def __init__(self, given: Iterable[str] = (), *, users: bool = False) -> None:
        self.counts: Counter[str] = Counter()
        self._secrets = {secret for secret in given if len(secret) >= _SHORTEST_GIVEN and secret != MASK}
        self.users = users
        self._names = Pseudonyms(users)
        self._pattern: re.Pattern[str] | None = None

    @property
    def masked(self) -> dict[str, int]:
        """How many places were masked, by kind."""
        return dict(sorted((self.counts + self._names.counts).items()))

    # -- first pass

    def learn(self, value: Any) -> None:
        """Take note of the secrets and the networks that a text, or JSON-able data, tells."""
        if isinstance(value, str):
            self._names.learn(mask_secrets(value, self._learn_secret))
        elif isinstance(value, Mapping):
            for key, item in value.items():
                if isinstance(item, str):
                    if _names_a_secret(str(key)):
                        self._learn_secret("secret", item, True)
                    elif str(key).lower() == "ssid":
                        self._names.learn_ssid(item)
                self.learn(item)
        elif isinstance(value, (list, tuple)):
            for item in value:
                self.learn(item)

    def _learn_secret(self, kind: str, found: str, firm: bool) -> None:
        for secret in _spellings(kind, found):
            telling = re.search(r"[0-9]", secret) and re.search(r"\D", secret)
            enough = _SHORTEST_LEARNT if telling else 8
            # Of `it met token: expected` nobody can say that it is a secret; of `psk=expected` in a settings file, everybody.
            doubtful = not telling and not (firm and secret == found)
            if doubtful or not enough <= len(secret) <= _LONGEST_LEARNT or _PLACEHOLDER.match(secret) or MASK in secret:
                continue
            if secret not in self._secrets:
                self._secrets.add(secret)
                self._pattern = None

    # -- second pass

    def text(self, text: str) -> str:
        """`text` as it may be shown. Doing it twice changes nothing more."""
        text = mask_secrets(text, self._count)
        if self._secrets:
            self._pattern = self._pattern or _pattern_of(self._secrets)
            text, found = self._pattern.subn(MASK, text)
            self.counts["secret"] += found
        return self._names(text)

    def data(self, value: Any) -> Any:
        """JSON-able data as it may be shown."""
        if isinstance(value, str):
            return self.text(value)
        if isinstance(value, Mapping):
            return {self.text(str(key)): self._item(str(key), item) for key, item in value.items()}
        if isinstance(value, (list, tuple)):
            return [self.data(item) for item in value]
        return value

    def file(self, data: bytes, name: str = "") -> bytes:
        """The content of a file as it may be shown; JSON by its values where `name` says that it is some."""
        text = data.decode("utf-8", "surrogateescape")
        if name.endswith(".jsonl"):
            text = "".join(self._json_line(line) for line in text.splitlines(keepends=True))
        elif name.endswith(".json") and (found := _parsed(text)) is not None:
            text = dumped(self.data(found))
        else:
            text = self.text(text)
        return text.encode("utf-8", "surrogateescape")

    def learn_file(self, data: bytes, name: str = "") -> None:
        """Take note of the secrets that a file tells."""
        text = data.decode("utf-8", "surrogateescape")
        lines = text.splitlines() if name.endswith(".jsonl") else [text] if name.endswith(".json") else []
        for line in lines:
            if (found := _parsed(line)) is not None:
                self.learn(found)
        self.learn(text)

    def _json_line(self, line: str) -> str:
        found = _parsed(line)
        end = line[len(line.rstrip("\r\n")) :]
        return self.text(line) if found is None else json.dumps(self.data(found), ensure_ascii=False) + end

    def _item(self, key: str, item: Any) -> Any:
        if not _names_a_secret(key):
            return self._ssid(key, item) if isinstance(item, str) else self.data(item)
        if isinstance(item, (list, tuple)):
            return [self._item(key, each) for each in item]
        if not isinstance(item, (str, int, float)) or isinstance(item, bool):
            return self.data(item)
        masked = mask_secrets(f"password={json.dumps(item)}") != f"password={json.dumps(item)}"
        self.counts["secret"] += masked
        return MASK if masked else item

    def _ssid(self, key: str, item: str) -> str:
        if key.lower() == "ssid":
            self._names.learn_ssid(item)
        return self.text(item)

    def _count(self, kind: str, secret: str, firm: bool) -> None:
        self.counts[kind] += 1


def dumped(value: Any) -> str:
    """JSON as it stands in an archive."""
    return json.dumps(value, indent=1, ensure_ascii=False) + "\n"


def _parsed(text: str) -> Any:
    """What a JSON text says; None where it says nothing, or isn't any."""
    try:
        return json.loads(text) if text.strip() else None
    except (ValueError, RecursionError):
        return None


def _spellings(kind: str, found: str) -> list[str]:
    """What of a masked place is to be known again elsewhere."""
    if kind == "private-key":  # its lines, wherever one was quoted
        return [word for word in found.split() if len(word) >= 32]
    if kind == "authorization":  # `Bearer abc`, `session=abc; Path=/`, and what stands behind the header in a command
        words = re.split(r"[\s;,]+", re.split(r"[\"']", found)[0])
        return [part for word in words for part in (word, word.partition("=")[2]) if len(part) >= 8]
    # A URL's and an element's are escaped. A setting may go on to the line's end, or something else may follow it.
    return list(dict.fromkeys((found, unquote(found), unescape(found), *found.split()[:1])))


@functools.cache
def _names_a_secret(key: str) -> bool:
    """Whether a value under that name is one, by the same rules as in a text."""
    return bool(_SECRET_NAME.search(key)) or mask_secrets(f'"{key}": "x1y2z3"') != f'"{key}": "x1y2z3"'


def _pattern_of(secrets: Iterable[str]) -> re.Pattern[str]:
    """The secrets, also as in JSON and in URLs. A short one or a number must stand alone: it may be part of anything."""
    spellings: dict[str, str] = {}
    for secret in secrets:
        escaped = json.dumps(secret, ensure_ascii=False)[1:-1]
        for spelling in (secret, escaped, json.dumps(secret)[1:-1], quote(secret, safe="", errors="surrogateescape")):
            alone = len(spelling) < 8 or spelling.isdigit()
            spellings[spelling] = rf"(?<!\w){re.escape(spelling)}(?!\w)" if alone else re.escape(spelling)
    return re.compile("|".join(spellings[key] for key in sorted(spellings, key=len, reverse=True)))
