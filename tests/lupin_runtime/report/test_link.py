"""What a link did is told from the arrival of odometry and scans."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest

from lupin_runtime.report.link import Link, LinkBuilder

CLOCK_OFFSET_S = 287.5  # the robot's clock is this much ahead
DELAY_S = 0.02


def link_of(
    duration_s: float, passes: Callable[[float], bool], delay_s: Callable[[], float] = lambda: DELAY_S, resent: bool = True
) -> Link:
    """Return what is told of a robot that drives at 0.2 m/s, and stops while there is no link.

    `passes` says of a time whether the link passes; odometry of an outage arrives after it if `resent`.
    """
    builder, x, waiting = LinkBuilder(), 0.0, []
    for tick in range(round(duration_s * 50)):
        t_s = tick / 50
        there = passes(t_s)
        x += 0.2 / 50 if there else 0.0
        waiting.append((t_s + CLOCK_OFFSET_S, x))
        if not there:
            waiting = waiting if resent else []
            continue
        for stamp_s, at_x in waiting:
            builder.pose(t_s + DELAY_S, stamp_s, at_x, 0.0)
        waiting = []
        if tick % 5 == 0:
            builder.scan(t_s + delay_s(), t_s + CLOCK_OFFSET_S)
    return builder.build(duration_s)


def test_link_without_faults_has_no_outage_and_loses_nothing() -> None:
    link = link_of(30.0, lambda _: True)
    assert (link.outages, link.lost_share, link.longest_s) == ((), 0.0, 0.0)
    assert link.late_s == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("resent", [False, True])
def test_outage_has_its_time_and_how_far_the_robot_moved(resent: bool) -> None:
    (outage,) = link_of(30.0, lambda t_s: not 10.0 <= t_s < 13.0, resent=resent).outages
    assert outage.from_s == pytest.approx(10.0, abs=0.05)
    assert outage.to_s == pytest.approx(13.02, abs=0.05)
    assert outage.moved_m == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("resent", [False, True])
def test_robot_that_moved_on_in_an_outage_is_reported(resent: bool) -> None:
    builder = LinkBuilder()
    for tick in range(100):
        if resent or not 20 <= tick < 60:
            builder.pose(6.0 if 20 <= tick < 60 else tick / 10, tick / 10, 0.1 * tick, 0.0)
    (outage,) = builder.build(10.0).outages
    assert outage.moved_m == pytest.approx(4.1)


def test_outage_at_the_end_counts_and_has_no_later_place() -> None:
    (outage,) = link_of(30.0, lambda t_s: t_s < 25.0).outages
    assert outage.to_s == pytest.approx(30.0)
    assert outage.moved_m is None


def test_lost_scans_are_counted_outside_of_outages_only() -> None:
    draws = random.Random(5)
    builder, lost = LinkBuilder(), 0
    for number in range(600):
        t_s = number / 10
        builder.pose(t_s, t_s, 0.0, 0.0)
        if 200 <= number < 250:
            continue
        if 0 < number < 590 and draws.random() < 0.05:
            lost += 1
        else:
            builder.scan(t_s, t_s)
    assert lost > 10
    assert builder.build(60.0).lost_share == pytest.approx(lost / 550, abs=0.005)


def test_late_scans_are_compared_with_the_fastest_of_the_time() -> None:
    delays = iter([DELAY_S + (0.3 if number % 20 == 0 else 0.0) for number in range(1000)])
    assert link_of(60.0, lambda _: True, lambda: next(delays)).late_s == pytest.approx(0.3, abs=0.01)


def test_recording_without_a_robot_tells_nothing() -> None:
    assert LinkBuilder().build(100.0) == Link()


def test_time_between_two_recordings_is_no_outage() -> None:
    builder = LinkBuilder()
    for start_s in (0.0, 8.0):
        builder.interrupt()
        for number in range(100):
            builder.pose(start_s + number / 50, start_s + number / 50, 0.0, 0.0)
    assert builder.build(10.0).outages == ()
