"""Which of two clocks that differ is the wrong one, as far as the laptop can know."""

from __future__ import annotations

import dataclasses

import pytest

from lupin_cli.facts.chrony import Chrony
from lupin_cli.facts.clock import Offset
from lupin_cli.facts.kernel_clock import KernelClock
from lupin_cli.link.laptop_clock import ClockEvidence, Doubt, doubt_laptop
from tests.support.snapshots import captured

SERVING: Chrony = captured("chrony", "laptop-serving")
STOPPED: Chrony = captured("chrony", "stopped")
FOLLOWS: Chrony = captured("chrony", "chrony-follows-laptop")
SYNCHRONIZED, UNSYNCHRONIZED, UNKNOWN = KernelClock(True), KernelClock(False), None


def behind_its_source(offset_s: float) -> Chrony:
    assert SERVING.tracking is not None
    return dataclasses.replace(SERVING, tracking=dataclasses.replace(SERVING.tracking, offset_s=offset_s))


def doubt(
    ahead_s: float,
    laptop: Chrony | None = STOPPED,
    kernel: KernelClock | None = UNSYNCHRONIZED,
    robot: Chrony | None = STOPPED,
) -> Doubt | None:
    """Return the doubt about a laptop with a robot that is `ahead_s` of it."""
    addresses = captured("addresses", "laptop-with-a-multicast-node")
    return doubt_laptop(ClockEvidence(Offset(ahead_s, 0.01), laptop, kernel, addresses, robot))


def robot_that_follows(address: str, stratum: int) -> Chrony:
    (source,) = FOLLOWS.sources
    return dataclasses.replace(FOLLOWS, sources=(dataclasses.replace(source, address=address, stratum=stratum),))


TIMESYNCD = dataclasses.replace(STOPPED, others=("systemd-timesyncd",))


@pytest.mark.parametrize("laptop", [None, STOPPED, TIMESYNCD, captured("chrony", "serving-without-source")])
@pytest.mark.parametrize("kernel", [SYNCHRONIZED, UNSYNCHRONIZED, UNKNOWN])
@pytest.mark.parametrize("behind_s", [4.0, 300.0, 5e6])
def test_robot_that_was_off_is_set_without_any_time_source(
    laptop: Chrony | None, kernel: KernelClock | None, behind_s: float
) -> None:
    """A hall without internet: the robot boots with the time of its last shutdown, and the laptop follows nothing."""
    assert doubt(-behind_s, laptop, kernel) is None


@pytest.mark.parametrize("laptop", [None, STOPPED, TIMESYNCD, captured("chrony", "serving-without-source")])
@pytest.mark.parametrize("kernel", [UNSYNCHRONIZED, UNKNOWN])
def test_robot_ahead_of_a_laptop_without_source_is_doubtful(laptop: Chrony | None, kernel: KernelClock | None) -> None:
    found = doubt(300.0, laptop, kernel)
    assert found is not None and not found.is_certain and not found.blames_laptop
    assert "not synchronized" in found.reason
    assert doubt(3.005, laptop, kernel) is None, "two crystals explain that"


@pytest.mark.parametrize("laptop", [None, STOPPED, TIMESYNCD])
def test_synchronized_laptop_sets_a_robot_that_is_ahead(laptop: Chrony | None) -> None:
    assert doubt(300.0, laptop, SYNCHRONIZED) is None


def test_own_chrony_is_believed_before_the_kernel() -> None:
    assert doubt(300.0, SERVING) is None
    for kernel in (SYNCHRONIZED, UNSYNCHRONIZED):
        found = doubt(300.0, behind_its_source(300.0), kernel)
        assert found is not None and found.blames_laptop
        assert found.reason == "this machine's clock is 300.0 s behind its time source"
    found = doubt(-300.0, behind_its_source(-4.0))
    assert found is not None and found.is_certain and not found.explains_offset, "the robot is wrong, too"
    assert found.reason == "this machine's clock is 4.0 s ahead of its time source"


@pytest.mark.parametrize("ahead_s", [40.0, -40.0])
def test_robot_that_follows_a_better_source_is_right(ahead_s: float) -> None:
    better = robot_that_follows("10.9.9.9", 3)
    for laptop in (STOPPED, TIMESYNCD):
        found = doubt(ahead_s, laptop, UNSYNCHRONIZED, better)
        assert found is not None and found.blames_laptop, laptop
    assert doubt(-40.0, TIMESYNCD, UNKNOWN, better) is None, "timesyncd may have set it right"
    assert doubt(-40.0, STOPPED, SYNCHRONIZED, better) is None
    assert doubt(-40.0, robot=robot_that_follows("10.9.9.9", 10)) is None, "that one serves its own clock"
    assert doubt(-40.0, robot=FOLLOWS) is None, "the robot follows this laptop"
