"""Laws of the consoles' lane, on streams of up to three consoles with phases and jitter of their own."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_runtime.safety import ConsoleLane
from lupin_runtime.safety.consoles import EXPIRY_S, HOLDS, LOST, LOST_HOLDING

MS = 1_000_000


@dataclass
class Console:
    """Says its value twice a second from `phase_ms` on, each time a little late, and at once on a change."""

    phase_ms: int
    jitter_ms: tuple[int, ...]
    value: bool = False
    alive: bool = True
    said: int = 0

    def next_ms(self) -> int:
        return self.phase_ms + 500 * self.said + self.jitter_ms[self.said % len(self.jitter_ms)]


class Room:
    """Consoles and a lane that hears them all on one topic."""

    def __init__(self, consoles: list[Console]) -> None:
        self.lane, self.consoles, self.now_ms = ConsoleLane(), consoles, 10_000
        for console in consoles:
            console.phase_ms += self.now_ms
        self.engaged: list[tuple[int, bool]] = []

    def run(self, duration_ms: int) -> None:
        """Let time pass; after every message and every 100 ms the verdict is noted."""
        end_ms = self.now_ms + duration_ms
        due = [(c.next_ms(), i) for i, c in enumerate(self.consoles)] + [(t, -1) for t in range(self.now_ms, end_ms, 100)]
        heapq.heapify(due)
        while due and due[0][0] <= end_ms:
            self.now_ms, who = heapq.heappop(due)
            if who >= 0:
                console = self.consoles[who]
                console.said += 1
                if console.alive:
                    self.lane.heard(console.value, self.now_ms * MS)
                heapq.heappush(due, (console.next_ms(), who))
            self.note()
        self.now_ms = end_ms
        self.note()

    def say(self, who: int, value: bool) -> None:
        self.consoles[who].value = value
        self.lane.heard(value, self.now_ms * MS)
        self.note()

    def reason(self) -> str | None:
        return self.lane.reason(self.now_ms * MS)

    def note(self) -> None:
        self.engaged.append((self.now_ms, self.reason() is not None))

    def verdicts_since(self, start_ms: int) -> set[bool]:
        return {engaged for time_ms, engaged in self.engaged if time_ms >= start_ms}


CONSOLE = st.builds(Console, st.integers(0, 499), st.lists(st.integers(0, 60), min_size=1, max_size=7).map(tuple))
ROOMS = st.lists(CONSOLE, min_size=1, max_size=3)
CROWDS = st.lists(CONSOLE, min_size=2, max_size=3)


@settings(max_examples=150, deadline=None)
@given(ROOMS, st.integers(0, 3000), st.integers(600, 6000))
def test_one_console_that_holds_engages_from_its_first_word_to_its_last(consoles, before_ms, held_ms):
    room = Room(consoles)
    room.run(3000 + before_ms)
    assert room.reason() is None
    start_ms = room.now_ms
    room.say(0, True)
    room.run(held_ms)
    assert room.verdicts_since(start_ms + 1) <= {True} and room.reason() == HOLDS


@settings(max_examples=150, deadline=None)
@given(ROOMS, st.integers(2500, 5000))
def test_a_release_by_its_holder_takes_effect_within_half_a_second_and_one_for_each_console(consoles, held_ms):
    room = Room(consoles)
    room.run(5000)
    room.say(0, True)
    room.run(held_ms)
    room.say(0, False)
    room.run(500 + 1000 * len(consoles))
    assert room.reason() is None


@settings(max_examples=150, deadline=None)
@given(CROWDS, st.integers(2500, 5000))
def test_a_holder_that_dies_stays_engaged_until_someone_presses_and_releases(consoles, held_ms):
    room = Room(consoles)
    room.run(5000)
    room.say(0, True)
    room.run(held_ms)
    died_ms = room.now_ms
    room.consoles[0].alive = False
    room.run(20_000)
    assert room.verdicts_since(died_ms) == {True} and room.reason() == LOST_HOLDING
    room.say(1, True)
    room.run(5000)
    assert room.reason() == HOLDS
    room.say(1, False)
    room.run(3500)
    assert room.reason() is None


@settings(max_examples=100, deadline=None)
@given(CROWDS, st.integers(0, 499))
def test_a_newcomer_that_holds_is_not_outvoted_by_those_that_were_there(consoles, wait_ms):
    newcomer = consoles[0]
    newcomer.alive = False
    room = Room(consoles)
    room.run(5000 + wait_ms)
    assert room.reason() is None
    newcomer.alive = True
    start_ms = room.now_ms
    room.say(0, True)
    room.run(5000)
    assert room.verdicts_since(start_ms + 1) == {True}


@settings(max_examples=100, deadline=None)
@given(ROOMS, st.integers(0, 2000))
def test_silence_of_all_engages_after_the_expiry_and_ends_with_a_word_of_release(consoles, before_ms):
    room = Room(consoles)
    room.run(3000)
    room.say(0, True)  # how many there were when one pressed must not be asked of the one that returns
    room.run(5000)
    room.say(0, False)
    room.run(5000 + before_ms)
    assert room.reason() is None
    for console in room.consoles:
        console.alive = False
    silent_ms = room.now_ms
    room.run(int(EXPIRY_S * 1000) + 100)
    assert room.reason() is not None and room.reason().startswith(LOST)
    room.run(30_000)
    assert room.verdicts_since(silent_ms + int(EXPIRY_S * 1000) + 100) == {True}
    room.consoles[0].alive = True
    room.run(2500)
    assert room.reason() is None


@settings(max_examples=50, deadline=None)
@given(CROWDS)
def test_of_several_consoles_that_say_released_one_may_leave(consoles):
    room = Room(consoles)
    room.run(3000)
    room.consoles[0].alive = False
    start_ms = room.now_ms
    room.run(10_000)
    assert room.verdicts_since(start_ms) == {False}


def test_where_no_console_was_ever_heard_nothing_is_engaged():
    lane = ConsoleLane()
    assert [lane.reason(t * 10**9) for t in (0, 1, 1000)] == [None] * 3


def test_silence_may_be_told_not_to_engage():
    lane = ConsoleLane(silence_engages=False)
    lane.heard(False, 0)
    assert lane.reason(10**12) is None
    lane.heard(True, 10**12)
    assert lane.reason(2 * 10**12) == LOST_HOLDING, "a stop that was pressed never expires"


def test_an_expiry_within_the_period_is_refused():
    with pytest.raises(ValueError, match="expire"):
        ConsoleLane(period_s=0.5, expiry_s=0.5)
