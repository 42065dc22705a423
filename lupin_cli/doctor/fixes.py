"""Plays the fix of a finding, and judges by the next examination whether it healed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.findings import FINDINGS
from lupin_cli.connection.base import Target
from lupin_cli.doctor.engine import Diagnosis

if TYPE_CHECKING:
    from lupin_cli.playbook import Event


@dataclass(frozen=True)
class FixResult:
    """A playbook that was played for a finding, and how it ended."""

    finding: str
    playbook: str
    state: str  # healed, done, failed, declined, unreachable, interrupted, refused
    changed: int = 0
    message: str = ""
    dry_run: bool = False
    changes: tuple[str, ...] = ()  # what each step changed, or would change
    where: str = ""  # of the finding
    about: str = ""  # of the finding

    def to_dict(self) -> dict[str, Any]:
        """Return the result as JSON-able data."""
        return {
            "finding": self.finding,
            "machine": self.where,
            "playbook": self.playbook,
            "state": self.state,
            "changed": self.changed,
            "message": self.message,
            "dry_run": self.dry_run,
        }


def play_fix(finding: Finding, targets: dict[str, Target], *, dry_run: bool = False) -> FixResult:
    """Play the playbook of a finding, without asking."""
    from lupin_cli.playbook import JournalError, PlaybookError, play

    fix, changes = finding.fix, []

    def note_change(event: Event) -> None:
        if event.kind in ("step-end", "difference") and event.text:
            changes.append(f"{event.step}: {event.text}" if event.step else event.text)

    try:
        played = play(fix.playbook, targets, fix.variables, dry_run=dry_run, confirm=_confirm_always, on_event=note_change)
    except (FileNotFoundError, PlaybookError, JournalError) as error:
        state, changed, message = "refused", 0, str(error)
    else:
        state, changed, message = played.state, played.changed, played.message
    return FixResult(finding.id, fix.playbook, state, changed, message, dry_run, tuple(changes), finding.where, finding.about)


def _confirm_always(_question: str) -> bool:
    """Answer a playbook's question with yes: `accept` has already allowed the fix."""
    return True


def judge_fix(fix: FixResult, snapshot: Snapshot, diagnosis: Diagnosis, checks: Sequence[Check]) -> FixResult:
    """Return a fix as the last examination shows it: healed if its finding was looked for again, and is gone."""
    if fix.state != "done" or fix.dry_run:
        return fix
    subject = (fix.finding, fix.where, fix.about)
    if any((each.id, each.where, each.about) == subject for each in diagnosis.findings):
        return replace(fix, message="the finding is still there")
    if not _was_examined(fix, snapshot, diagnosis, checks):
        return replace(fix, message="it could not be examined whether the finding is gone")
    return replace(fix, state="healed", message="")


def _was_examined(fix: FixResult, snapshot: Snapshot, diagnosis: Diagnosis, checks: Sequence[Check]) -> bool:
    """Return whether the check that found a finding ran again, and had all facts that it needs."""
    name = next((row.check for row in FINDINGS if row.id == fix.finding), "")  # empty: a plug-in's
    check = next((check for check in checks if check.name == name), None)
    if check is None:
        return not name and not diagnosis.check_errors
    if name not in diagnosis.by_check:
        return False
    if (snapshot.link is not None and snapshot.robot is None) or any(map(snapshot.laptop.why_unknown, check.laptop)):
        return False
    return snapshot.robot is None or not any(map(snapshot.robot.why_unknown, check.robot))
