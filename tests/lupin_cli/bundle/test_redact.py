"""Redaction: a secret learned in one file is masked in all; pseudonyms keep relations visible."""

from __future__ import annotations

import importlib
import json
import pkgutil
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import lupin_cli.facts
from lupin_cli.bundle.collect import to_plain_data
from lupin_cli.bundle.redact import Redactor
from lupin_cli.connection import Output
from lupin_cli.facts import Fact
from lupin_cli.secret_masking import MASK
from tests.support.paths import CAPTURED_FACTS
from tests.support.secret_strategies import arbitrary_text, redaction_tokens, simple_passwords

CAPTURED = sorted(CAPTURED_FACTS.glob("*/*.txt"))
MODULES = [importlib.import_module(f"lupin_cli.facts.{each.name}") for each in pkgutil.iter_modules(lupin_cli.facts.__path__)]
FACTS = {value.name: value for module in MODULES for value in vars(module).values() if isinstance(value, Fact)}


def redacted(*texts: str, **options: Any) -> list[str]:
    redactor = Redactor(**options)
    for text in texts:
        redactor.learn(text)
    return [redactor.redact_text(text) for text in texts]


@settings(max_examples=40)
@given(secret=simple_passwords, around=st.sampled_from(["with {} it failed", "'{}'", "x{}y", "http://h/{}/x", "[{}]"]))
def test_secret_of_settings_file_is_masked_in_other_texts(secret: str, around: str) -> None:
    mention = around.format(secret)
    assert secret not in redacted(mention, f"[wifi-security]\npsk={secret}\n")[0]


def test_doubtful_secret_is_masked_only_in_its_place() -> None:
    log, setting = redacted("the expected token", "token: expected")
    assert (log, setting) == ("the expected token", f"token: {MASK}")
    assert redacted("an expected one", 'password: "expected"')[0] == f"an {MASK} one"  # a setting on its own line


def test_path_as_secret_is_masked_only_in_its_place() -> None:
    assert redacted("reading /etc/lupin/secret1", "password=/etc/lupin/secret1")[0] == "reading /etc/lupin/secret1"


def test_given_secret_is_masked_in_text_json_and_urls() -> None:
    redactor = Redactor(["pä s"])
    assert redactor.redact_text('pä s "p\\u00e4 s" p%C3%A4%20s') == f'{MASK} "{MASK}" {MASK}'


@settings(max_examples=100)
@given(st.lists(st.one_of(arbitrary_text, redaction_tokens), max_size=3))
@example(["$1$-----BEGIN PRIVATE KEY-----"])
@example(["x psk=-----BEGIN PRIVATE KEY-----"])
@example(["$1$SSID=A"])
def test_redaction_is_idempotent(texts: list[str]) -> None:
    once = redacted(*texts)
    assert redacted(*once) == once


@settings(max_examples=60)
@given(st.binary(max_size=300))
def test_any_bytes_are_redacted_or_unchanged(data: bytes) -> None:
    redactor = Redactor()
    redactor.learn_file(data)
    found = redactor.redact_file(data)
    assert found == data or redactor.masked
    secret = b"\npsk=hunter22x\n"
    assert b"hunter22x" not in redactor.redact_file(data + secret + data)


@pytest.mark.parametrize("case", CAPTURED, ids=lambda case: f"{case.parent.name}/{case.stem}")
def test_redaction_commutes_with_parsing(case: Path) -> None:
    """Parsing a redacted probe output gives the redacted value."""
    fact, text = FACTS[case.parent.name], case.read_text()
    redactor = Redactor()
    redactor.learn(text)
    value = to_plain_data(fact.parse(Output(0, text)))
    assert to_plain_data(fact.parse(Output(0, redactor.redact_text(text)))) == redactor.redact_data(value)


# -- pseudonyms


def test_equal_addresses_get_equal_pseudonyms_in_any_format() -> None:
    text = (
        "b8:27:eb:12:34:56 B8-27-EB-12-34-56 B8\\:27\\:EB\\:12\\:34\\:56 wlxb827eb123456 01:b8:27:eb:12:34:56 b8:27:eb:12:34:57"
    )
    assert redacted(text) == [
        "02:6d:61:63:00:01 02-6d-61-63-00-01 02\\:6d\\:61\\:63\\:00\\:01 wlx026d61630001 01:02:6d:61:63:00:01 02:6d:61:63:00:02"
    ]


