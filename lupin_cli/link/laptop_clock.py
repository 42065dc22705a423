"""Whether the robot's clock may be set from the laptop's, or the laptop's is the wrong one.

A robot without a hardware clock boots with the time of its last shutdown. It is behind then, which needs no further proof: a
laptop in a hall without internet follows no time source, and is right to a second. A robot that is ahead was set by something,
and only a laptop that is synchronized now proves that this was wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

from lupin_cli.facts.addresses import Addresses
from lupin_cli.facts.chrony import Chrony
from lupin_cli.facts.clock import Offset
from lupin_cli.facts.kernel_clock import KernelClock
from lupin_cli.link.clock_offset import TOLERATED_S
from lupin_cli.plausible_time import SET_CLOCK

DRIFT_LIMIT_S = 1.0  # navigation and mapping refuse transforms and scans of this age
SLEWING_S = 0.5  # an offset that chrony knows of and corrects
LOCAL_STRATUM = 10  # of a server that serves its own clock, right or wrong


@dataclass(frozen=True)
class ClockEvidence:
    """What is known of both clocks; None is unknown."""

    offset: Offset  # the robot's clock minus the laptop's
    laptop: Chrony | None
    kernel: KernelClock | None  # the laptop's
    addresses: Addresses | None  # the laptop's
    robot: Chrony | None


@dataclass(frozen=True)
class Doubt:
    """Why the robot's clock must not be set from the laptop's."""

    reason: str
    is_certain: bool  # the laptop's clock is wrong; otherwise one of both is, and only a person can tell which
    explains_offset: bool  # the robot's clock is right, or nearly
    lines: tuple[str, ...] = ()  # that show it, for a finding

    @property
    def blames_laptop(self) -> bool:
        """Whether the laptop's clock, and not the robot's, is the wrong one."""
        return self.is_certain and self.explains_offset


def doubt_laptop(evidence: ClockEvidence) -> Doubt | None:
    """Return why the robot's clock must not be set from the laptop's; None if nothing speaks against it."""
    offset, laptop, robot = evidence.offset, evidence.laptop, evidence.robot
    behind_s = behind_source_s(laptop)
    if behind_s is not None:
        if abs(behind_s) <= DRIFT_LIMIT_S:
            return None
        explains = abs(offset.offset_s - behind_s) < abs(offset.offset_s) / 2
        reason = f"this machine's clock is {abs(behind_s):.1f} s {'behind' if behind_s > 0 else 'ahead of'} its time source"
        return Doubt(reason, True, explains, tuple(f"laptop: {line}" for line in time_source_lines(laptop)))
    if evidence.kernel is not None and evidence.kernel.is_synchronized:
        return None
    if offset.at_least_s > DRIFT_LIMIT_S and _follows_none(evidence) and _follows_better_source(robot, evidence.addresses):
        lines = ("laptop: its clock follows no time source", *(f"robot: {line}" for line in time_source_lines(robot)))
        return Doubt("the robot's clock follows a time source, and this machine's follows none", True, True, lines)
    if offset.offset_s - offset.bound_s > TOLERATED_S:
        reason = "this machine's clock is not synchronized, and a robot's clock that was never set is behind, not ahead"
        return Doubt(reason, False, False, ("laptop: timedatectl show: NTPSynchronized is not yes",))
    return None


def _follows_none(evidence: ClockEvidence) -> bool:
    """Return whether no program disciplines the laptop's clock, as far as is known."""
    if evidence.kernel is not None and evidence.kernel.is_synchronized is not None:
        return not evidence.kernel.is_synchronized
    return evidence.laptop is not None and not evidence.laptop.others


def _follows_better_source(robot: Chrony | None, laptop: Addresses | None) -> bool:
    """Return whether the robot follows, closely, another machine than the laptop, which has a time source itself."""
    if robot is None or laptop is None or robot.tracking is None or abs(robot.tracking.offset_s) >= SLEWING_S:
        return False
    followed = [source for source in robot.sources if source.state == "*"]
    return any(source.stratum < LOCAL_STRATUM and not laptop.has(source.address) for source in followed)


def behind_source_s(chrony: Chrony | None) -> float | None:
    """Return how far a machine's clock is behind the time source that its chrony follows; None if it follows none."""
    tracking = chrony.tracking if chrony is not None else None
    # Without a reference, chrony follows the clock itself (`local stratum`).
    return tracking.offset_s if tracking is not None and tracking.synchronized and tracking.reference else None


def time_source_lines(chrony: Chrony | None) -> tuple[str, ...]:
    """Return what chrony says about its source, as evidence lines."""
    if chrony is None or not chrony.running:
        return ()
    tracking = (f"chronyc tracking: {chrony.tracking.raw}",) if chrony.tracking is not None else ()
    return (*tracking, *(f"chronyc sources: {source.raw}" for source in chrony.sources))


def remedy_command(laptop: Chrony | None) -> str:
    """Return the command that lets the laptop take the right time from its source."""
    return "sudo chronyc makestep" if laptop is not None and laptop.running else SET_CLOCK
