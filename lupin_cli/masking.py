"""What in a text is a secret, and the same text without it: the rules that journals of playbooks and support archives share.

A rule is a pattern whose group `d`, `q`, `e` or `b` is the secret: in double quotes, in single ones, in quotes that are escaped
themselves, or bare. Every pattern takes time in proportion to its text, also on one line of a megabyte: repetitions before the
secret are bounded, and no two of them can share a character.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterator

from lupin_cli.quick_dataclass import dataclass

MASK = "***"

Note = Callable[[str, str, bool], None]  # kind, secret, whether the place leaves no doubt that it is one

# The last word of a setting's name: wifi-sec.psk, client_secret, AWS_SECRET_ACCESS_KEY, wep-key0, PrivateKey.
_KEY = (
    r"(?:pass(?:word|wd|phrase|code)|secret|token|psk|credential|"
    r"(?:api|access|private|secret|pre-?shared|pre_shared|encryption|signing|auth|master|account|wep)[_.-]?key)"
    r"(?:s|[_-]?\d{1,2})?(?:[_-](?:hash|value|base64|b64|text|raw))?"
)
_SHORT_KEY = r"(?:(?<![a-z0-9])pass|(?<=[a-z0-9][_-])(?:pass|pwd|pin)(?<!gpio[_-]pin))"
_COLOUR = r"(?:\x1b\[[0-9;]{0,20}m)?"
# `psk=`, `"psk": `, `\"psk\": `, `psk => `, `added 'psk' value `
_IS = rf"\\*[\"'\]]?{_COLOUR}[ \t]{{0,8}}(?:=>|:=|[=:]|(?<=['\"] )value(?=[ \t])){_COLOUR}[ \t]{{0,8}}{_COLOUR}"
_QUOTED = (
    r'"(?P<d>(?:[^"\\\r\n]|\\[^\r\n])*+)"?'
    r"|'(?P<q>(?:[^'\\\r\n]|\\[^\r\n]|'\\'')*+)'?"
    r"|(?P<o>\\+[\"'])(?P<e>(?:(?!(?<!\\)(?P=o))[^\r\n])*+)(?:(?P=o))?"
)
_BARE = r"(?P<b>[^\s\0\"'\x1b][^\s\0]*)"
_VALUE = rf"(?:{_QUOTED}|{_BARE})"
# A setting's own line, perhaps of a diff or behind the journal's `robot NetworkManager[312]: `: its value may have blanks.
_LINE = r"(?:^|(?<=\]: ))[ \t>|+-]{0,40}"
_REST = r"(?P<b>[^\s\"'\\\0][^\r\n\0]*)"

# What stands where a secret could, and says that there is none.
_NOTHING = re.compile(
    r"(?i)(?:\*+|true|false|yes|no|none|null|nil|on|off|not|unset|empty|required|<?hidden>?|\[?removed\]?|\(null\)|\d{1,3})\Z"
)
_CLOSING = ",;)}]>\"'"
_GROUPS = ("d", "q", "e", "b")


@dataclass(frozen=True)
class Rule:
    """A kind of secret. `hints` are words, one of which a text must have for the pattern to be worth trying."""

    kind: str
    hints: tuple[str, ...]
    pattern: re.Pattern[str]
    firm: bool = False  # the place leaves no doubt: a setting's line, a URL, the argument of a command


_KEY_HINTS = ("pass", "secret", "token", "psk", "credential", "key")


@functools.cache
def rules() -> tuple[Rule, ...]:
    """The table, in the order in which it is applied; compiled when it is first asked for."""

    def rule(kind: str, hints: tuple[str, ...] | str, pattern: str, *, firm: bool = False) -> Rule:
        return Rule(kind, (hints,) if isinstance(hints, str) else hints, re.compile(pattern, re.I | re.M), firm)

    return (
        rule("authorization", ("authorization", "cookie", "x-api-key", "x-auth-token"),
             rf"(?:(?:proxy-)?authorization|x-api-key|x-auth-token|(?:set-)?cookie){_IS}[\"']?(?P<b>[^\s\0\"'][^\r\n\0]*)"),
        rule("url-credentials", "://", r"://[^\s/:@]{0,256}:(?P<b>[^\s/\0]{1,512})@", firm=True),
        rule("url-credentials", "://", r"(?:https?|git|ftps?)://(?P<b>[^\s/:@\0]{1,512})@", firm=True),
        # -- arguments of commands, as sudo writes them into the journal
        rule("secret", _KEY_HINTS, rf"(?<![\w-])(?!--?ask)--?[\w-]{{0,40}}?{_KEY}[ \t]+(?!-){_VALUE}", firm=True),
        rule("secret", ("psk", "pass", "wep-key", "pin"),
             rf"[.](?:psk|password|pin|wep-key\d|leap-password|private-key-password)[ \t]+{_VALUE}", firm=True),
        rule("secret", "nmcli", rf"\bnmcli\b[^\r\n]{{0,300}}?[ \t]password[ \t]+{_VALUE}", firm=True),
        rule("secret", "wpa_passphrase",
             rf"\bwpa_passphrase[ \t]+(?:\"[^\"\r\n]*\"|'[^'\r\n]*'|[^\s=\"']+)[ \t]+{_VALUE}", firm=True),
        rule("secret", "sshpass", rf"\bsshpass[ \t]+-p[ \t]*{_VALUE}", firm=True),
        rule("secret", "sudo",
             rf"\b(?:echo|printf)[ \t]+(?:-\w{{1,8}}[ \t]+|'%s\\n'[ \t]+)?{_VALUE}"
             r"[ \t]*\|[ \t]*sudo[ \t]+[^|\r\n]{0,40}?-\w{0,4}S",
             firm=True),
        rule("secret", "chpasswd", r"\b[\w.-]{1,32}:(?P<b>[^\s\"'|]+)[\"']?[ \t]*\|[ \t]*(?:sudo[ \t]+)?chpasswd", firm=True),
        rule("secret", ("curl", "wget"),
             r"\b(?:curl|wget)\b[^\r\n]{0,200}?[ \t](?:-u|--user)[ \t=]+[\"']?[^\s:\"']{0,64}:(?P<b>[^\s\"']+)", firm=True),
        # -- settings
        rule("secret", _KEY_HINTS, rf"{_KEY}[ \t]{{0,8}}:[ \t]{{0,8}}[|>][+-]?[ \t]*\r?\n[ \t]+(?P<b>\S[^\r\n]*)", firm=True),
        rule("secret", _KEY_HINTS, rf"{_LINE}[\w.-]{{0,60}}?{_KEY}[ \t]{{0,8}}[=:][ \t]{{0,8}}(?:{_QUOTED})", firm=True),
        rule("secret", _KEY_HINTS, rf"{_LINE}[\w.-]{{0,60}}?{_KEY}[ \t]{{0,8}}=[ \t]{{0,8}}{_REST}", firm=True),
        rule("secret", _KEY_HINTS, rf"{_LINE}[\w.-]{{0,60}}?{_KEY}[ \t]{{0,8}}:[ \t]{{0,8}}{_REST}"),
        rule("secret", _KEY_HINTS, rf"{_KEY}{_IS}{_VALUE}"),
        rule("secret", ("pass", "pwd", "pin"), rf"{_SHORT_KEY}[\"']?[ \t]{{0,8}}[=:][ \t]{{0,8}}(?!/){_VALUE}"),
        rule("secret", "pin", r"(?<![\w-])pin[\"']?[ \t]{0,8}[=:][ \t]{0,8}(?P<b>\d{4,8})\b", firm=True),
        rule("secret", "login", rf"\blogin[ \t]+[^\s\"']{{1,64}}[ \t]+password[ \t]+{_VALUE}", firm=True),
        rule("secret", _KEY_HINTS, rf"<[\w:.-]{{0,40}}?{_KEY}>(?P<b>[^<\r\n]+)", firm=True),
        # -- shapes that tell by themselves
        rule("authorization", "bearer", r"\bbearer[ \t]+(?P<b>(?=[^\s\"']{0,64}\d)[\w.~+/=-]{8,})"),
        rule("token", ("gh", "glpat", "xox", "akia", "eyj", "sk-", "hf_", "aiza", "age-secret"),
             r"(?<![\w-])(?P<b>gh[opsur]_\w{20,}|github_pat_\w{20,}|glpat-[\w-]{16,}|xox[abprs]-[\w-]{10,}|AKIA[0-9A-Z]{16}"
             r"|eyJ[\w-]{8,}\.[\w-]{8,}\.[\w-]{0,2000}|sk-[\w-]{20,}|hf_\w{20,}|AIza[\w-]{30,}"
             r"|AGE-SECRET-KEY-1\w{20,})", firm=True),
        rule("password-hash", "$", r"(?P<b>\$(?:1|2[aby]|5|6|7|y|gy|apr1)\$[./\w$=,+]{8,})", firm=True),
    )  # fmt: skip


def ignore(kind: str, secret: str, firm: bool) -> None:
    """Take no note."""


def mask_secrets(text: str, note: Note = ignore) -> str:
    """`text` with MASK for every secret that a rule tells; `note` hears of each. Doing it twice changes nothing more."""
    if len(text) < 4:
        return text
    return "".join(_mask_lines(lines, note) for lines in _chunks(mask_private_keys(text, note)))


def _mask_lines(text: str, note: Note) -> str:
    lowered = text.lower()
    for rule in rules():
        if any(hint in lowered for hint in rule.hints):
            text = rule.pattern.sub(functools.partial(_replace, rule, note), text)
    return text


_CHUNK = 4000


def _chunks(text: str) -> Iterator[str]:
    """The text in pieces of whole lines: most of a log has none of the words, and looking for them is what takes no time.

    A rule looks at one line; only a block of YAML begins on the one before, which is therefore kept with it.
    """
    place = 0
    while len(text) - place > _CHUNK:
        upto = text.find("\n", place + _CHUNK) + 1
        while upto and text[max(place, upto - 8) : upto].rstrip().endswith(("|", ">", "|-", ">-", "|+", ">+")):
            upto = text.find("\n", upto) + 1
        if not upto:
            break
        yield text[place:upto]
        place = upto
    yield text[place:]


def _replace(rule: Rule, note: Note, match: re.Match[str]) -> str:
    found = match.groupdict()
    name = next(group for group in _GROUPS if found.get(group) is not None)
    secret: str = found[name]
    if name == "b" and rule.kind != "url-credentials":
        secret = secret.rstrip().rstrip(_CLOSING)
    if not secret or _NOTHING.match(secret):
        return match[0]
    note(rule.kind, secret, rule.firm)
    start = match.start(name) - match.start()
    return match[0][:start] + MASK + match[0][start + len(secret) :]


_MARKER = re.compile(r"-----(BEGIN|END) ((?:[A-Z0-9]{1,12} ){0,4}PRIVATE KEY(?: BLOCK)?)-----")
_A_KEY = f"{MASK} (a private key)"
_REACH = 16_000  # characters: an RSA key of 8192 bits has 6400, and the journal puts its prefix before each line
# Lines of nothing but base64, of the lengths that keys are wrapped at; a hash is one of hex digits.
_BLOCK = re.compile(
    r"(?m)(?:^[^\r\n]{0,120}?(?<![A-Za-z0-9+/=])(?![0-9a-f]{60,76}\r?$)[A-Za-z0-9+/]{60,76}={0,2}[ \t]*\r?(?:\n|\Z)){2,}+"
    r"(?:^[^\r\n]{0,120}?(?<![A-Za-z0-9+/=])[A-Za-z0-9+/]{4,76}={1,2}[ \t]*\r?$)?"
)


def mask_private_keys(text: str, note: Note = ignore) -> str:
    """`text` without the bodies of private keys, also where one end of a key was cut off."""
    if "PRIVATE KEY" in text:
        text = _between_markers(text, note)
    return _BLOCK.sub(functools.partial(_block, note), text) if len(text) > 120 else text


def _between_markers(text: str, note: Note) -> str:
    done, place = [], 0
    markers = list(_MARKER.finditer(text))
    for index, marker in enumerate(markers):
        if marker.start() < place:
            continue  # the end of a key that is dealt with
        following = markers[index + 1] if index + 1 < len(markers) else None
        if marker[1] == "END":  # alone: what stands before it is the rest of a key
            start, upto = max(place, marker.start() - _REACH), marker.end()
        else:
            start, upto = marker.start(), min(marker.end() + _REACH, following.start() if following else len(text))
            if following is not None and following[1] == "END" and upto == following.start():
                upto = following.end()
        note("private-key", text[start:upto], False)
        done += [text[place:start], _A_KEY]
        place = upto
    return "".join([*done, text[place:]])


def _block(note: Note, match: re.Match[str]) -> str:
    note("private-key", match[0].strip(), False)
    return MASK + ("\n" if match[0].endswith("\n") else "")
