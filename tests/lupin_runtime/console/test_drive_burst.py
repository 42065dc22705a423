"""A burst ends by itself, with zeros."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from lupin_runtime.console.drive_burst import PERIOD_S, ZEROS, DriveBurst, Velocity

FORWARD, TURN, ZERO = (0.2, 0.0, 0.0), (0.0, 0.0, 0.5), (0.0, 0.0, 0.0)


class Rig:
    """A burst whose velocities are recorded; `problem` is why it may not go on."""

    def __init__(self) -> None:
        self.sent: list[Velocity] = []
        self.problem = ""
        self.ended = 0
        self.burst = DriveBurst(self.sent.append, lambda: self.problem, self._note_end)

    def _note_end(self) -> None:
        self.ended += 1

    async def rest(self) -> None:
        """Wait until the last zero was sent, and the period after it is over."""
        while self.burst.is_running or self.sent[-ZEROS:] != [ZERO] * ZEROS:
            await asyncio.sleep(PERIOD_S / 5)
        await asyncio.sleep(2 * PERIOD_S)


def run(test: Callable[[Rig], Awaitable[None]]) -> Rig:
    rig = Rig()

    async def main() -> None:
        await test(rig)

    asyncio.run(main())
    return rig


def test_burst_begins_with_one_zero_and_ends_with_three() -> None:
    async def drive(rig: Rig) -> None:
        rig.burst.start(FORWARD, 4 * PERIOD_S)
        await rig.rest()

    rig = run(drive)
    moving = rig.sent[1:-ZEROS]
    assert rig.sent[0] == ZERO and rig.sent[-ZEROS:] == [ZERO] * ZEROS
    assert moving == [FORWARD] * len(moving) and 1 <= len(moving) <= 5
    assert rig.ended == 1


def test_problem_ends_a_burst() -> None:
    async def drive(rig: Rig) -> None:
        rig.burst.start(FORWARD, 60.0)
        rig.problem = "the robot was stopped"
        await rig.rest()

    rig = run(drive)
    assert rig.sent == [ZERO, FORWARD, ZERO, ZERO, ZERO] and rig.ended == 1


def test_next_burst_replaces_the_one_before() -> None:
    async def drive(rig: Rig) -> None:
        rig.burst.start(FORWARD, 60.0)
        rig.burst.start(TURN, PERIOD_S)
        await rig.rest()

    rig = run(drive)
    assert rig.sent[:4] == [ZERO, FORWARD, ZERO, TURN] and FORWARD not in rig.sent[2:] and rig.ended == 1


def test_end_stops_at_once() -> None:
    async def drive(rig: Rig) -> None:
        rig.burst.start(FORWARD, 60.0)
        rig.burst.end()
        assert rig.sent == [ZERO, FORWARD, ZERO] and not rig.burst.is_running
        await rig.rest()

    assert run(drive).sent == [ZERO, FORWARD, ZERO, ZERO, ZERO]


@pytest.mark.parametrize("duration_s", [0.0, 60.0])
def test_closed_burst_sends_nothing_any_more(duration_s: float) -> None:
    async def drive(rig: Rig) -> None:
        rig.burst.start(FORWARD, duration_s)
        rig.burst.close()
        rig.burst.close()
        assert rig.sent[-1] == ZERO
        count = len(rig.sent)
        await asyncio.sleep(2 * PERIOD_S)
        assert len(rig.sent) == count

    run(drive)


def test_burst_that_never_began_sends_nothing_when_closed() -> None:
    async def close(rig: Rig) -> None:
        rig.burst.close()

    assert run(close).sent == []
