"""A diagnosis: ask both machines at the same time, run the checks on what they said, fold consequences under their cause."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import field, replace
from typing import Any

from lupin_cli.checks.base import Check, Evidence, Finding, Severity
from lupin_cli.facts.base import Fact, Facts, Unknown
from lupin_cli.facts.clock import Offset
from lupin_cli.facts.link import Link
from lupin_cli.facts.routes import ROBOT_ADDRESSES
from lupin_cli.facts.together import apart, together
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import (
    AuthenticationFailed,
    HostKeyChanged,
    HostKeyUnknown,
    Output,
    RootRefused,
    Script,
    Target,
    TargetError,
    Unreachable,
)

# What a batch may take beyond its slowest probe: sudo, shells to start, a line of 60 ms.
BATCH_SLACK_S = 3.0
_SHARED = "at once"  # the script of those that share a shell; no fact's name has a space


@dataclass(frozen=True)
class Root:
    """A finding that no other explains, with those that will go away with it."""

    finding: Finding
    consequences: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class Diagnosis:
    """What was found, what could not be looked at, and which part of the doctor itself is broken."""

    checks: tuple[str, ...]
    roots: tuple[Root, ...]
    unknown: tuple[str, ...] = ()  # one line for each fact without a value
    broken: tuple[str, ...] = ()  # checks and plug-ins that failed themselves
    by_check: Mapping[str, tuple[Finding, ...]] = field(default_factory=dict)
    duration_s: float = 0.0

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Every finding, causes and consequences."""
        return tuple(finding for root in self.roots for finding in (root.finding, *root.consequences))


class ConflictingFacts(ValueError):
    """Two facts share a name: one of them would be answered with the other's value."""


def facts_of(checks: Iterable[Check], machine: str) -> tuple[Fact[Any], ...]:
    """The facts that the checks need of `machine` ("laptop" or "robot"), each once. Raises ConflictingFacts."""
    needed: dict[str, Fact[Any]] = {}
    for check in checks:
        for fact in check.robot if machine == "robot" else check.laptop:
            known = needed.setdefault(fact.name, fact)
            if known is not fact and known != fact:
                raise ConflictingFacts(f"two facts are called {fact.name!r}; check {check.name} brings the second")
    return tuple(needed.values())


def read(fact: Fact[Any], output: Output | None) -> Any:
    """The value of a fact, or why there is none."""
    if output is None:
        return Unknown("the machine gave no answer")
    if output.status is None:
        return Unknown(f"did not answer within {fact.timeout_s:g} s")
    try:
        return fact.parse(output)
    except ValueError as error:
        return Unknown(f"unreadable answer: {error}")


def ask(target: Target, machine: str, facts: Sequence[Fact[Any]], robot_addresses: Sequence[str] = ()) -> Facts:
    """The facts of one machine, all in one batch. Raises TargetError where the machine can't be asked at all.

    Probes find the addresses by which the robot is known in $LUPIN_ROBOT_ADDRESSES.
    """
    if not facts:
        return Facts(machine, {})
    known = f"{ROBOT_ADDRESSES}={shlex.quote(' '.join(robot_addresses))}\n"
    shared = [fact for fact in facts if fact.at_once]
    scripts = [Script(fact.name, known + fact.probe, fact.timeout_s, fact.root) for fact in facts if not fact.at_once]
    probes = [fact.probe for fact in shared]
    if shared:
        scripts.append(Script(_SHARED, known + together(probes), max(fact.timeout_s for fact in shared)))
    before_ns = time.time_ns()
    outputs = target.batch(scripts, bound_s=max(fact.timeout_s for fact in facts) + BATCH_SLACK_S)
    if whole := outputs.pop(_SHARED, None):
        outputs |= zip([fact.name for fact in shared], apart(whole, probes))
    asked_ns = before_ns, time.time_ns()
    return Facts(machine, {fact.name: read(fact, outputs.get(fact.name)) for fact in facts}, asked_ns, outputs)


def gather(
    checks: Sequence[Check],
    laptop: Target,
    reach: Callable[[], tuple[Target, Link]] | None = None,
    link: Link | None = None,
    addresses: Sequence[str] = (),
    clock: Callable[[], Offset | None] = lambda: None,
    told: Callable[[], Facts] | None = None,
) -> Evidence:
    """Ask this machine while the robot is reached and asked; `told` waits for its facts where it is asked already.

    `reach` gives the robot and the link that it was reached by; `link` is what is said of the link where `reach` fails, and
    `addresses` are those that the robot may have. `clock` tells what is known of its clock once it was asked. One that can't
    be reached costs none of this machine's facts: they are what tells why.
    """
    of_laptop, of_robot = facts_of(checks, "laptop"), facts_of(checks, "robot")
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="laptop") as pool:
        here = pool.submit(told or (lambda: ask(laptop, "laptop", of_laptop, addresses)))
        there = None
        if reach is not None:
            try:
                robot, link = reach()
                there = ask(robot, "robot", of_robot, addresses)
                link = replace(link, clock=clock())
            except TargetError as error:
                link = replace(
                    link or Link("robot", ""), kind=failure_kind(error), message=str(error), next_command=error.next_command
                )
        return Evidence(here.result(), there, link)


