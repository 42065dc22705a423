"""Pseudonyms for what identifies a place or a person: addresses, network names, keys, users.

Equal values get equal pseudonyms within an archive, so that relations stay visible. A pseudonym has the format of the original,
so that parsers can also read a probe's masked output. Pseudonyms are recognized by their format, so masking is idempotent.
Private addresses are kept, since a diagnosis needs them.
"""

from __future__ import annotations

import ipaddress
import re
from collections import Counter
from dataclasses import dataclass, field

MAC_PREFIX = "02:6d:61:63"  # locally administered: no network card has it
PUBLIC_IPV4 = ipaddress.IPv4Network("198.18.0.0/15")  # for benchmarks, RFC 2544: never routed
PUBLIC_IPV6 = ipaddress.IPv6Network("2001:db8::/32")  # for documentation, RFC 3849
LINK_LOCAL = "fe80::6d61:"
_IPV6_GLOBAL = ipaddress.IPv6Network("2000::/3")
STOCK_USERS = frozenset({"mirte", "root"})  # the same on every robot

_PAIRS = re.compile(r"(?<![\w:.-])[0-9A-Fa-f]{2}(?P<s>\\?:|-)(?:[0-9A-Fa-f]{2}(?P=s)){4,62}[0-9A-Fa-f]{2}(?![\w]|[:-]\w)")
_INTERFACE = re.compile(r"\b(?P<kind>wlx|enx)(?P<hex>[0-9a-f]{12})\b")
_IPV4 = re.compile(r"(?<![\w.-])(?<!==)\d{1,3}(?:\.\d{1,3}){3}(?![\w-]|\.\w)")
_IPV6 = re.compile(r"(?<![\w:.])(?=[0-9A-Fa-f]{0,4}:)[0-9A-Fa-f]{0,4}(?::[0-9A-Fa-f]{0,4}){2,7}(?![\w:])")
_PUBLIC_KEY = re.compile(
    r"(?P<type>ssh-(?:rsa|ed25519|dss)|ecdsa-sha2-nistp\d{3}|sk-(?:ssh|ecdsa)[\w@.-]{1,40}) "
    r"(?P<key>AAAA[0-9A-Za-z+/]{16,}={0,3})(?:[ \t]+[^\s\"']{1,200})?"
)
_FINGERPRINT = re.compile(r"(?P<type>SHA256:)(?P<hash>[0-9A-Za-z+/]{43})=?(?![0-9A-Za-z+/])")
_MD5 = re.compile(r"(?P<type>MD5:)(?P<hash>(?:[0-9A-Fa-f]{2}:){15}[0-9A-Fa-f]{2})")
_HOME = re.compile(r"(?P<lead>/home/|/Users/|\b(?:USER|LOGNAME|SUDO_USER)=)(?P<name>[A-Za-z_][\w.-]{0,62})")
# Where network names appear. A pattern has one of these groups: quoted (`q`), to the end of the line (`l`), a word (`w`), or a
# field of terse nmcli output (`t`).
_SSIDS = tuple(
    re.compile(pattern, re.M)
    for pattern in (
        r"(?i)(?<![a-z_])e?ssid[\"']?[ \t]{0,8}[=: ][ \t]{0,8}\\*(?P<mark>[\"'])(?P<q>[^\"'\\\r\n]{1,64})\\*(?P=mark)",
        r"(?i)(?:^|(?<=\]: ))[ \t+-]{0,40}ssid[ \t]{0,8}(?:[=:]|(?<=ssid ))[ \t]{0,8}(?P<l>[^\s\"'\\][^\r\n]{0,63})$",
        r"(?i)(?<![a-z_])e?ssid(?:=|:[ \t]{0,8})(?P<w>[^\s\"'\\,;]{1,64})",
        r"(?i)\(wifi\)[^\r\n]{0,120}?(?:connection|access point|network)[ \t]+(?P<mark>[\"'])(?P<q>[^\"'\r\n]{1,64})(?P=mark)",
        r"(?i)(?:wireless|wifi|wi-fi)[ \t]+network[ \t]+(?P<mark>[\"'])(?P<q>[^\"'\r\n]{1,64})(?P=mark)",
        r"\bnmcli\b[^\r\n]{0,80}?[ \t]wifi[ \t]+(?:connect|hotspot)[ \t]+"
        r"(?:(?P<mark>[\"'])(?P<q>[^\"'\r\n]{1,64})(?P=mark)|(?P<w>[^\s\"'-]\S{0,63}))",
        r"^(?P<t>(?:[^:\\\r\n]|\\.){1,128}):802-11-wireless:",  # nmcli -t connection show
        r"^[\w.-]{1,32}:wifi:[^:\r\n]{0,60}:(?P<t>(?:[^:\\\r\n]|\\.){1,128})$",  # nmcli -t device status
        r"(?m)^id=(?P<l>[^\r\n]{1,64})$(?=[^\[]{0,400}^type=(?:wifi|802-11-wireless)$)",  # the keyfile of a profile
    )
)
# Values that are not a network name: pseudonyms, variables, templates, masks, keywords.
_NOT_AN_SSID = re.compile(
    r"(?i)(?:ssid-\d+|[{$%<\[].*|.*\*\*\*.*|[\W_]*|off|any|off/any|none|null|true|false|yes|no|hidden|auto|\d{1,3})\Z"
)
# A name with one of these characters is masked everywhere; a lowercase word such as `greenhouse` may mean something else.
_DISTINCT = re.compile(r"[^a-z]")


