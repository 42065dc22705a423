"""Run checks on a snapshot, and sort their findings into root causes and consequences. Pure."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Check, Finding, Gap, Severity, Snapshot
from lupin_cli.checks.drive import FORMER_ESTOP
from lupin_cli.checks.findings import NEED_VENDOR, OVER_GRAPH
from lupin_cli.checks.ground_truth import GroundTruth, State
from lupin_cli.checks.path_losses import BY_CHANCE
from lupin_cli.doctor.areas import Area, judge_areas
from lupin_cli.facts.base import Unknown
from lupin_cli.printed_commands import complete

_LOST = "packets-lost"  # a program that joins meets the others with a burst, of which this visit's got through
_PROFILE_CHANGED = "profile-changed"
_DATA = OVER_GRAPH | NEED_VENDOR  # findings that show, or cause, that data does not arrive
STOPPED = "process-stopped"  # its process does nothing now, whatever arrived before
_UNREACHABLE = "robot-unreachable"  # it has an exit status of its own, whatever explains it


@dataclass(frozen=True)
class RootCause:
    """A finding that no other explains, with the findings that disappear together with it."""

    finding: Finding
    consequences: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class Diagnosis:
    """What this machine receives, what the checks found, which facts are unknown, and which checks or plug-ins failed."""

    checks: tuple[str, ...]
    roots: tuple[RootCause, ...]
    unknown: tuple[Gap, ...] = ()  # facts without a value
    check_errors: tuple[Gap, ...] = ()  # checks and plug-ins that failed
    by_check: Mapping[str, tuple[Finding, ...]] = field(default_factory=dict)
    duration_s: float = 0.0
    ground_truth: GroundTruth | None = None  # None if it was not asked for: its check was not selected
    areas: tuple[Area, ...] = ()  # empty without ground truth

    @property
    def healthy(self) -> bool:
        """Whether nothing was found, and all that health means was observed."""
        observed = self.ground_truth is not None and self.ground_truth.state is State.HEALTHY
        return observed and not (self.roots or self.gaps)

    @property
    def gaps(self) -> tuple[str, ...]:
        """One line for everything that was not observed: facts without a value, failed checks, parts of the ground truth."""
        lines = map(str, (*self.unknown, *self.check_errors))
        return (*lines, *(self.ground_truth.unobserved if self.ground_truth else ()))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Every finding, root causes and consequences."""
        return tuple(finding for root in self.roots for finding in (root.finding, *root.consequences))


def diagnose(checks: Sequence[Check], snapshot: Snapshot, plugin_errors: Iterable[Gap] = ()) -> Diagnosis:
    """Run the checks. One that raises is listed in `Diagnosis.check_errors` with `plugin_errors`, and the others still run."""
    started = time.monotonic()
    errors = list(plugin_errors)
    by_check: dict[str, tuple[Finding, ...]] = {}
    for check in checks:
        try:
            by_check[check.name] = tuple(check.find(snapshot))
        except Exception as error:  # a plug-in's check may raise anything; the others still count
            errors.append(Gap("check", check.name, f"{type(error).__name__}: {error}"))
    truth = ground_truth.measure(snapshot) if ground_truth.NAME in by_check else None
    found = demote_blocked_fixes(finding for findings in by_check.values() for finding in findings)
    robot = snapshot.link.robot if snapshot.link is not None else ""
    roots = fold_consequences(name_robot(weigh_by_ground_truth(found, truth), robot))
    consequences = [finding for root in roots for finding in root.consequences]
    truth = doubt_luck(truth, [root.finding for root in roots])
    return Diagnosis(
        checks=tuple(check.name for check in checks),
        roots=roots,
        unknown=tuple(unknown_facts(snapshot)),
        check_errors=tuple(errors),
        by_check=by_check,
        duration_s=time.monotonic() - started,
        ground_truth=truth,
        areas=judge_areas(snapshot, truth, [root.finding for root in roots], consequences) if truth is not None else (),
    )


def doubt_luck(truth: GroundTruth | None, roots: Sequence[Finding]) -> GroundTruth | None:
    """Return the ground truth, which is not healthy while it was heard by chance, or the drive bus is locked for a moment.

    Chance: many packets are lost, or a process is stopped.
    """
    losses = (each for each in roots if each.id == _LOST and (each.severity is Severity.PROBLEM or each.about == BY_CHANCE))
    problem = next(iter((*losses, *(each for each in roots if each.id == STOPPED))), None)
    locked = next((each for each in roots if each.about == FORMER_ESTOP), None)
    if truth is None or truth.state is not State.HEALTHY or (problem is None and locked is None):
        return truth
    line = (
        f"what a program hears next: all data arrived this time, although {problem.cause}"
        if problem is not None
        else "whether the base obeys: the drive bus is locked for some seconds more"
    )
    return replace(truth, state=State.UNOBSERVED, unobserved=(line,))