@pytest.mark.parametrize(
    "text",
    [
        "10.42.0.1 192.168.42.1 172.16.3.4 127.0.0.1 169.254.1.1 224.0.0.251 255.255.255.255 0.0.0.0 192.0.2.2",
        "::1 :: fd00::2 ff02::fb fe80::/64 fe80::1",
        "00:00:00:00:00:00 ff:ff:ff:ff:ff:ff 01:00:5e:00:00:fb 33:33:00:00:00:01",
        "44.53.00.5f.45.50.52.4f.53.49.4d.41 std::foo::bar ad::be 12:34:56 2026-11-21T10:00:00 opencv==4.13.0.92",
        "libfastrtps.so.2.6.4 1.2.3 1.2.3.4.5 scan_ssid=1 ssid= SSID: --",
        "  ssid: {type: text}\n  robot: {type: text}\n connection '{{ ssid }}' ssid=$SSID ssid=%s",
    ],
)
def test_text_without_identity_is_unchanged(text: str) -> None:
    assert redacted(text) == [text]


def test_public_addresses_get_distinct_pseudonyms() -> None:
    assert redacted("8.8.8.8:53 9.9.9.9 8.8.8.8 2a02:1234::1 fe80::ba27:ebff:fe12:3456%wlan0") == [
        "198.18.0.1:53 198.18.0.2 198.18.0.1 2001:db8::1 fe80::6d61:1%wlan0"
    ]


@pytest.mark.parametrize(
    "place",
    [
        "ssid={}",
        "\tssid {}",
        'wlan0 ESSID:"{}"',
        "Nov 1 robot wpa_supplicant[1]: wlan0: Trying to associate with SSID '{}'",
        "Activation: (wifi) connection '{}' has security",
        'Connected to wireless network "{}"',
        "{}:802-11-wireless:yes:100:yes",
        "wlan0:wifi:connected:{}",
        "sudo: COMMAND=/usr/bin/nmcli dev wifi connect '{}' password abcd1234",
        "[connection]\nid={}\nuuid=1\ntype=wifi\n",
        '{{"ssid": "{}"}}',
    ],
)
@pytest.mark.parametrize("name", ["Our garden 5", "greenhouse"])
def test_network_name_gets_one_pseudonym_in_any_context(place: str, name: str) -> None:
    named, mentioned = redacted(place.format(name), f"link to '{name}' lost")
    assert name not in named
    assert "ssid-1" in named
    assert mentioned == "link to 'ssid-1' lost"


def test_common_word_as_network_name_is_kept_elsewhere() -> None:
    assert redacted("lupin bundle --robot greenhouse", "ssid=greenhouse")[0] == "lupin bundle --robot greenhouse"


def test_ssh_keys_and_fingerprints_get_pseudonyms() -> None:
    key = "AAAAC3NzaC1lZDI1NTE5AAAAI" + "a" * 40
    print_ = "SHA256:" + "b" * 43
    assert redacted(f"ssh-ed25519 {key} jane@home\nmirte ED25519 {print_} {print_}") == [
        "ssh-ed25519 ssh-key-1\nmirte ED25519 SHA256:fingerprint-1 SHA256:fingerprint-1"
    ]


def test_user_names_are_masked_on_request() -> None:
    text = "/home/jane/x /home/mirte/y /Users/jane USER=jane"
    assert redacted(text) == [text]
    assert redacted(text, users=True) == ["/home/user-1/x /home/mirte/y /Users/user-1 USER=user-1"]


# -- JSON


def test_json_is_redacted_by_value() -> None:
    redactor = Redactor()
    value = {
        "password": "abc", "psk": None, "tokens": ["q1w2e3r4", 5], "token_count": 5, "pin_password": 1234,
        "ssid": "plain",
        "env": {"GITHUB_TOKEN": "ghx", "PATH": "/bin"}, "b8:27:eb:12:34:56": True, "said": "psk=my phrase\nnext",
        "list": ["plain"],
    }  # fmt: skip
    redactor.learn(value)
    found = json.loads(redactor.redact_file(json.dumps(value).encode(), "a.json"))
    assert found == {
        "password": MASK, "psk": None, "tokens": [MASK, 5], "token_count": 5, "pin_password": MASK,
        "ssid": "ssid-1",
        "env": {"GITHUB_TOKEN": MASK, "PATH": "/bin"}, "02:6d:61:63:00:01": True, "said": f"psk={MASK}\nnext",
        "list": ["ssid-1"],
    }  # fmt: skip


def test_jsonl_is_redacted_by_line_and_broken_line_as_text() -> None:
    redactor = Redactor()
    lines = b'{"text": "psk=one two\\nx"}\n{"text": "psk=one tw'
    redactor.learn_file(lines, "a.jsonl")
    whole, broken = redactor.redact_file(lines, "a.jsonl").decode().splitlines()
    assert json.loads(whole) == {"text": f"psk={MASK}\nx"}
    assert "one" not in broken


def test_masked_places_are_counted_by_kind() -> None:
    redactor = Redactor()
    text = "psk=abcd1234\nabcd1234 10.0.0.1 8.8.8.8 b8:27:eb:12:34:56 https://a:b@c/ ssid=X1"
    redactor.learn(text)
    redactor.redact_text(text)
    assert redactor.masked == {"mac": 1, "public-ip": 1, "secret": 2, "ssid": 1, "url-credentials": 1}
