"""Masking of secrets in text."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_cli.secret_masking import MASK, mask_secrets
from tests.support.secret_strategies import (
    ANY_PASSWORD_CONTEXTS,
    SIMPLE_PASSWORD_CONTEXTS,
    any_passwords,
    arbitrary_text,
    private_key,
    redaction_tokens,
    simple_passwords,
)

CONTEXTS = {**SIMPLE_PASSWORD_CONTEXTS, **ANY_PASSWORD_CONTEXTS}
few_examples = settings(max_examples=15)
many_examples = settings(max_examples=150)


@pytest.mark.parametrize("name", SIMPLE_PASSWORD_CONTEXTS)
@few_examples
@given(secret=simple_passwords, before=st.sampled_from(["", "10:00 robot x[1]: "]))
def test_simple_password_is_masked_in_any_context(name: str, secret: str, before: str) -> None:
    masked = mask_secrets(before + SIMPLE_PASSWORD_CONTEXTS[name](secret))
    assert secret not in masked
    assert MASK in masked


@pytest.mark.parametrize("name", ANY_PASSWORD_CONTEXTS)
@few_examples
@given(secret=any_passwords)
def test_any_password_is_masked_up_to_its_end(name: str, secret: str) -> None:
    masked = mask_secrets(ANY_PASSWORD_CONTEXTS[name](secret))
    for part in secret.split():
        assert len(part) < 6 or part not in masked, masked  # a shorter part may also occur in the context


@pytest.mark.parametrize(
    "label", ["RSA PRIVATE KEY", "OPENSSH PRIVATE KEY", "PRIVATE KEY", "EC PRIVATE KEY", "ENCRYPTED PRIVATE KEY"]
)
@pytest.mark.parametrize("prefix", ["", "2026-11-21T10:00:00+0000 robot cat[7]: "])
@pytest.mark.parametrize("part", ["complete", "no END line", "no BEGIN line", "body only"])
def test_private_key_is_masked_even_if_truncated(label: str, prefix: str, part: str) -> None:
    lines = private_key("x" * 200, label, prefix).splitlines(keepends=True)
    kept = {"complete": lines, "no END line": lines[:-1], "no BEGIN line": lines[1:], "body only": lines[1:-1]}[part]
    masked = mask_secrets("before\n" + "".join(kept) + "after\n")
    for line in lines[1:-1]:
        assert line.removeprefix(prefix).strip()[:24] not in masked
    if part == "complete":
        assert masked.startswith("before\n") and masked.endswith("after\n")


@many_examples
@given(st.one_of(arbitrary_text, redaction_tokens))
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


@few_examples
# Without h, k, p, s, w, : and =, no text can match a rule.
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
    # A rule with quadratic run time would take minutes, which exceeds the test's timeout.
    long = piece * (60_000 // len(piece))
    assert "hunter2x" not in mask_secrets(f"{long}\npsk=hunter2x\n{long}")


def test_text_around_secret_is_unchanged() -> None:
    line = "COMMAND=/usr/bin/nmcli dev wifi connect Green password hunter22 ifname wlan0"
    assert mask_secrets(line) == line.replace("hunter22", MASK)
    line = '{"user": "mirte", "password": "hun\\"ter", "on": true}'
    assert mask_secrets(line) == line.replace('hun\\"ter', MASK)


@settings(max_examples=30)
@given(
    secret=simple_passwords,
    min_length=st.integers(0, 9000),
    name=st.sampled_from(sorted(CONTEXTS)),
)
def test_secret_is_masked_at_any_position_in_long_log(secret: str, min_length: int, name: str) -> None:
    planted = CONTEXTS[name](secret)
    noise = "".join(f"[{number}] all is well here\n" for number in range(700))
    noise = noise[: noise.find("\n", min_length) + 1]
    assert mask_secrets(noise + planted + "\n" + noise) == noise + mask_secrets(planted + "\n") + noise
