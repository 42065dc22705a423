"""What one examination leaves in doubt, so that the path is measured or the graph is visited again. Pure."""

from __future__ import annotations

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Finding, Severity, Snapshot
from lupin_cli.checks.findings import FINDINGS
from lupin_cli.checks.ground_truth import State, measure
from lupin_cli.checks.layers import STAMPS
from lupin_cli.doctor.engine import Diagnosis
from lupin_cli.doctor.gathering import TIMED_OUT
from lupin_cli.facts.base import Unknown
from lupin_cli.facts.link import Link

SLOW_ROUND_TRIP_S, LATE_ROUND_TRIP_S, HOPELESS_ROUND_TRIP_S = 0.1, 0.3, 1.0
CLOCK_CHECK = "clock.drift"
MANY_TIMEOUTS = 3  # of a robot's probes
LOSS_MAY_CAUSE = ("timeout", "silent", "lost")  # kinds of failed connections that a link can cause which loses packets


def may_lose_packets(link: Link | None) -> bool:
    """Return whether the robot did not answer, or so late that drive commands come late, or only in part."""
    if link is None or not link.reachable:
        return link is not None and link.kind in LOSS_MAY_CAUSE
    return link.clock is None or 2 * link.clock.bound_s > SLOW_ROUND_TRIP_S  # the clock is the first that a batch answers


def takes_too_long(snapshot: Snapshot) -> bool:
    """Return whether asking the robot's end for each burst would take half a minute, and the delay is the fault or none is."""
    clock = snapshot.link.clock if snapshot.link is not None else None
    round_trip_s = 2 * clock.bound_s if clock is not None else 0.0
    if round_trip_s > HOPELESS_ROUND_TRIP_S:
        return True
    return round_trip_s > LATE_ROUND_TRIP_S and measure(snapshot).state is State.HEALTHY


def is_lost_on_the_way(snapshot: Snapshot, diagnosis: Diagnosis) -> bool:
    """Return whether something is missing here that packets may have taken with them: no stamps that a wrong clock explains."""
    truth = measure(snapshot)
    only_stamps = set(truth.losses) == {STAMPS}
    return truth.state is State.BROKEN and not (only_stamps and diagnosis.by_check.get(CLOCK_CHECK))


def unconfirmed_losses(diagnosis: Diagnosis) -> list[Finding]:
    """Return the losses that nothing explains but a warning: what is no problem by itself proves no loss."""
    rows = {row.id: row for row in FINDINGS}
    causes = [
        root.finding
        for root in diagnosis.roots
        if root.finding.id in rows and rows[root.finding.id].severity is Severity.PROBLEM
        if root.finding.severity is Severity.PROBLEM
    ]
    losses = diagnosis.by_check[ground_truth.NAME]
    return [loss for loss in losses if not any(cause.accounts_for(loss) for cause in causes)]


def answers_are_missing(snapshot: Snapshot) -> bool:
    """Return whether several probes of the robot did not end in time: it is overloaded, or its answers are lost on the way."""
    facts = snapshot.robot.values.values() if snapshot.robot is not None else ()
    return sum(isinstance(value, Unknown) and TIMED_OUT in value.reason for value in facts) >= MANY_TIMEOUTS
