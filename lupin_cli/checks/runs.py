"""Playbooks that were interrupted half way: a machine is then in a state that nobody chose."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.findings import make_finding
from lupin_cli.facts.unfinished_runs import UNFINISHED_RUNS

REMEMBERED_S = 24 * 3600.0  # an older one has been dealt with in another way, or has not mattered


def format_age(age_s: float) -> str:
    """Return how long ago something was, as people say it."""
    for limit_s, unit_s, unit in ((90, 1, "s"), (5400, 60, "min"), (129600, 3600, "h")):
        if age_s < limit_s:
            return f"{age_s / unit_s:.0f} {unit} ago"
    return f"{age_s / 86400:.0f} days ago"


def find_interrupted_runs(snapshot: Snapshot) -> Iterator[Finding]:
    """The newest run of a playbook on this robot or laptop ended half way, and nothing has finished it since."""
    robot = snapshot.link.robot if snapshot.link is not None else ""
    for run in snapshot.laptop.get(UNFINISHED_RUNS) or ():
        if run.robot not in ("", robot) or run.age_s > REMEMBERED_S:
            continue
        option = f" --robot {shlex.quote(run.robot)}" if run.robot else ""
        yield make_finding(
            "run-interrupted",
            where="robot" if run.robot else "laptop",
            cause=f"{run.playbook} was started {format_age(run.age_s)} and did not come to its end: {run.state}"
            + (f" after {run.changes} change{'' if run.changes == 1 else 's'}" if run.changes else ""),
            evidence=(f"lupin journal show {run.run}: {run.state}",),
            command=f"lupin play {shlex.quote(run.playbook)}{option} --resume",
            about=run.playbook,
        )


CHECKS = (Check("runs.interrupted", find_interrupted_runs, laptop=(UNFINISHED_RUNS,)),)
