"""Driving by the keys of a terminal."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.drive import ZERO, Twist
from lupin_runtime.teleop.keyboard import DIRECTIONS, HOLD_S, MAX_KEYS, PERIOD_S, KeyboardDriver, is_end, split_keys
from lupin_runtime.teleop.velocity import NORMAL, TURBO

MS = 1_000_000
HOLD_NS, PERIOD_NS = int(HOLD_S * 1e9), int(PERIOD_S * 1e9)


@pytest.mark.parametrize(
    ("key", "velocity"),
    [
        ("w", Twist(NORMAL.linear_mps, 0.0, 0.0)),
        ("S", Twist(-TURBO.linear_mps, 0.0, 0.0)),
        ("a", Twist(0.0, NORMAL.linear_mps, 0.0)),
        ("E", Twist(0.0, 0.0, -TURBO.yaw_radps)),
        ("\x1b[D", Twist(0.0, 0.0, NORMAL.yaw_radps)),
    ],
)
def test_key_drives_until_its_last_repetition_is_old(key: str, velocity: Twist) -> None:
    driver = KeyboardDriver()
    driver.press(key, 0)
    sent = [driver.step(at_ns) for at_ns in range(0, HOLD_NS + 1, PERIOD_NS)]
    assert sent == [velocity] * len(sent)
    assert [driver.step(HOLD_NS + index * MS) for index in (1, 2, 500)] == [ZERO, None, None]


def test_other_key_stops_at_once() -> None:
    driver = KeyboardDriver()
    driver.press("w", 0)
    driver.press(" ", MS)
    assert [driver.step(MS), driver.step(2 * MS)] == [ZERO, None]


def test_change_of_direction_is_sent_at_once() -> None:
    driver = KeyboardDriver()
    driver.press("w", 0)
    driver.step(0)
    driver.press("w", MS)
    assert driver.step(MS) is None
    driver.press("s", 2 * MS)
    assert driver.step(2 * MS) == Twist(-NORMAL.linear_mps, 0.0, 0.0)


def test_clock_that_went_back_stops() -> None:
    driver = KeyboardDriver()
    driver.press("w", 1000 * MS)
    assert driver.step(0) == ZERO


def test_pasted_text_is_no_key() -> None:
    assert split_keys("w" * MAX_KEYS) == ["w"] * MAX_KEYS
    assert split_keys("w" * (MAX_KEYS + 1)) == []
    assert split_keys("w\x1b[Ax\x1b[") == ["w", "\x1b[A", "x", "\x1b", "["]
    assert split_keys("\x1b[1;2A\x1bOA\x1b[3~w") == ["\x1b[1;2A", "\x1bOA", "\x1b[3~", "w"]


@pytest.mark.parametrize("typed", [b"x", b"\x1b", b"\x03", b"\x04", b"w" * 500 + b"x", b"\x1b[A\x03", b"\xffx"])
def test_keys_that_end_also_count_in_what_came_late(typed: bytes) -> None:
    assert is_end(typed)


@pytest.mark.parametrize("typed", [b"w", b"\x1b[A", b"\x1bOA", b"\x1b[", b"\x1b[1;2A", b" "])
def test_arrows_and_halves_of_them_end_nothing(typed: bytes) -> None:
    assert not is_end(typed)


@given(st.text(), st.lists(st.integers(0, 2 * HOLD_NS), max_size=20))
def test_only_known_keys_move(text: str, waits_ns: list[int]) -> None:
    driver, now_ns = KeyboardDriver(), 0
    for key in split_keys(text):
        driver.press(key, now_ns)
        moved = driver.step(now_ns) not in (None, ZERO)
        assert not moved or key.lower() in DIRECTIONS or key in DIRECTIONS
    for wait_ns in waits_ns:
        now_ns += wait_ns
        sent = driver.step(now_ns)
        assert sent in (None, ZERO) or now_ns <= HOLD_NS
