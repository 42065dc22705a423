"""Hypothesis strategies for secrets, and the contexts in which programs print them."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from html import escape
from string import ascii_letters, digits
from urllib.parse import quote

from hypothesis import strategies as st

PUNCTUATION = "!#%^&+-_.=?"

# Passwords without spaces and quotes, which need no quotes in any context. The digit distinguishes them from a word.
simple_passwords = st.builds(
    lambda first, digit, rest: first + digit + rest,
    st.text(ascii_letters, min_size=2, max_size=4),
    st.sampled_from(digits),
    st.text(ascii_letters + digits + PUNCTUATION, min_size=5, max_size=30),
).filter(lambda secret: not secret.endswith(tuple(PUNCTUATION)))

# Passwords with spaces, quotes, backslashes and non-ASCII characters inside, but not at the ends: parsers strip outer spaces.
any_passwords = st.builds(
    lambda first, middle, last: first + middle + last,
    simple_passwords,
    st.text(ascii_letters + PUNCTUATION + " \"'\\äß漢🌱:/@,;{}", max_size=20),
    simple_passwords,
)

# How programs print a password, by context. These contexts can hold only simple passwords.
SIMPLE_PASSWORD_CONTEXTS: dict[str, Callable[[str], str]] = {
    "key=value": lambda s: f"psk={s}",
    "key: value": lambda s: f"robot said password: {s} and went on",
    "dotted setting": lambda s: f"802-11-wireless-security.psk={s} 802-11-wireless.mode=infrastructure",
    "variable": lambda s: f"env GITHUB_TOKEN={s} PATH=/usr/bin",
    "environ": lambda s: f"HOME=/home/mirte\0API_KEY={s}\0SHELL=/bin/sh\0",
    "colored": lambda s: f"\x1b[31mpassword\x1b[0m={s}",
    "authorization": lambda s: f"> Authorization: Bearer {s}",
    "authorization argument": lambda s: f"curl -H 'Authorization: token {s}' http://10.42.0.1/",
    "cookie": lambda s: f"Set-Cookie: session={s}; Path=/",
    "url": lambda s: f"git clone https://me:{quote(s)}@10.42.0.2/repository",
    "url without a user": lambda s: f"fetching https://{quote(s)}@example.org/",
    "nmcli by name": lambda s: f"sudo[12]: mirte : COMMAND=/usr/bin/nmcli dev wifi connect Green password {s} ifname wlan0",
    "nmcli property": lambda s: f"nmcli c modify home wifi-sec.psk {s}",
    "networkmanager": lambda s: f"<info>  [1700000000.1] Config: added 'psk' value '{s}'",
    "option": lambda s: f"COMMAND=/usr/bin/tool --token {s} --verbose",
    "sshpass": lambda s: f"sshpass -p {s} ssh mirte@10.42.0.1",
    "sudo": lambda s: f"echo {s} | sudo -S systemctl restart mirte-ros",
    "chpasswd": lambda s: f"echo mirte:{s} | sudo chpasswd",
    "curl": lambda s: f"curl -s -u mirte:{s} http://10.42.0.1/",
    "wpa_passphrase": lambda s: f'wpa_passphrase "Our garden" {s}',
    "netrc": lambda s: f"machine 10.42.0.1 login mirte password {s}",
    "xml": lambda s: f"<wifi><password>{escape(s)}</password></wifi>",
    "yaml block": lambda s: f"password: |\n  {s}\n",
    "wireguard": lambda s: f"[Interface]\nPrivateKey = {s}\n",
}

# These can hold any password, as quotes or the end of the line terminate it.
ANY_PASSWORD_CONTEXTS: dict[str, Callable[[str], str]] = {
    "json": lambda s: json.dumps({"ssid": "Our garden", "password": s, "on": True}),
    "json within json": lambda s: json.dumps({"line": json.dumps({"client_secret": s, "x": 1})}),
    "json in a log": lambda s: f"[node-3] sending {json.dumps({'token': s}, ensure_ascii=False)} to the cloud",
    "python": lambda s: f"config = {{'password': {s!r}, 'user': 'mirte'}}",
    "keyfile": lambda s: f"[wifi-security]\nkey-mgmt=wpa-psk\npsk={s}\n",
    "keyfile line in the system journal": lambda s: f"2026-11-21T10:00:00+0000 robot NetworkManager[312]: psk={s}",
    "diff": lambda s: f"--- a\n+++ b\n+psk={s}\n-psk=\n",
    "wpa_supplicant": lambda s: f"network={{\n\tssid={json.dumps('Our garden')}\n\tpsk={json.dumps(s)}\n}}",
    "netplan": lambda s: f'      access-points:\n        "Our garden":\n          password: {json.dumps(s)}\n',
    "shell": lambda s: f"export WIFI_PASSWORD='{s}'" if "'" not in s else f"export WIFI_PASSWORD={json.dumps(s)}",
}


def private_key(secret: str, label: str = "OPENSSH PRIVATE KEY", prefix: str = "") -> str:
    """Return a PEM block that contains the secret."""
    body = base64.b64encode(b"openssh-key-v1\0" + bytes(range(256)) + secret.encode()).decode()
    lines = [f"-----BEGIN {label}-----", *(body[at : at + 70] for at in range(0, len(body), 70)), f"-----END {label}-----"]
    return "\n".join(prefix + line for line in lines) + "\n"


# Including lone surrogates, which stand for bytes that are not UTF-8.
arbitrary_text = st.text(st.characters(exclude_categories=()), max_size=200)
# Texts made of tokens that the rules of the redaction match.
redaction_tokens = st.lists(
    st.sampled_from(
        ["psk", "password", "token", "=", ":", " ", '"', "'", "\\", "\n", "***", "://", "@", "-",
         "-----BEGIN PRIVATE KEY-----",
         "-----END PRIVATE KEY-----", "Authorization", "bearer ", "abc1", "\0", "\x1b[1m", "{", "}", "$6$", "echo ",
         "| sudo -S",
         "value ", "ssid", "nmcli ", "A" * 64 + "\n", "<psk>", "|", ">", "yes", "7"]
    ),
    max_size=30,
).map("".join)  # fmt: skip
