"""How long a process that was just started listens for a stop."""

from __future__ import annotations

import pytest

from lupin_runtime.safety.listening import LISTEN_S, SHORT_LISTEN_S, Listening

KNOWN_S = 0.5  # when the button becomes known


def over_after_s(
    own_server: bool = True, hears_button: bool = True, consoles_until_s: float = 0.0, consoles_from_s: float = 60.0
) -> float:
    """Return after how many seconds the listening is over, of a process that looks every 10 ms."""
    listening = Listening(0, own_server=own_server)
    for step in range(1000):
        now_s = step / 100
        if hears_button and now_s >= KNOWN_S + 0.3:
            listening.hear_button()
        consoles = int(now_s < consoles_until_s or now_s >= consoles_from_s)
        if listening.is_over(int(now_s >= KNOWN_S), consoles, int(now_s * 1e9)):
            return now_s
    raise AssertionError("never over")


def test_robot_alone_listens_shortly_once_its_button_is_known() -> None:
    assert over_after_s() == pytest.approx(KNOWN_S + SHORT_LISTEN_S)


def test_console_that_is_known_makes_it_listen_for_long() -> None:
    assert over_after_s(consoles_from_s=1.4) == pytest.approx(LISTEN_S)


def test_console_that_has_left_makes_it_listen_for_long() -> None:
    assert over_after_s(consoles_until_s=0.2) == pytest.approx(LISTEN_S)


def test_without_a_server_of_its_own_it_listens_for_long() -> None:
    assert over_after_s(own_server=False) == pytest.approx(LISTEN_S)


def test_button_that_is_known_and_not_heard_does_not_suffice() -> None:
    assert over_after_s(hears_button=False) == pytest.approx(LISTEN_S)


def test_button_that_leaves_must_be_known_again() -> None:
    listening = Listening(0, own_server=True)
    listening.hear_button()
    assert not listening.is_over(1, 0, 0)
    assert not listening.is_over(0, 0, int(0.9e9))
    assert not listening.is_over(1, 0, int(1.1e9))
    assert not listening.is_over(1, 0, int(2.0e9))
    assert listening.is_over(1, 0, int(2.2e9))
