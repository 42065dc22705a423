"""Find and mask secrets in text, by rules that playbook journals and support archives share.

A rule is a pattern with the secret in one of these groups: `d` (in double quotes), `q` (in single quotes), `e` (in escaped
quotes) or `b` (bare). Every pattern runs in linear time, even on a line of a megabyte: repetitions before the secret are
bounded, and no two adjacent ones can match the same character.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

MASK = "***"

# Called with the kind, the secret, and whether its context leaves no doubt that it is one.
OnSecret = Callable[[str, str, bool], None]

# The end of a secret setting's name: wifi-sec.psk, client_secret, AWS_SECRET_ACCESS_KEY, wep-key0, PrivateKey.
_KEY = (
    r"(?:pass(?:word|wd|phrase|code)|secret|token|psk|credential|"
    r"(?:api|access|private|secret|pre-?shared|pre_shared|encryption|signing|auth|master|account|wep)[_.-]?key)"
    r"(?:s|[_-]?\d{1,2})?(?:[_-](?:hash|value|base64|b64|text|raw))?"
)
_SHORT_KEY = r"(?:(?<![a-z0-9])pass|(?<=[a-z0-9][_-])(?:pass|pwd|pin)(?<!gpio[_-]pin))"
_COLOR = r"(?:\x1b\[[0-9;]{0,20}m)?"
# `psk=`, `"psk": `, `\"psk\": `, `psk => `, `added 'psk' value `
_IS = rf"\\*[\"'\]]?{_COLOR}[ \t]{{0,8}}(?:=>|:=|[=:]|(?<=['\"] )value(?=[ \t])){_COLOR}[ \t]{{0,8}}{_COLOR}"
_QUOTED = (
    r'"(?P<d>(?:[^"\\\r\n]|\\[^\r\n])*+)"?'
    r"|'(?P<q>(?:[^'\\\r\n]|\\[^\r\n]|'\\'')*+)'?"
    r"|(?P<o>\\+[\"'])(?P<e>(?:(?!(?<!\\)(?P=o))[^\r\n])*+)(?:(?P=o))?"
)
_BARE = r"(?P<b>[^\s\0\"'\x1b][^\s\0]*)"
_VALUE = rf"(?:{_QUOTED}|{_BARE})"
# The start of a line with one setting, perhaps in a diff or after the system journal's `robot NetworkManager[312]: `. The value
# reaches to the end of the line and may contain spaces.
_LINE = r"(?:^|(?<=\]: ))[ \t>|+-]{0,40}"
_REST = r"(?P<b>[^\s\"'\\\0][^\r\n\0]*)"

# Values that are not a secret.
_NO_SECRET = re.compile(
    r"(?i)(?:\*+|true|false|yes|no|none|null|nil|on|off|not|unset|empty|required|<?hidden>?|\[?removed\]?|\(null\)|\d{1,3})\Z"
)
_CLOSING = ",;)}]>\"'"
_GROUPS = ("d", "q", "e", "b")


@dataclass(frozen=True)
class Rule:
    """A kind of secret. The pattern is only tried on texts that contain one of the lowercase `hints`."""

    kind: str
    hints: tuple[str, ...]
    pattern: re.Pattern[str]
    certain: bool = False  # the context leaves no doubt: a setting on its own line, a URL, the argument of a command


_KEY_HINTS = ("pass", "secret", "token", "psk", "credential", "key")


@functools.cache
def rules() -> tuple[Rule, ...]:
    """Return the rules in the order in which they are applied; compiled at the first call."""

    def rule(kind: str, hints: tuple[str, ...] | str, pattern: str, *, certain: bool = False) -> Rule:
        return Rule(kind, (hints,) if isinstance(hints, str) else hints, re.compile(pattern, re.I | re.M), certain)

    return (
        rule("authorization", ("authorization", "cookie", "x-api-key", "x-auth-token"),
             rf"(?:(?:proxy-)?authorization|x-api-key|x-auth-token|(?:set-)?cookie){_IS}[\"']?(?P<b>[^\s\0\"'][^\r\n\0]*)"),
        rule("url-credentials", "://", r"://[^\s/:@]{0,256}:(?P<b>[^\s/\0]{1,512})@", certain=True),
        rule("url-credentials", "://", r"(?:https?|git|ftps?)://(?P<b>[^\s/:@\0]{1,512})@", certain=True),
        # -- arguments of commands, as sudo logs them
        rule("secret", _KEY_HINTS, rf"(?<![\w-])(?!--?ask)--?[\w-]{{0,40}}?{_KEY}[ \t]+(?!-){_VALUE}", certain=True),
        rule("secret", ("psk", "pass", "wep-key", "pin"),
             rf"[.](?:psk|password|pin|wep-key\d|leap-password|private-key-password)[ \t]+{_VALUE}", certain=True),
        rule("secret", "nmcli", rf"\bnmcli\b[^\r\n]{{0,300}}?[ \t]password[ \t]+{_VALUE}", certain=True),
        rule("secret", "wpa_passphrase",
             rf"\bwpa_passphrase[ \t]+(?:\"[^\"\r\n]*\"|'[^'\r\n]*'|[^\s=\"']+)[ \t]+{_VALUE}", certain=True),
        rule("secret", "sshpass", rf"\bsshpass[ \t]+-p[ \t]*{_VALUE}", certain=True),
        rule("secret", "sudo",
             rf"\b(?:echo|printf)[ \t]+(?:-\w{{1,8}}[ \t]+|'%s\\n'[ \t]+)?{_VALUE}"
             r"[ \t]*\|[ \t]*sudo[ \t]+[^|\r\n]{0,40}?-\w{0,4}S",
             certain=True),
        rule("secret", "chpasswd",
             r"\b[\w.-]{1,32}:(?P<b>[^\s\"'|]+)[\"']?[ \t]*\|[ \t]*(?:sudo[ \t]+)?chpasswd", certain=True),
        rule("secret", ("curl", "wget"),
             r"\b(?:curl|wget)\b[^\r\n]{0,200}?[ \t](?:-u|--user)[ \t=]+[\"']?[^\s:\"']{0,64}:(?P<b>[^\s\"']+)", certain=True),
        # -- settings
        rule("secret", _KEY_HINTS,
             rf"{_KEY}[ \t]{{0,8}}:[ \t]{{0,8}}[|>][+-]?[ \t]*\r?\n[ \t]+(?P<b>\S[^\r\n]*)", certain=True),
        rule("secret", _KEY_HINTS, rf"{_LINE}[\w.-]{{0,60}}?{_KEY}[ \t]{{0,8}}[=:][ \t]{{0,8}}(?:{_QUOTED})", certain=True),
        rule("secret", _KEY_HINTS, rf"{_LINE}[\w.-]{{0,60}}?{_KEY}[ \t]{{0,8}}=[ \t]{{0,8}}{_REST}", certain=True),
        rule("secret", _KEY_HINTS, rf"{_LINE}[\w.-]{{0,60}}?{_KEY}[ \t]{{0,8}}:[ \t]{{0,8}}{_REST}"),
        rule("secret", _KEY_HINTS, rf"{_KEY}{_IS}{_VALUE}"),
        rule("secret", ("pass", "pwd", "pin"), rf"{_SHORT_KEY}[\"']?[ \t]{{0,8}}[=:][ \t]{{0,8}}(?!/){_VALUE}"),
        rule("secret", "pin", r"(?<![\w-])pin[\"']?[ \t]{0,8}[=:][ \t]{0,8}(?P<b>\d{4,8})\b", certain=True),
        rule("secret", "login", rf"\blogin[ \t]+[^\s\"']{{1,64}}[ \t]+password[ \t]+{_VALUE}", certain=True),
        rule("secret", _KEY_HINTS, rf"<[\w:.-]{{0,40}}?{_KEY}>(?P<b>[^<\r\n]+)", certain=True),
        # -- values that are recognizable by their format
        rule("authorization", "bearer", r"\bbearer[ \t]+(?P<b>(?=[^\s\"']{0,64}\d)[\w.~+/=-]{8,})"),
        rule("token", ("gh", "glpat", "xox", "akia", "eyj", "sk-", "hf_", "aiza", "age-secret"),
             r"(?<![\w-])(?P<b>gh[opsur]_\w{20,}|github_pat_\w{20,}|glpat-[\w-]{16,}|xox[abprs]-[\w-]{10,}|AKIA[0-9A-Z]{16}"
             r"|eyJ[\w-]{8,}\.[\w-]{8,}\.[\w-]{0,2000}|sk-[\w-]{20,}|hf_\w{20,}|AIza[\w-]{30,}"
             r"|AGE-SECRET-KEY-1\w{20,})", certain=True),
        rule("password-hash", "$", r"(?P<b>\$(?:1|2[aby]|5|6|7|y|gy|apr1)\$[./\w$=,+]{8,})", certain=True),
    )  # fmt: skip


def ignore(kind: str, secret: str, certain: bool) -> None:
    """Do nothing."""


def mask_secrets(text: str, on_secret: OnSecret = ignore) -> str:
    """Replace every secret that a rule finds by MASK, and call `on_secret` for each. Idempotent."""
    if len(text) < 4:
        return text
    return "".join(_mask_lines(lines, on_secret) for lines in _chunks(mask_private_keys(text, on_secret)))


def _mask_lines(text: str, on_secret: OnSecret) -> str:
    lowered = text.lower()
    for rule in rules():
        if any(hint in lowered for hint in rule.hints):
            text = rule.pattern.sub(functools.partial(_replace, rule, on_secret), text)
    return text


_CHUNK = 4000


def _chunks(text: str) -> Iterator[str]:
    """Split a text into chunks of whole lines: most chunks of a log contain no hint of a rule, and are done quickly.

    All rules match within one line, except for YAML block values, so the line that starts a block is kept with the next.
    """
    position = 0
    while len(text) - position > _CHUNK:
        end = text.find("\n", position + _CHUNK) + 1
        while end and text[max(position, end - 8) : end].rstrip().endswith(("|", ">", "|-", ">-", "|+", ">+")):
            end = text.find("\n", end) + 1
        if not end:
            break
        yield text[position:end]
        position = end
    yield text[position:]


def _replace(rule: Rule, on_secret: OnSecret, match: re.Match[str]) -> str:
    found = match.groupdict()
    name = next(group for group in _GROUPS if found.get(group) is not None)
    secret: str = found[name]
    if name == "b" and rule.kind != "url-credentials":
        secret = secret.rstrip().rstrip(_CLOSING)
    if not secret or _NO_SECRET.match(secret):
        return match[0]
    on_secret(rule.kind, secret, rule.certain)
    start = match.start(name) - match.start()
    return match[0][:start] + MASK + match[0][start + len(secret) :]


_MARKER = re.compile(r"-----(BEGIN|END) ((?:[A-Z0-9]{1,12} ){0,4}PRIVATE KEY(?: BLOCK)?)-----")
_MASKED_KEY = f"{MASK} (a private key)"
_MAX_KEY = 16_000  # characters: an RSA key of 8192 bits has 6400, plus the system journal's prefix on each line
# Lines that end in base64 of the length at which keys are wrapped. Lines of hex digits are hashes, not keys.
_BLOCK = re.compile(
    r"(?m)(?:^[^\r\n]{0,120}?(?<![A-Za-z0-9+/=])(?![0-9a-f]{60,76}\r?$)[A-Za-z0-9+/]{60,76}={0,2}[ \t]*\r?(?:\n|\Z)){2,}+"
    r"(?:^[^\r\n]{0,120}?(?<![A-Za-z0-9+/=])[A-Za-z0-9+/]{4,76}={1,2}[ \t]*\r?$)?"
)


def mask_private_keys(text: str, on_secret: OnSecret = ignore) -> str:
    """Mask private keys, even if one end of a key was cut off."""
    if "PRIVATE KEY" in text:
        text = _between_markers(text, on_secret)
    return _BLOCK.sub(functools.partial(_block, on_secret), text) if len(text) > 120 else text


def _between_markers(text: str, on_secret: OnSecret) -> str:
    parts, position = [], 0
    markers = list(_MARKER.finditer(text))
    for index, marker in enumerate(markers):
        if marker.start() < position:
            continue  # the end of a key that is masked already
        following = markers[index + 1] if index + 1 < len(markers) else None
        if marker[1] == "END":  # without a beginning: the text before it is the rest of a key
            start, end = max(position, marker.start() - _MAX_KEY), marker.end()
        else:
            start, end = marker.start(), min(marker.end() + _MAX_KEY, following.start() if following else len(text))
            if following is not None and following[1] == "END" and end == following.start():
                end = following.end()
        on_secret("private-key", text[start:end], False)
        parts += [text[position:start], _MASKED_KEY]
        position = end
    return "".join([*parts, text[position:]])


def _block(on_secret: OnSecret, match: re.Match[str]) -> str:
    on_secret("private-key", match[0].strip(), False)
    return MASK + ("\n" if match[0].endswith("\n") else "")
