"""Masking of secrets in text."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_cli.secret_masking import MASK, mask_secrets
from tests.support.secret_strategies import BARE, QUOTED, anything, nasty, phrases, private_key, words

few = settings(max_examples=15, deadline=None)
many = settings(max_examples=150, deadline=None)


@pytest.mark.parametrize("name", BARE)
@few
@given(secret=words, before=st.sampled_from(["", "10:00 robot x[1]: "]))
def test_bare_secret_is_masked_in_any_context(name: str, secret: str, before: str) -> None:
    masked = mask_secrets(before + BARE[name](secret))
    assert secret not in masked
    assert MASK in masked


@pytest.mark.parametrize("name", QUOTED)
@few
@given(secret=phrases)
def test_quoted_secret_is_masked_up_to_its_end(name: str, secret: str) -> None:
    masked = mask_secrets(QUOTED[name](secret))
    for part in secret.split():
        assert len(part) < 6 or part not in masked, masked


@pytest.mark.parametrize(
    "label", ["RSA PRIVATE KEY", "OPENSSH PRIVATE KEY", "PRIVATE KEY", "EC PRIVATE KEY", "ENCRYPTED PRIVATE KEY"]
)
@pytest.mark.parametrize("prefix", ["", "2026-11-21T10:00:00+0000 robot cat[7]: "])
@pytest.mark.parametrize("part", ["whole", "without its end", "without its begin", "its middle"])
def test_private_key_is_masked_even_if_truncated(label: str, prefix: str, part: str) -> None:
    lines = private_key("x" * 200, label, prefix).splitlines(keepends=True)
    kept = {"whole": lines, "without its end": lines[:-1], "without its begin": lines[1:], "its middle": lines[1:-1]}[part]
    masked = mask_secrets("before\n" + "".join(kept) + "after\n")
    for line in lines[1:-1]:
        assert line.removeprefix(prefix).strip()[:24] not in masked
    if part == "whole":
        assert masked.startswith("before\n") and masked.endswith("after\n")


@many
@given(st.one_of(anything, nasty))
def test_masking_is_idempotent(text: str) -> None:
    once = mask_secrets(text)
    assert mask_secrets(once) == once


@pytest.mark.parametrize(
    "text",
    [
        "Failed password for mirte from 10.42.0.2 port 50124 ssh2",
        "mirte : a password is required ; PWD=/home/mirte ; COMMAND=/usr/bin/true",
        "key-mgmt=wpa-psk\npsk-flags=1\n",
        "psk: <hidden>\ntoken: none\npassword: no\nsecret=0",
        "[tokenizer] 12 tokens: 512 keys: 3",
        "lupin robots check pot --ask-sudo-password and type it",
        "pin: 23\npin=17 gpio_pin: 23\npass: 17 tests passed",
        "http://10.42.0.1:8090/page ssh://mirte@10.42.0.1 mirte@10.42.0.1:/opt",
        "basic authentication and authorization are off",
        f"{'0123456789abcdef' * 4}\n{'fedcba9876543210' * 4}\n",
    ],
)
def test_text_without_secret_is_unchanged(text: str) -> None:
    assert mask_secrets(text) == text


@few
@given(st.text("abcdefgijlmnoqrtuvxyz 0123456789.,-_/()[]\n\t", max_size=300))
def test_text_without_keywords_is_unchanged(text: str) -> None:
    assert mask_secrets(text) == text


@pytest.mark.parametrize(
    "piece",
    ["a", "a:",
     '"', "\\", "psk", "password ", 'psk="', "psk='", 'psk=\\"', "://", "://a:", "-token", "AAAA", " ", "\n", "curl ",
     "nmcli ", "echo ", "$6$", "eyJ",
     "-----BEGIN PRIVATE KEY-----", "-----END PRIVATE KEY-----", "A" * 64 + "\n", "\0", "pass_"],
)  # fmt: skip
def test_long_line_is_masked_in_linear_time(piece: str) -> None:
    # A rule with quadratic run time would take minutes.
    long = piece * (60_000 // len(piece))
    assert "hunter2x" not in mask_secrets(f"{long}\npsk=hunter2x\n{long}")


def test_text_around_secret_is_unchanged() -> None:
    line = "COMMAND=/usr/bin/nmcli dev wifi connect Green password hunter22 ifname wlan0"
    assert mask_secrets(line) == line.replace("hunter22", MASK)
    line = '{"user": "mirte", "password": "hun\\"ter", "on": true}'
    assert mask_secrets(line) == line.replace('hun\\"ter', MASK)


@settings(max_examples=30, deadline=None)
@given(secret=words, before=st.integers(0, 9000), name=st.sampled_from(sorted({**BARE, **QUOTED})))
def test_secret_is_masked_at_any_position_in_long_log(secret: str, before: int, name: str) -> None:
    planted = {**BARE, **QUOTED}[name](secret)
    noise = "".join(f"[{number}] all is well here\n" for number in range(700))
    noise = noise[: noise.find("\n", before) + 1]
    assert mask_secrets(noise + planted + "\n" + noise) == noise + mask_secrets(planted + "\n") + noise
