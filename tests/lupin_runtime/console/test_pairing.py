"""Each one-time code pairs one browser, and guessing codes has no effect."""

from __future__ import annotations

import pytest

from lupin_runtime.console.authority import Refused, Role
from lupin_runtime.console.pairing import CODE_LIFETIME_S, PairingCodes

S = 1_000_000_000


@pytest.fixture
def changes() -> list[int]:
    return []


@pytest.fixture
def codes(changes: list[int]) -> PairingCodes:
    return PairingCodes(lambda: changes.append(1), 0)


def test_code_is_valid_once(codes: PairingCodes, changes: list[int]) -> None:
    code = codes.code(Role.OPERATOR)
    assert codes.redeem(code, S) is Role.OPERATOR
    assert changes == [1]
    with pytest.raises(Refused, match="wrong, used or expired"):
        codes.redeem(code, S)
    assert codes.redeem(codes.code(Role.OPERATOR), S) is Role.OPERATOR


def test_code_selects_role_and_ignores_case_and_separators(codes: PairingCodes) -> None:
    code = codes.code(Role.VIEWER)
    assert codes.redeem(f" {code[:4].lower()}-{code[4:]} ", S) is Role.VIEWER


def test_old_code_is_refused(codes: PairingCodes, changes: list[int]) -> None:
    code = codes.code(Role.OPERATOR)
    with pytest.raises(Refused):
        codes.redeem(code, int((CODE_LIFETIME_S + 1) * S))
    assert changes == [1] and codes.code(Role.OPERATOR) != code


def test_wrong_codes_pair_nobody_and_lock_nobody_out(codes: PairingCodes, changes: list[int]) -> None:
    code = codes.code(Role.OPERATOR)
    for attempt in ("", "A", "ÄÖÜ", "0" * 8, code + code, "\0", "🦊", "2" * 100, "'; --", code[:-1]) * 10:
        with pytest.raises(Refused):
            codes.redeem(attempt, S)
    assert changes == []
    assert codes.redeem(code, S) is Role.OPERATOR
