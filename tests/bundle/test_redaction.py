"""Two passes over what goes into an archive: what is learnt in one place is masked in all, and relations stay."""

from __future__ import annotations

import importlib
import json
import pkgutil
from pathlib import Path

import pytest
from carriers import anything, nasty, words
from hypothesis import example, given, settings
from hypothesis import strategies as st

import lupin_cli.facts
from lupin_cli.bundle.plain import plain
from lupin_cli.bundle.redaction import Redactor
from lupin_cli.facts import Fact
from lupin_cli.masking import MASK
from lupin_cli.target import Output

CAPTURED = sorted((Path(__file__).parents[1] / "facts" / "captured").glob("*/*.txt"))
MODULES = [importlib.import_module(f"lupin_cli.facts.{each.name}") for each in pkgutil.iter_modules(lupin_cli.facts.__path__)]
FACTS = {value.name: value for module in MODULES for value in vars(module).values() if isinstance(value, Fact)}


def redacted(*texts: str, **options: bool) -> list[str]:
    redactor = Redactor(**options)
    for text in texts:
        redactor.learn(text)
    return [redactor.text(text) for text in texts]


@settings(max_examples=40, deadline=None)
@given(secret=words, around=st.sampled_from(["with {} it failed", "'{}'", "x{}y", "http://h/{}/x", "[{}]"]))
def test_what_a_settings_file_calls_a_secret_is_masked_where_it_stands_alone(secret: str, around: str) -> None:
    mention = around.format(secret)
    assert secret not in redacted(mention, f"[wifi-security]\npsk={secret}\n")[0]


def test_a_word_that_only_follows_a_colon_is_not_taken_out_everywhere() -> None:
    log, said = redacted("the expected token", "token: expected")
    assert (log, said) == ("the expected token", f"token: {MASK}")
    assert redacted("an expected one", 'password: "expected"')[0] == f"an {MASK} one"  # this one is a setting


def test_a_path_in_a_secrets_place_is_masked_there_alone() -> None:
    assert redacted("reading /etc/lupin/secret1", "password=/etc/lupin/secret1")[0] == "reading /etc/lupin/secret1"


def test_a_secret_that_was_typed_is_masked_however_short_and_in_json_and_urls_too() -> None:
    redactor = Redactor(["pä s"])
    assert redactor.text('pä s "p\\u00e4 s" p%C3%A4%20s') == f'{MASK} "{MASK}" {MASK}'


@settings(max_examples=100, deadline=None)
@given(st.lists(st.one_of(anything, nasty), max_size=3))
@example(["$1$-----BEGIN PRIVATE KEY-----"])
@example(["x psk=-----BEGIN PRIVATE KEY-----"])
def test_redaction_twice_is_redaction_once_by_whomever(texts: list[str]) -> None:
    once = redacted(*texts)
    assert redacted(*once) == once


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=300))
def test_any_bytes_are_redacted_and_those_without_secrets_stay(data: bytes) -> None:
    redactor = Redactor()
    redactor.learn_file(data)
    found = redactor.file(data)
    assert found == data or redactor.masked
    secret = b"\npsk=hunter22x\n"
    assert b"hunter22x" not in redactor.file(data + secret + data)


@pytest.mark.parametrize("case", CAPTURED, ids=lambda case: f"{case.parent.name}/{case.stem}")
def test_a_redacted_probe_is_read_as_the_probe_was(case: Path) -> None:
    """Redaction and parsing commute: an archive's probes tell a parser what they told it on the spot."""
    fact, text = FACTS[case.parent.name], case.read_text()
    redactor = Redactor()
    redactor.learn(text)
    value = plain(fact.parse(Output(0, text)))
    assert plain(fact.parse(Output(0, redactor.text(text)))) == redactor.data(value)


# -- pseudonyms


def test_the_same_address_has_the_same_other_name_in_every_spelling() -> None:
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
def test_what_tells_of_nobody_stays(text: str) -> None:
    assert redacted(text) == [text]


def test_public_addresses_have_other_names_and_stay_apart() -> None:
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
def test_a_network_has_one_other_name_wherever_it_is_told(place: str, name: str) -> None:
    told, mentioned = redacted(place.format(name), f"link to '{name}' lost")
    assert name not in told
    assert "ssid-1" in told
    assert mentioned == "link to 'ssid-1' lost"


def test_a_network_that_is_called_like_a_thing_leaves_the_thing_alone() -> None:
    assert redacted("lupin bundle --robot greenhouse", "ssid=greenhouse")[0] == "lupin bundle --robot greenhouse"


def test_keys_and_fingerprints_have_other_names_and_keys_lose_their_comment() -> None:
    key = "AAAAC3NzaC1lZDI1NTE5AAAAI" + "a" * 40
    print_ = "SHA256:" + "b" * 43
    assert redacted(f"ssh-ed25519 {key} jane@home\nmirte ED25519 {print_} {print_}") == [
        "ssh-ed25519 ssh-key-1\nmirte ED25519 SHA256:fingerprint-1 SHA256:fingerprint-1"
    ]


def test_names_in_home_paths_are_masked_where_that_is_asked_for() -> None:
    text = "/home/jane/x /home/mirte/y /Users/jane USER=jane"
    assert redacted(text) == [text]
    assert redacted(text, users=True) == ["/home/user-1/x /home/mirte/y /Users/user-1 USER=user-1"]


# -- JSON


def test_json_is_redacted_by_its_values_and_stays_json() -> None:
    redactor = Redactor()
    value = {
        "password": "abc", "psk": None, "tokens": ["q1w2e3r4", 5], "token_count": 5, "pin_password": 1234,
        "ssid": "plain",
        "env": {"GITHUB_TOKEN": "ghx", "PATH": "/bin"}, "b8:27:eb:12:34:56": True, "said": "psk=my phrase\nnext",
        "list": ["plain"],
    }  # fmt: skip
    redactor.learn(value)
    found = json.loads(redactor.file(json.dumps(value).encode(), "a.json"))
    assert found == {
        "password": MASK, "psk": None, "tokens": [MASK, 5], "token_count": 5, "pin_password": MASK,
        "ssid": "ssid-1",
        "env": {"GITHUB_TOKEN": MASK, "PATH": "/bin"}, "02:6d:61:63:00:01": True, "said": f"psk={MASK}\nnext",
        "list": ["ssid-1"],
    }  # fmt: skip


def test_lines_of_json_are_redacted_each_and_a_torn_one_as_text() -> None:
    redactor = Redactor()
    lines = b'{"text": "psk=one two\\nx"}\n{"text": "psk=one tw'
    redactor.learn_file(lines, "a.jsonl")
    whole, torn = redactor.file(lines, "a.jsonl").decode().splitlines()
    assert json.loads(whole) == {"text": f"psk={MASK}\nx"}
    assert "one" not in torn


def test_what_was_masked_is_counted_by_kind() -> None:
    redactor = Redactor()
    text = "psk=abcd1234\nabcd1234 10.0.0.1 8.8.8.8 b8:27:eb:12:34:56 https://a:b@c/ ssid=X1"
    redactor.learn(text)
    redactor.text(text)
    assert redactor.masked == {"mac": 1, "public-ip": 1, "secret": 2, "ssid": 1, "url-credentials": 1}
