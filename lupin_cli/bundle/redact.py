"""Redaction in two passes: learn the secrets from all files of an archive, then mask them in each file.

Two passes are needed because a password from a settings file may appear in a log without any keyword beside it. JSON files are
redacted value by value, so that they stay valid JSON; all others are treated as text, whatever bytes they contain.
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

from lupin_cli.bundle.items import encode
from lupin_cli.bundle.pseudonyms import Pseudonyms
from lupin_cli.secret_masking import MASK, mask_secrets
from lupin_runtime.json_text import parse_json

_MIN_GIVEN = 3  # minimum length of secrets that the operator gave; they need no plausibility test
_MIN_LEARNED, _MIN_LEARNED_UNIFORM, _MAX_LEARNED = 6, 8, 512  # uniform: only digits, or no digit
_PLACEHOLDER = re.compile(r"[/~$%{<]|.{0,16}://|\w+\(")  # a path, URL, variable, template or call: it only refers to a secret
# Ends of JSON keys that `mask_secrets` does not know: in a text, other words end like that, such as `compass`.
_EXTRA_SECRET_KEY = re.compile(r"(?:pass|pwd)\Z", re.I)


class Redactor:
    """Masks secrets and replaces identities with pseudonyms. `given` are secrets that are known beforehand.

    With `users`, user names in home paths get pseudonyms too.
    """

    def __init__(self, given: Iterable[str] = (), *, users: bool = False) -> None:
        self.counts: Counter[str] = Counter()
        self._secrets = {secret for secret in given if len(secret) >= _MIN_GIVEN and secret != MASK}
        self.users = users
        self._pseudonyms = Pseudonyms(users)
        self._pattern: re.Pattern[str] | None = None

    @property
    def masked(self) -> dict[str, int]:
        """The number of masked places, by kind."""
        return dict(sorted((self.counts + self._pseudonyms.counts).items()))

    # -- first pass

    def learn(self, value: Any) -> None:
        """Learn the secrets and network names in a text or in JSON-serializable data."""
        if isinstance(value, str):
            self._pseudonyms.learn(mask_secrets(value, self._learn_secret))
        elif isinstance(value, Mapping):
            for key, member in value.items():
                if isinstance(member, str):
                    if _is_secret_key(str(key)):
                        self._learn_secret("secret", member, True)
                    elif str(key).lower() == "ssid":
                        self._pseudonyms.learn_ssid(member)
                self.learn(member)
        elif isinstance(value, (list, tuple)):
            for element in value:
                self.learn(element)

    def _learn_secret(self, kind: str, match_text: str, certain: bool) -> None:
        for secret in _secrets_in(kind, match_text):
            mixed = re.search(r"[0-9]", secret) and re.search(r"\D", secret)
            min_length = _MIN_LEARNED if mixed else _MIN_LEARNED_UNIFORM
            # `expected` is not a secret in `it met token: expected`, but is one in the line `psk=expected` of a settings file.
            doubtful = not mixed and not (certain and secret == match_text)
            if doubtful or not min_length <= len(secret) <= _MAX_LEARNED or _PLACEHOLDER.match(secret) or MASK in secret:
                continue
            if secret not in self._secrets:
                self._secrets.add(secret)
                self._pattern = None

    # -- second pass

    def redact_text(self, text: str) -> str:
        """Redact a text. Idempotent."""
        redacted = self._redact_once(text)
        # A pseudonym can complete a secret's format: `$1$SSID=A` becomes `$1$SSID=ssid-1`, which looks like a password hash.
        return redacted if redacted == text else self._redact_once(redacted)

    def _redact_once(self, text: str) -> str:
        text = mask_secrets(text, self._count)
        if self._secrets:
            self._pattern = self._pattern or _pattern_of(self._secrets)
            text, count = self._pattern.subn(MASK, text)
            self.counts["secret"] += count
        return self._pseudonyms(text)

    def redact_data(self, value: Any) -> Any:
        """Redact JSON-serializable data."""
        if isinstance(value, str):
            return self.redact_text(value)
        if isinstance(value, Mapping):
            return {self.redact_text(str(key)): self._redact_member(str(key), member) for key, member in value.items()}
        if isinstance(value, (list, tuple)):
            return [self.redact_data(element) for element in value]
        return value

    def redact_file(self, data: bytes, name: str = "") -> bytes:
        """Redact the content of a file; value by value if `name` ends in .json or .jsonl."""
        text = data.decode("utf-8", "surrogateescape")
        if name.endswith(".jsonl"):
            text = "".join(self._redact_json_line(line) for line in text.splitlines(keepends=True))
        elif name.endswith(".json") and (value := _parse_json(text)) is not None:
            text = dump_json(self.redact_data(value))
        else:
            text = self.redact_text(text)
        return encode(text)

    def learn_file(self, data: bytes, name: str = "") -> None:
        """Learn the secrets in a file."""
        text = data.decode("utf-8", "surrogateescape")
        lines = text.splitlines() if name.endswith(".jsonl") else [text] if name.endswith(".json") else []
        for line in lines:
            if (value := _parse_json(line)) is not None:
                self.learn(value)
        self.learn(text)  # also as text: for secrets in keys, and in lines that are not valid JSON

    def _redact_json_line(self, line: str) -> str:
        value = _parse_json(line)
        end = line[len(line.rstrip("\r\n")) :]
        return self.redact_text(line) if value is None else json.dumps(self.redact_data(value), ensure_ascii=False) + end

    def _redact_member(self, key: str, value: Any) -> Any:
        if not _is_secret_key(key):
            return self._redact_string(key, value) if isinstance(value, str) else self.redact_data(value)
        if isinstance(value, (list, tuple)):
            return [self._redact_member(key, each) for each in value]
        if not isinstance(value, (str, int, float)) or isinstance(value, bool):
            return self.redact_data(value)
        if not _is_plausible_secret(value):
            return value
        self.counts["secret"] += 1
        return MASK

    def _redact_string(self, key: str, value: str) -> str:
        if key.lower() == "ssid":
            self._pseudonyms.learn_ssid(value)
        return self.redact_text(value)

    def _count(self, kind: str, _secret: str, _certain: bool) -> None:
        self.counts[kind] += 1


def dump_json(value: Any) -> str:
    """Return JSON as it is written to an archive."""
    return json.dumps(value, indent=1, ensure_ascii=False) + "\n"


def _parse_json(text: str) -> Any:
    """Return the value of a JSON text; None if it is empty or not JSON."""
    try:
        return parse_json(text) if text.strip() else None
    except ValueError:
        return None


def _secrets_in(kind: str, match_text: str) -> list[str]:
    """Return the strings in a masked place that must be masked elsewhere too."""
    if kind == "private-key":  # each of its lines may be quoted elsewhere
        return [word for word in match_text.split() if len(word) >= 32]
    if kind == "authorization":  # `Bearer abc`, `session=abc; Path=/`, and the rest of a command after the header
        words = re.split(r"[\s;,]+", re.split(r"[\"']", match_text)[0])
        return [part for word in words for part in (word, word.partition("=")[2]) if len(part) >= 8]
    # URLs and XML elements are escaped. A setting's value may reach to the end of the line, or only to the next space.
    return list(dict.fromkeys((match_text, unquote(match_text), unescape(match_text), *match_text.split()[:1])))


def _is_plausible_secret(value: str | float) -> bool:
    """Whether the value of a secret's key may be a secret. `mask_secrets` decides: it leaves values such as `none`."""
    setting = f"password={json.dumps(value)}"
    return mask_secrets(setting) != setting


@functools.cache
def _is_secret_key(key: str) -> bool:
    """Whether values with that key are secrets, by the same rules as in a text."""
    # A made-up value that `mask_secrets` masks only beside a secret's key.
    setting = f'"{key}": "x1y2z3"'
    return bool(_EXTRA_SECRET_KEY.search(key)) or mask_secrets(setting) != setting


def _pattern_of(secrets: Iterable[str]) -> re.Pattern[str]:
    """Compile a pattern of all secrets, also as escaped in JSON and URLs. Short ones and numbers match only as a whole word."""
    spellings: dict[str, str] = {}
    for secret in secrets:
        escaped = json.dumps(secret, ensure_ascii=False)[1:-1]
        for spelling in (secret, escaped, json.dumps(secret)[1:-1], quote(secret, safe="", errors="surrogateescape")):
            whole_word = len(spelling) < 8 or spelling.isdigit()
            spellings[spelling] = rf"(?<!\w){re.escape(spelling)}(?!\w)" if whole_word else re.escape(spelling)
    return re.compile("|".join(spellings[key] for key in sorted(spellings, key=len, reverse=True)))
