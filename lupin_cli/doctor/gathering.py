"""Gather the facts that checks need, from both machines at the same time, into one snapshot."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import replace
from typing import Any

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.connection.base import (
    AuthenticationFailed,
    HostKeyChanged,
    HostKeyUnknown,
    LoginShellUnusable,
    Output,
    PrivateKeyMissing,
    PrivateKeyUnusable,
    RootRefused,
    Script,
    SshConfigUnusable,
    Target,
    TargetError,
    Unreachable,
)
from lupin_cli.facts.base import Fact, Facts, Unknown
from lupin_cli.facts.clock import Offset
from lupin_cli.facts.link import Link
from lupin_cli.facts.routes import ROBOT_ADDRESSES
from lupin_cli.facts.shared_shell import join_probes, split_outputs
from lupin_cli.link.path import Path

# How much longer than its slowest probe a batch may take: sudo, starting shells, a link with 60 ms of latency.
BATCH_SLACK_S = 3.0
# A healthy graph has been visited by then (2.3 to 3.5 s on two cores). If it has not, the path is measured while the visit goes
# on. That takes 3 s, which a healthy robot must not cost.
PATH_AFTER_S = 3.8
TIMED_OUT = "did not answer within"
_SHARED = "shared shell"  # the script that gathers the facts that share a shell; no fact's name contains a space


class ConflictingFacts(ValueError):
    """Two facts have the same name, and one would get the other's value."""


def needed_facts(checks: Iterable[Check], machine: str) -> tuple[Fact[Any], ...]:
    """Return the facts that the checks need of `machine` ("laptop" or "robot"), each once. Raises ConflictingFacts."""
    needed: dict[str, Fact[Any]] = {}
    for check in checks:
        for fact in check.robot if machine == "robot" else check.laptop:
            known = needed.setdefault(fact.name, fact)
            if known is not fact and known != fact:
                raise ConflictingFacts(f"two facts are called {fact.name!r}; check {check.name} uses the second")
    return tuple(needed.values())


def parse_fact(fact: Fact[Any], output: Output | None) -> Any:
    """Return the value of a fact, or an Unknown with the reason."""
    if output is None:
        return Unknown("the machine gave no answer")
    if output.status is None:
        return Unknown(f"{TIMED_OUT} {fact.timeout_s:g} s")
    try:
        return fact.parse(output)
    except ValueError as error:
        return Unknown(f"unreadable answer: {error}")


def gather_facts(target: Target, machine: str, facts: Sequence[Fact[Any]], robot_addresses: Sequence[str] = ()) -> Facts:
    """Gather the facts of one machine in one batch. Raises TargetError if the machine cannot be asked at all.

    In $LUPIN_ROBOT_ADDRESSES, probes find the addresses by which the inventory knows the robot.
    """
    if not facts:
        return Facts(machine, {})
    assignment = f"{ROBOT_ADDRESSES}={shlex.quote(' '.join(robot_addresses))}\n"
    shared = [fact for fact in facts if fact.runs_in_shared_shell]
    scripts = [
        Script(fact.name, assignment + fact.probe, fact.timeout_s, fact.root) for fact in facts if not fact.runs_in_shared_shell
    ]
    probes = [fact.probe for fact in shared]
    if shared:
        scripts.append(Script(_SHARED, assignment + join_probes(probes), max(fact.timeout_s for fact in shared)))
    sent_ns = time.time_ns()
    outputs = target.batch(scripts, timeout_s=max(fact.timeout_s for fact in facts) + BATCH_SLACK_S)
    if joined := outputs.pop(_SHARED, None):
        outputs |= zip([fact.name for fact in shared], split_outputs(joined, probes))
    values = {fact.name: parse_fact(fact, outputs.get(fact.name)) for fact in facts}
    return Facts(machine, values, (sent_ns, time.time_ns()), outputs)


