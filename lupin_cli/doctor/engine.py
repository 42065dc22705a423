"""Run checks on a snapshot, and sort their findings into root causes and consequences. Pure."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from lupin_cli.checks.base import Check, Finding, Severity, Snapshot
from lupin_cli.facts.base import Unknown


@dataclass(frozen=True)
class RootCause:
    """A finding that no other explains, with the findings that disappear together with it."""

    finding: Finding
    consequences: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class Diagnosis:
    """What the checks found, which facts are unknown, and which checks or plug-ins failed."""

    checks: tuple[str, ...]
    roots: tuple[RootCause, ...]
    unknown: tuple[str, ...] = ()  # one line for each fact without a value
    check_errors: tuple[str, ...] = ()  # one line for each check or plug-in that failed
    by_check: Mapping[str, tuple[Finding, ...]] = field(default_factory=dict)
    duration_s: float = 0.0

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Every finding, root causes and consequences."""
        return tuple(finding for root in self.roots for finding in (root.finding, *root.consequences))


def diagnose(checks: Sequence[Check], snapshot: Snapshot, plugin_errors: Iterable[str] = ()) -> Diagnosis:
    """Run the checks. One that raises is listed in `Diagnosis.check_errors` with `plugin_errors`, and the others still run."""
    started = time.monotonic()
    errors = list(plugin_errors)
    by_check: dict[str, tuple[Finding, ...]] = {}
    for check in checks:
        try:
            by_check[check.name] = tuple(check.find(snapshot))
        except Exception as error:  # a plug-in's check may raise anything; the others still count
            errors.append(f"check {check.name}: {type(error).__name__}: {error}")
    return Diagnosis(
        checks=tuple(check.name for check in checks),
        roots=fold_consequences(demote_blocked_fixes(finding for findings in by_check.values() for finding in findings)),
        unknown=tuple(describe_unknown_facts(snapshot)),
        check_errors=tuple(errors),
        by_check=by_check,
        duration_s=time.monotonic() - started,
    )


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
    """Put every finding under the one that explains it, problems first. A cycle is broken at its first finding."""
    found: list[Finding] = []
    for finding in findings:
        if finding not in found:
            found.append(finding)
    order = {id(finding): position for position, finding in enumerate(found)}

    def transitive_consequences(cause: Finding) -> list[Finding]:
        seen, pending = {id(cause)}, [cause]
        while pending:
            current = pending.pop()
            new = [f for f in found if current.accounts_for(f) and id(f) not in seen]
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


def describe_unknown_facts(snapshot: Snapshot) -> Iterable[str]:
    """Yield one line for each fact that has no value: machine, fact, reason."""
    for facts in filter(None, (snapshot.laptop, snapshot.robot)):
        for name, value in facts.values.items():
            if isinstance(value, Unknown):
                yield f"{facts.machine}: {name}: {value.reason}"