def look_closer(
    checks: Sequence[Check],
    found: Diagnosis,
    evidence: Evidence,
    laptop: Target,
    robot: Target | None,
    addresses: Sequence[str] = (),
) -> Evidence | None:
    """The evidence with what checks ask for where they found something, from both ends at the same time; None where none asks.

    A robot that can't be asked any more keeps the facts that it gave.
    """
    due = [check for check in checks if found.by_check.get(check.name) and (check.closer_laptop or check.closer_robot)]
    if not due:
        return None
    of_laptop = facts_of([replace(check, laptop=check.closer_laptop) for check in due], "laptop")
    of_robot = facts_of([replace(check, robot=check.closer_robot) for check in due], "robot")
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="laptop") as pool:
        here = pool.submit(ask, laptop, "laptop", of_laptop, addresses)
        there = None
        if robot is not None and evidence.robot is not None:
            with suppress(TargetError):
                there = ask(robot, "robot", of_robot, addresses)
        robots = None if evidence.robot is None else _with(evidence.robot, there)
        return replace(evidence, laptop=_with(evidence.laptop, here.result()), robot=robots)


def _with(facts: Facts, more: Facts | None) -> Facts:
    if more is None:
        return facts
    return replace(facts, values={**facts.values, **more.values}, outputs={**facts.outputs, **more.outputs})


_KINDS = {
    HostKeyUnknown: "host-key-unknown",
    HostKeyChanged: "host-key-changed",
    AuthenticationFailed: "authentication",
    RootRefused: "root",
}


def failure_kind(error: TargetError) -> str:
    """How a robot could not be asked, as `Link.kind` says it."""
    return error.kind if isinstance(error, Unreachable) else _KINDS.get(type(error), "target")


def diagnose(checks: Sequence[Check], evidence: Evidence, broken: Iterable[str] = ()) -> Diagnosis:
    """Run the checks. One that raises is named in `broken` and costs the others nothing."""
    started = time.monotonic()
    failed = list(broken)
    by_check: dict[str, tuple[Finding, ...]] = {}
    for check in checks:
        try:
            by_check[check.name] = tuple(check.find(evidence))
        except Exception as error:  # a check may be a plug-in's: whatever it raises, the others still count
            failed.append(f"check {check.name}: {type(error).__name__}: {error}")
    return Diagnosis(
        checks=tuple(check.name for check in checks),
        roots=fold(hindered(finding for findings in by_check.values() for finding in findings)),
        unknown=tuple(unanswered(evidence)),
        broken=tuple(failed),
        by_check=by_check,
        duration_s=time.monotonic() - started,
    )


def hindered(findings: Iterable[Finding]) -> Iterable[Finding]:
    """The findings; a cure that another finding of the same machine lets fail isn't safe to try unasked."""
    found = tuple(findings)
    hopeless = {(finding.where, playbook) for finding in found for playbook in finding.hinders}
    for finding in found:
        hopes = (finding.where, finding.fix.playbook) not in hopeless
        yield finding if hopes else replace(finding, fix=replace(finding.fix, safe=False))


def fold(findings: Iterable[Finding]) -> tuple[Root, ...]:
    """Put every finding under the one that explains it, problems before warnings; a circle is cut at its first finding."""
    found: list[Finding] = []
    for finding in findings:
        if finding not in found:
            found.append(finding)
    order = {id(finding): place for place, finding in enumerate(found)}

    def reached(cause: Finding) -> list[Finding]:
        seen, edge = {id(cause)}, [cause]
        while edge:
            step = edge.pop()
            fresh = [f for f in found if step.accounts_for(f) and id(f) not in seen]
            seen |= {id(f) for f in fresh}
            edge += fresh
        return [f for f in found if id(f) in seen and f is not cause]

    consequences = {id(finding): reached(finding) for finding in found}

    def explained(finding: Finding) -> bool:
        for cause in found:
            if any(f is finding for f in consequences[id(cause)]):
                circle = any(f is cause for f in consequences[id(finding)])
                if not circle or order[id(cause)] < order[id(finding)]:
                    return True
        return False

    tops = [finding for finding in found if not explained(finding)]
    told: set[int] = set()
    roots = []
    for top in tops:
        under = tuple(f for f in consequences[id(top)] if id(f) not in told and not any(f is t for t in tops))
        told |= {id(f) for f in under}
        roots.append(Root(top, under))
    return tuple(sorted(roots, key=lambda root: root.finding.severity is not Severity.PROBLEM))


def unanswered(evidence: Evidence) -> Iterable[str]:
    """One line for each fact that has no value."""
    for facts in (evidence.laptop, evidence.robot):
        for name, value in facts.values.items() if facts else ():
            if isinstance(value, Unknown):
                yield f"{facts.machine}: {name}: {value.reason}" if facts else name