@dataclass
class Pseudonyms:
    """The pseudonyms given so far, by kind; `counts` is how often each kind was inserted."""

    users: bool = False  # whether user names in home paths get pseudonyms
    counts: Counter[str] = field(default_factory=Counter)
    _names: dict[str, dict[str, str]] = field(default_factory=dict)
    _ssid_patterns: tuple[re.Pattern[str], ...] | None = None

    def learn(self, text: str) -> None:
        """Learn the names of wireless networks that are recognizable in `text`, to find them in other places."""
        lowered = text.lower()
        if not ("ssid" in lowered or "wifi" in lowered or "wireless" in lowered or "wi-fi" in lowered):
            return
        for pattern in _SSIDS:
            for match in pattern.finditer(text):
                found = match.groupdict()
                name = found.get("q") or found.get("l") or found.get("w") or re.sub(r"\\(.)", r"\1", found.get("t") or "")
                self.learn_ssid(name.strip())

    def learn_ssid(self, name: str) -> None:
        """Learn the name of one wireless network."""
        if not _NOT_AN_SSID.match(name) and name.lower() not in STOCK_USERS and name not in self._names.get("ssid", {}):
            self._name("ssid", name, "ssid-{}")
            self._ssid_patterns = None

    def __call__(self, text: str) -> str:
        """Replace everything that identifies a place or person in `text`."""
        text = _PUBLIC_KEY.sub(lambda m: f"{m['type']} {self._put('ssh-key', m['key'], 'ssh-key-{}')}", text)
        text = _FINGERPRINT.sub(lambda m: m["type"] + self._put("fingerprint", m["hash"], "fingerprint-{}"), text)
        text = _MD5.sub(lambda m: m["type"] + self._put("fingerprint", m["hash"].lower(), "fingerprint-{}"), text)
        text = self._networks(text)
        text = _PAIRS.sub(self._pairs, text)
        text = _INTERFACE.sub(self._interface, text)
        text = _IPV4.sub(self._ipv4, text)
        text = _IPV6.sub(self._ipv6, text)
        return _HOME.sub(self._home, text) if self.users else text

    def _name(self, kind: str, value: str, template: str) -> str:
        """Return the pseudonym of `value`; a new one is numbered within its kind."""
        names = self._names.setdefault(kind, {})
        return names.setdefault(value, template.format(len(names) + 1))

    def _put(self, kind: str, value: str, template: str) -> str:
        """Return the pseudonym of `value`, and count the insertion."""
        self.counts[kind] += 1
        return self._name(kind, value, template)

    # -- wireless networks

    def _networks(self, text: str) -> str:
        names = self._names.get("ssid")
        if not names:
            return text
        if self._ssid_patterns is None:
            longest_first = sorted(names, key=len, reverse=True)
            distinct = [name for name in longest_first if _DISTINCT.search(name) and len(name) > 2]
            # A plain word is the network's name if it is quoted, a whole field, or a whole line.
            places = (r"(?<=[:='\"])(?:{})(?=[:'\"\\\s]|$)", r"(?<=ssid )(?:{})$", r"\A(?:{})\Z", r"^(?:{})(?=:802)")
            self._ssid_patterns = (_any_of(distinct, r"(?<!\w)(?:{})(?!\w)"), _any_of(longest_first, "|".join(places)))

        def replace(match: re.Match[str]) -> str:
            return self._put("ssid", _unescaped(match[0], names), "ssid-{}")

        for pattern in self._ssid_patterns:
            text = pattern.sub(replace, text)
        return text

    # -- hardware addresses

    def _mac(self, pairs: list[str], separator: str) -> str:
        plain = ":".join(pairs).lower()
        # Null, broadcast and multicast addresses identify nothing; pseudonyms stay.
        if plain == "00:00:00:00:00:00" or int(pairs[0], 16) & 1 or plain.startswith(MAC_PREFIX):
            return separator.join(pairs)
        self.counts["mac"] += 1
        number = int(self._name("mac", plain, "{}"))
        return separator.join([*MAC_PREFIX.split(":"), f"{number >> 8 & 255:02x}", f"{number & 255:02x}"])

    def _pairs(self, match: re.Match[str]) -> str:
        separator = match["s"]
        pairs = match[0].split(separator)
        if len(pairs) == 6:
            return self._mac(pairs, separator)
        if len(pairs) in (7, 14, 18):  # DHCP client identifiers (RFC 2132, RFC 4361) end with the hardware address
            return separator.join([*pairs[:-6], self._mac(pairs[-6:], separator)])
        return match[0]

    def _interface(self, match: re.Match[str]) -> str:
        pairs = re.findall("..", match["hex"])
        return match["kind"] + self._mac(pairs, ":").replace(":", "")

    # -- addresses

    def _ipv4(self, match: re.Match[str]) -> str:
        try:
            address = ipaddress.IPv4Address(match[0])
        except ValueError:
            return match[0]
        if not address.is_global or address.is_multicast:
            return match[0]
        self.counts["public-ip"] += 1
        return str(PUBLIC_IPV4[int(self._name("ipv4", match[0], "{}")) % PUBLIC_IPV4.num_addresses])

    def _ipv6(self, match: re.Match[str]) -> str:
        try:
            address = ipaddress.IPv6Address(match[0])
        except ValueError:
            return match[0]
        if address in _IPV6_GLOBAL and address not in PUBLIC_IPV6:
            self.counts["public-ip"] += 1
            return str(PUBLIC_IPV6[int(self._name("ipv6", str(address), "{}"))])
        # Its host part is derived from the hardware address, or is a stable random number.
        if address.is_link_local and not str(address).startswith(LINK_LOCAL) and int(address) & (2**64 - 1) > 0xFFFF:
            self.counts["mac"] += 1
            return LINK_LOCAL + f"{int(self._name('link-local', str(address), '{}')):x}"
        return match[0]

    def _home(self, match: re.Match[str]) -> str:
        if match["name"] in STOCK_USERS or re.fullmatch(r"user-\d+", match["name"]):
            return match[0]
        return match["lead"] + self._put("user", match["name"], "user-{}")


def _any_of(names: list[str], template: str) -> re.Pattern[str]:
    if not names:
        return re.compile(r"(?!)")
    # nmcli escapes colons and backslashes.
    spellings = {spelling for name in names for spelling in (name, re.sub(r"([:\\])", r"\\\1", name))}
    alternatives = "|".join(re.escape(name) for name in sorted(spellings, key=len, reverse=True))
    return re.compile(template.replace("{}", alternatives), re.M)


def _unescaped(found: str, names: dict[str, str]) -> str:
    return found if found in names else re.sub(r"\\(.)", r"\1", found)