def gather_snapshot(
    checks: Sequence[Check],
    laptop: Target,
    connect: Callable[[], tuple[Target, Link]] | None = None,
    failed_link: Link | None = None,
    addresses: Sequence[str] = (),
    clock_offset: Callable[[], Offset | None] = lambda: None,
    laptop_facts: Callable[[], Facts] | None = None,
    measure_path: Callable[[Snapshot], Path | None] = lambda _: None,
) -> Snapshot:
    """Gather the laptop's facts and, at the same time, connect to the robot and gather its facts.

    `connect` returns the robot and the link over which it was reached; without it, only the laptop is asked. If `connect` or
    the batch fails, the link is `failed_link` with the error; the laptop's facts, which show the reason, are kept.
    `addresses` are those that the robot may have. `clock_offset` measures the robot's clock after it was asked. If several
    sessions share the laptop, `laptop_facts` waits for its facts, which are gathered elsewhere. `measure_path` is called with
    the robot's part of the snapshot if the laptop's facts take long: then something does not arrive, and this finds out where.
    """
    slow_s = time.monotonic() + PATH_AFTER_S
    needed_of_laptop, needed_of_robot = needed_facts(checks, "laptop"), needed_facts(checks, "robot")
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="laptop") as pool:
        pending = pool.submit(laptop_facts or (lambda: gather_facts(laptop, "laptop", needed_of_laptop, addresses)))
        robot_facts, link = None, failed_link
        if connect is not None:
            try:
                robot, reached = connect()
                robot_facts = gather_facts(robot, "robot", needed_of_robot, addresses)
                link = replace(reached, clock=clock_offset())
            except TargetError as error:
                link = replace(
                    failed_link or Link("robot", ""),
                    kind=failure_kind(error),
                    message=str(error),
                    next_command=error.next_command,
                )
        path = None
        wait([pending], timeout=max(0.0, slow_s - time.monotonic()))
        if link is not None and not pending.done():
            path = measure_path(Snapshot(Facts("laptop", {}), robot_facts, link))
        return Snapshot(pending.result(), robot_facts, link, path)


def gather_followup_facts(
    checks: Sequence[Check],
    by_check: Mapping[str, Sequence[Finding]],
    roots: Collection[Finding],
    snapshot: Snapshot,
    laptop: Target,
    robot: Target | None,
    addresses: Sequence[str] = (),
) -> Snapshot | None:
    """Return the snapshot with the follow-up facts of the checks that found one of the root causes; None if they need none.

    If the robot cannot be asked any more, its earlier facts are kept.
    """
    causes = {(finding.id, finding.where, finding.about) for finding in roots}
    to_follow_up = [
        check
        for check in checks
        if check.followup_laptop or check.followup_robot
        if any((finding.id, finding.where, finding.about) in causes for finding in by_check.get(check.name, ()))
    ]
    if not to_follow_up:
        return None
    needed_of_laptop = needed_facts([replace(each, laptop=each.followup_laptop) for each in to_follow_up], "laptop")
    needed_of_robot = needed_facts([replace(each, robot=each.followup_robot) for each in to_follow_up], "robot")
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="laptop") as pool:
        pending = pool.submit(gather_facts, laptop, "laptop", needed_of_laptop, addresses)
        robot_facts = snapshot.robot
        if robot is not None and robot_facts is not None:
            with suppress(TargetError):
                robot_facts = _merge(robot_facts, gather_facts(robot, "robot", needed_of_robot, addresses))
        return replace(snapshot, laptop=_merge(snapshot.laptop, pending.result()), robot=robot_facts)


def _merge(facts: Facts, more: Facts) -> Facts:
    return replace(facts, values={**facts.values, **more.values}, outputs={**facts.outputs, **more.outputs})


_KINDS = {
    HostKeyUnknown: "host-key-unknown",
    HostKeyChanged: "host-key-changed",
    AuthenticationFailed: "authentication",
    PrivateKeyMissing: "no-key",
    PrivateKeyUnusable: "private-key",
    SshConfigUnusable: "ssh-config",
    LoginShellUnusable: "login-shell",
    RootRefused: "root",
}


def failure_kind(error: TargetError) -> str:
    """Return the `Link.kind` of an error while connecting to or asking the robot."""
    return error.kind if isinstance(error, Unreachable) else _KINDS.get(type(error), "target")
