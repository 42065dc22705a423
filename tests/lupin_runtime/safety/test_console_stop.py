"""Properties of ConsoleStop for up to three consoles with different phases and jitter."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_runtime.safety import ConsoleStop
from lupin_runtime.safety.console_stop import CONSOLE_HOLDS_STOP, EXPIRY_S, LOST, LOST_HOLDING

MS = 1_000_000


@dataclass
class Console:
    """Publishes its value twice a second from `phase_ms` on with jitter, and at once on a change."""

    phase_ms: int
    jitter_ms: tuple[int, ...]
    value: bool = False
    alive: bool = True
    sent: int = 0

    def next_ms(self) -> int:
        return self.phase_ms + 500 * self.sent + self.jitter_ms[self.sent % len(self.jitter_ms)]


class ConsoleGroup:
    """Consoles, and a ConsoleStop that receives the messages of all of them on one topic."""

    def __init__(self, consoles: list[Console]) -> None:
        self.stop, self.consoles, self.now_ms = ConsoleStop(), consoles, 10_000
        for console in consoles:
            console.phase_ms += self.now_ms
        self.engaged: list[tuple[int, bool]] = []

    def run(self, duration_ms: int) -> None:
        """Let time pass; record the stop state after every message and every 100 ms."""
        end_ms = self.now_ms + duration_ms
        due = [(c.next_ms(), i) for i, c in enumerate(self.consoles)] + [(t, -1) for t in range(self.now_ms, end_ms, 100)]
        heapq.heapify(due)
        while due and due[0][0] <= end_ms:
            self.now_ms, who = heapq.heappop(due)
            if who >= 0:
                console = self.consoles[who]
                console.sent += 1
                if console.alive:
                    self.stop.update(console.value, self.now_ms * MS)
                heapq.heappush(due, (console.next_ms(), who))
            self.note()
        self.now_ms = end_ms
        self.note()

    def publish(self, who: int, value: bool) -> None:
        self.consoles[who].value = value
        self.stop.update(value, self.now_ms * MS)
        self.note()

    def reason(self) -> str | None:
        return self.stop.reason(self.now_ms * MS)

    def note(self) -> None:
        self.engaged.append((self.now_ms, self.reason() is not None))

    def states_since(self, start_ms: int) -> set[bool]:
        return {engaged for time_ms, engaged in self.engaged if time_ms >= start_ms}


CONSOLE = st.builds(Console, st.integers(0, 499), st.lists(st.integers(0, 60), min_size=1, max_size=7).map(tuple))
GROUPS = st.lists(CONSOLE, min_size=1, max_size=3)
GROUPS_OF_SEVERAL = st.lists(CONSOLE, min_size=2, max_size=3)


@settings(max_examples=150)
@given(GROUPS, st.integers(0, 3000), st.integers(600, 6000))
def test_one_console_engages_while_it_holds(consoles: list[Any], before_ms: int, held_ms: int) -> None:
    group = ConsoleGroup(consoles)
    group.run(3000 + before_ms)
    assert group.reason() is None
    start_ms = group.now_ms
    group.publish(0, True)
    group.run(held_ms)
    assert group.states_since(start_ms + 1) <= {True} and group.reason() == CONSOLE_HOLDS_STOP


@settings(max_examples=150)
@given(GROUPS, st.integers(2500, 5000))
def test_release_takes_effect_within_a_bound_per_console(consoles: list[Any], held_ms: int) -> None:
    group = ConsoleGroup(consoles)
    group.run(5000)
    group.publish(0, True)
    group.run(held_ms)
    group.publish(0, False)
    group.run(500 + 1000 * len(consoles))
    assert group.reason() is None


@settings(max_examples=150)
@given(GROUPS_OF_SEVERAL, st.integers(2500, 5000))
def test_lost_holder_stays_engaged_until_press_and_release(consoles: list[Any], held_ms: int) -> None:
    group = ConsoleGroup(consoles)
    group.run(5000)
    group.publish(0, True)
    group.run(held_ms)
    died_ms = group.now_ms
    group.consoles[0].alive = False
    group.run(20_000)
    assert group.states_since(died_ms) == {True} and group.reason() == LOST_HOLDING
    group.publish(1, True)
    group.run(5000)
    assert group.reason() == CONSOLE_HOLDS_STOP
    group.publish(1, False)
    group.run(3500)
    assert group.reason() is None


@settings(max_examples=100)
@given(GROUPS_OF_SEVERAL, st.integers(0, 499))
def test_new_console_that_holds_is_not_outvoted(consoles: list[Any], wait_ms: int) -> None:
    newcomer = consoles[0]
    newcomer.alive = False
    group = ConsoleGroup(consoles)
    group.run(5000 + wait_ms)
    assert group.reason() is None
    newcomer.alive = True
    start_ms = group.now_ms
    group.publish(0, True)
    group.run(5000)
    assert group.states_since(start_ms + 1) == {True}


@settings(max_examples=100)
@given(GROUPS, st.integers(0, 2000))
def test_silence_of_all_consoles_engages_until_a_release(consoles: list[Any], before_ms: int) -> None:
    group = ConsoleGroup(consoles)
    group.run(3000)
    group.publish(0, True)  # the number of consoles at the press must not be required after the loss
    group.run(5000)
    group.publish(0, False)
    group.run(5000 + before_ms)
    assert group.reason() is None
    for console in group.consoles:
        console.alive = False
    silent_ms = group.now_ms
    group.run(int(EXPIRY_S * 1000) + 100)
    assert group.reason() == LOST.format(seconds=EXPIRY_S)
    group.run(30_000)
    assert group.states_since(silent_ms + int(EXPIRY_S * 1000) + 100) == {True}
    group.consoles[0].alive = True
    group.run(2500)
    assert group.reason() is None


@settings(max_examples=50)
@given(GROUPS_OF_SEVERAL)
def test_one_of_several_released_consoles_may_leave(consoles: list[Any]) -> None:
    group = ConsoleGroup(consoles)
    group.run(3000)
    group.consoles[0].alive = False
    start_ms = group.now_ms
    group.run(10_000)
    assert group.states_since(start_ms) == {False}


def test_without_any_console_nothing_is_engaged() -> None:
    stop = ConsoleStop()
    assert [stop.reason(t * 10**9) for t in (0, 1, 1000)] == [None] * 3


def test_silence_does_not_engage_if_disabled() -> None:
    stop = ConsoleStop(silence_engages=False)
    stop.update(False, 0)
    assert stop.reason(10**12) is None
    stop.update(True, 10**12)
    assert stop.reason(2 * 10**12) == LOST_HOLDING, "a stop that was pressed never expires"


def test_expiry_within_the_period_is_refused() -> None:
    with pytest.raises(ValueError, match="expire"):
        ConsoleStop(period_s=0.5, expiry_s=0.5)
