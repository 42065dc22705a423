"""The emulated air carries one frame at a time, at its rate, and drops what would wait too long."""

from __future__ import annotations

import pytest

from lupin_sim.host.link_emulator import Medium


def test_frame_takes_its_size_over_the_rate() -> None:
    assert Medium(10.0, 200.0).send(1250, 5.0) == pytest.approx(5.001)


def test_frames_of_both_directions_wait_for_each_other() -> None:
    medium = Medium(10.0, 200.0)
    medium.send(1250, 5.0)
    assert medium.send(1250, 5.0) == pytest.approx(5.002)
    assert medium.send(1250, 6.0) == pytest.approx(6.001)  # it was free again


def test_frame_that_would_wait_longer_than_the_queue_is_dropped() -> None:
    medium = Medium(1.0, 200.0)
    through = [medium.send(12_500, 0.0) for _ in range(5)]  # 100 ms each
    assert through[:3] == [pytest.approx(0.1), pytest.approx(0.2), pytest.approx(0.3)]
    assert through[3:] == [None, None]


def test_without_a_rate_every_frame_passes_at_once() -> None:
    medium = Medium(0.0, 0.0)
    assert [medium.send(70_000, 1.0) for _ in range(3)] == [1.0, 1.0, 1.0]