def name_robot(findings: Iterable[Finding], robot: str) -> Iterable[Finding]:
    """Yield the findings with the robot's name in commands for the robot, which otherwise would act on the default robot.

    All commands repeat the inventory of --config.
    """
    for finding in findings:
        command = complete(finding.fix.command, robot="" if finding.where == "laptop" else robot)
        yield replace(finding, fix=replace(finding.fix, command=command))


def weigh_by_ground_truth(findings: Iterable[Finding], truth: GroundTruth | None) -> Iterable[Finding]:
    """Yield the findings, with the severity that fits what this machine receives.

    One that would take all data away is only a warning while all data arrives: it is not in effect, and explains no lack of
    data. A profile that was edited after its processes had read it, for example, breaks the robot at the next start. It remains
    a problem if it causes another one. And a warning is a problem if nothing else explains data that does not arrive.

    That a profile is newer than its processes is left out if something else explains all that is missing: login scripts of the
    vendor write the same profile again.
    """
    found = tuple(findings)
    state = truth.state if truth is not None else State.UNOBSERVED
    lost = [each for each in found if each.id == ground_truth.UNEXPLAINED]
    problems = [each for each in found if each.severity is Severity.PROBLEM]
    unexplained = [loss for loss in lost if not any(problem.accounts_for(loss) for problem in problems)]
    in_effect = [each for each in problems if ground_truth.UNEXPLAINED not in each.explains and each.id != _UNREACHABLE]
    others = [each for each in found if each.id != _PROFILE_CHANGED]
    is_known = bool(lost) and all(any(other.accounts_for(loss) for other in others) for loss in lost)
    for finding in others if is_known else found:
        severity, explains = finding.severity, finding.explains
        if state is State.HEALTHY and ground_truth.UNEXPLAINED in explains:
            explains = frozenset(each for each in explains if each.partition(":")[0] not in _DATA)
            causes_problem = any(replace(finding, explains=explains).accounts_for(problem) for problem in in_effect)
            severity = severity if causes_problem else Severity.WARNING
        elif state is State.BROKEN and any(finding.accounts_for(loss) for loss in unexplained):
            severity = Severity.PROBLEM
        yield replace(finding, severity=severity, explains=explains)


def demote_blocked_fixes(findings: Iterable[Finding]) -> Iterable[Finding]:
    """Yield the findings. A fix is no longer safe if another finding of the same machine blocks its playbook."""
    found = tuple(findings)
    blocked = {(finding.where, playbook) for finding in found for playbook in finding.blocks_playbooks}
    for finding in found:
        if (finding.where, finding.fix.playbook) in blocked:
            yield replace(finding, fix=replace(finding.fix, safe=False))
        else:
            yield finding


def fold_consequences(findings: Iterable[Finding]) -> tuple[RootCause, ...]:
    """Put every finding under the one that explains it, problems first. A cycle is broken at its first finding.

    A warning explains no problem, which would then be announced as a warning, unless it names the problem's subject.
    """
    found: list[Finding] = []
    for finding in findings:
        if finding not in found:
            found.append(finding)
    order = {id(finding): position for position, finding in enumerate(found)}

    def transitive_consequences(cause: Finding) -> list[Finding]:
        seen, pending = {id(cause)}, [cause]
        while pending:
            current = pending.pop()
            new = [f for f in found if _explains(current, f) and id(f) not in seen]
            seen |= {id(f) for f in new}
            pending += new
        return [f for f in found if id(f) in seen and f is not cause]

    consequences = {id(finding): transitive_consequences(finding) for finding in found}

    def is_explained(finding: Finding) -> bool:
        for cause in found:
            if any(f is finding for f in consequences[id(cause)]):
                is_cycle = any(f is cause for f in consequences[id(finding)])
                if not is_cycle or order[id(cause)] < order[id(finding)]:
                    return True
        return False

    root_findings = [finding for finding in found if not is_explained(finding)]
    placed: set[int] = set()  # each consequence is listed under one root cause only
    roots = []
    for root in root_findings:
        explained = tuple(f for f in consequences[id(root)] if id(f) not in placed and not any(f is r for r in root_findings))
        placed |= {id(f) for f in explained}
        roots.append(RootCause(root, explained))
    return tuple(sorted(roots, key=lambda root: root.finding.severity is not Severity.PROBLEM))


def _explains(cause: Finding, other: Finding) -> bool:
    """Return whether `other` is listed under `cause`."""
    if not cause.accounts_for(other):
        return False
    is_hidden = cause.severity is Severity.WARNING and other.severity is Severity.PROBLEM and other.id != _UNREACHABLE
    return not is_hidden or (bool(other.about) and f"{other.id}:{other.about}" in cause.explains)


def unknown_facts(snapshot: Snapshot) -> Iterable[Gap]:
    """Yield the facts that have no value, with the reason."""
    for facts in filter(None, (snapshot.laptop, snapshot.robot)):
        for name, value in facts.values.items():
            if isinstance(value, Unknown):
                yield Gap("fact", name, value.reason, facts.machine)
