"""Gathering facts, running checks, and folding consequences under root causes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.checks import Check, Finding, Fix, Severity, Snapshot
from lupin_cli.checks.ground_truth import GroundTruth, State
from lupin_cli.connection import HostKeyChanged, Output, Unreachable
from lupin_cli.connection.base import PrivateKeyMissing, SshConfigUnusable
from lupin_cli.doctor.engine import diagnose, fold_consequences, weigh_by_ground_truth
from lupin_cli.doctor.gathering import ConflictingFacts, gather_facts, gather_snapshot, needed_facts
from lupin_cli.facts import Fact, Facts, Unknown
from lupin_cli.facts.clock import Offset
from lupin_cli.facts.link import Link
from lupin_cli.printed_commands import repeat_inventory
from tests.support.optional import present

if TYPE_CHECKING:
    from tests.lupin_cli.doctor.conftest import ScriptedMachine


def length(output: Output) -> int:
    if not output.stdout:
        raise ValueError("no text at all")
    return len(output.stdout)


LENGTH = Fact("length", "echo x", length)
UPTIME = Fact("uptime", "uptime", length, timeout_s=1.5)
NOTHING = Snapshot(Facts("laptop", {}), None)


def test_each_machine_is_asked_once_for_all_needed_facts(machine: type[ScriptedMachine]) -> None:
    checks = [
        Check("a", lambda _e: (), laptop=(LENGTH,), robot=(LENGTH, UPTIME)),
        Check("b", lambda _e: (), laptop=(LENGTH,), robot=(UPTIME,)),
    ]
    laptop, robot = machine({"length": Output(0, "four")}), machine({"length": Output(0, "xy"), "uptime": Output(0, "z")})
    snapshot = gather_snapshot(checks, laptop, lambda: (robot, Link("r", "10.42.0.1")))  # type: ignore[arg-type, return-value]
    assert laptop.asked == [["length"]]
    assert robot.asked == [["length", "uptime"]]
    assert snapshot.laptop.get(LENGTH) == 4
    assert snapshot.robot is not None
    assert snapshot.robot.get(LENGTH) == 2
    assert present(snapshot.link).reachable


def test_fact_without_value_is_unknown_with_its_reason(machine: type[ScriptedMachine]) -> None:
    facts = gather_facts(
        machine({"length": Output(0, ""), "uptime": Output(None, "")}),  # type: ignore[arg-type]
        "robot",
        [LENGTH, UPTIME, Fact("x", "", length)],
    )
    assert facts.get(LENGTH) is None
    assert facts.why_unknown(LENGTH) == "unreadable answer: no text at all"
    assert facts.why_unknown(UPTIME) == "did not answer within 1.5 s"
    assert facts.values["x"] == Unknown("the machine gave no answer")


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (Unreachable("gone", "no-route", "nmcli"), "no-route"),
        (HostKeyChanged("other key"), "host-key-changed"),
        (PrivateKeyMissing("no key"), "no-key"),
        (SshConfigUnusable("jumps in a circle", "ssh -G r"), "ssh-config"),
    ],
)
def test_unreachable_robot_keeps_the_laptop_facts(machine: type[ScriptedMachine], error: Any, kind: str) -> None:
    def reach() -> None:
        raise error

    check = Check("a", lambda _e: (), laptop=(LENGTH,), robot=(LENGTH,))
    snapshot = gather_snapshot([check], machine({"length": Output(0, "four")}), reach, Link("r", "10.42.0.1"))  # type: ignore[arg-type]
    assert snapshot.laptop.get(LENGTH) == 4
    assert snapshot.robot is None
    assert (present(snapshot.link).kind, present(snapshot.link).next_command) == (kind, present(error).next_command)


def test_two_facts_with_one_name_are_rejected() -> None:
    other = Fact("length", "echo other", length)
    with pytest.raises(ConflictingFacts, match="length"):
        needed_facts([Check("a", lambda _e: (), laptop=(LENGTH,)), Check("b", lambda _e: (), laptop=(other,))], "laptop")


def test_raising_check_is_named_and_others_still_run(finding: Callable[..., Any]) -> None:
    def breaks(_snapshot: Snapshot) -> None:
        raise ZeroDivisionError("division by zero")

    found = finding("no-server")
    diagnosis = diagnose([Check("broken", breaks), Check("works", lambda _e: [found])], NOTHING)  # type: ignore[arg-type]
    assert list(map(str, diagnosis.check_errors)) == ["check broken: ZeroDivisionError: division by zero"]
    assert diagnosis.findings == (found,)


def test_unknown_facts_are_listed_with_their_machine() -> None:
    snapshot = Snapshot(Facts("laptop", {"a": 1, "b": Unknown("slow")}), Facts("robot", {"c": Unknown("odd")}))
    assert list(map(str, diagnose([], snapshot).unknown)) == ["laptop: b: slow", "robot: c: odd"]


def test_transitive_consequences_are_listed_under_the_root(finding: Callable[..., Any]) -> None:
    root, middle, leaf, other = finding("root", "middle"), finding("middle", "leaf"), finding("leaf"), finding("other")
    folded = fold_consequences([leaf, middle, other, root])
    assert [(r.finding.id, [c.id for c in r.consequences]) for r in folded] == [("other", []), ("root", ["leaf", "middle"])]


def test_cause_explains_only_the_topics_it_names(finding: Callable[..., Any]) -> None:
    lost = finding("controllers-not-active", "topic-silent:/odom")
    odom, scan = (replace(finding("topic-silent"), about=name) for name in ("/odom", "/scan"))
    roots = fold_consequences([odom, scan, lost])
    assert [(root.finding, root.consequences) for root in roots] == [(scan, ()), (lost, (odom,))]


def test_mutual_explanation_keeps_the_first_as_root(finding: Callable[..., Any]) -> None:
    folded = fold_consequences([finding("a", "b"), finding("b", "a", "c"), finding("c")])
    assert [(r.finding.id, [c.id for c in r.consequences]) for r in folded] == [("a", ["b", "c"])]


def test_problems_come_before_warnings(finding: Callable[..., Any]) -> None:
    folded = fold_consequences([finding("w", severity=Severity.WARNING), finding("p")])
    assert [root.finding.id for root in folded] == ["p", "w"]


@pytest.mark.parametrize(
    ("state", "severity"),
    [(State.HEALTHY, Severity.WARNING), (State.UNOBSERVED, Severity.PROBLEM), (State.BROKEN, Severity.PROBLEM)],
)
def test_cause_of_a_loss_is_a_warning_if_all_arrives(finding: Callable[..., Any], state: State, severity: Severity) -> None:
    (weighed,) = weigh_by_ground_truth([finding("cut", "unexplained")], GroundTruth(state))
    assert weighed.severity is severity


def test_cause_that_is_not_in_effect_explains_no_lack_of_data(finding: Callable[..., Any]) -> None:
    cut = finding("cut", "unexplained", "part-missing", "discovery-server-missing", "shell-multicast-only")

    def weighed(*others: Finding) -> Finding:
        return next(iter(weigh_by_ground_truth([cut, *others], GroundTruth(State.HEALTHY))))

    assert weighed().explains == {"shell-multicast-only"}
    assert weighed(finding("discovery-server-missing")).severity is Severity.WARNING
    assert weighed(finding("shell-multicast-only")).severity is Severity.PROBLEM
    assert weighed(finding("shell-multicast-only", severity=Severity.WARNING)).severity is Severity.WARNING


def test_warning_explains_a_problem_only_by_its_subject(finding: Callable[..., Any]) -> None:
    lost = replace(finding("unit-failed"), about="lupin-onboard.service")

    def roots(cause: Finding, other: Finding = lost) -> list[str]:
        return [root.finding.id for root in fold_consequences([cause, other])]

    assert roots(finding("unsigned", "unit-failed", severity=Severity.WARNING)) == ["unit-failed", "unsigned"]
    assert roots(finding("unsigned", "unit-failed:lupin-onboard.service", severity=Severity.WARNING)) == ["unsigned"]
    assert roots(finding("unsigned", "unit-failed")) == ["unsigned"]
    # The exit status says that the robot was not reached, whatever explains it.
    lossy = finding("packets-lost", "robot-unreachable", severity=Severity.WARNING)
    assert roots(lossy, finding("robot-unreachable")) == ["packets-lost"]


def test_warning_is_a_problem_if_only_it_explains_a_loss(finding: Callable[..., Any]) -> None:
    def severity_of_warning(*others: Finding) -> Severity:
        warning = finding("shell", "unexplained", severity=Severity.WARNING)
        weighed = weigh_by_ground_truth([warning, *others], GroundTruth(State.BROKEN))
        return next(each.severity for each in weighed if each.id == "shell")

    loss, cut = finding("unexplained"), finding("cut", "unexplained")
    assert severity_of_warning() is Severity.WARNING
    assert severity_of_warning(loss) is Severity.PROBLEM
    assert severity_of_warning(loss, cut) is Severity.WARNING
    assert severity_of_warning(replace(loss, id="another")) is Severity.WARNING


def test_profile_written_again_is_no_root_beside_the_cause(finding: Callable[..., Any]) -> None:
    def roots(*others: Finding) -> list[str]:
        changed = finding("profile-changed", severity=Severity.WARNING)
        found = weigh_by_ground_truth([changed, finding("unexplained"), *others], GroundTruth(State.BROKEN))
        return [root.finding.id for root in fold_consequences(found)]

    assert roots(finding("robot-multi-homed", "unexplained")) == ["robot-multi-homed"]
    assert roots(finding("unit-not-enabled", "unexplained", severity=Severity.WARNING)) == ["unit-not-enabled"]
    assert roots(finding("robot-multi-homed", "unexplained:other")) == ["unexplained", "robot-multi-homed", "profile-changed"]


def test_same_finding_of_two_checks_is_listed_once(finding: Callable[..., Any]) -> None:
    assert len(fold_consequences([finding("a"), finding("a")])) == 1


IDS = st.sampled_from("abcdef")


@given(st.lists(st.tuples(IDS, st.frozensets(IDS)), max_size=8))
def test_folding_keeps_every_finding_exactly_once(edges: list[Any]) -> None:
    found = [
        Finding(id, Severity.PROBLEM, "robot", "s", f"c{place}", (), Fix("f"), explains)
        for place, (id, explains) in enumerate(edges)
    ]
    listed = [f for root in fold_consequences(found) for f in (root.finding, *root.consequences)]
    assert sorted(f.cause for f in listed) == sorted(f.cause for f in found)


def test_clock_offset_is_measured_after_the_robot_was_asked(machine: type[ScriptedMachine]) -> None:
    fact = Fact("length", "echo four", lambda output: len(output.stdout))
    check = Check("c", lambda _snapshot: (), robot=(fact,))
    robot = machine({"length": Output(0, "four")})

    def measure() -> Offset:
        assert robot.asked == [["length"]]
        return Offset(0.25, 0.001)

    snapshot = gather_snapshot([check], machine({}), lambda: (robot, Link("r", "10.42.0.1")), clock_offset=measure)  # type: ignore[arg-type, return-value]
    assert snapshot.link is not None
    assert snapshot.link.clock == Offset(0.25, 0.001)


@pytest.mark.parametrize(
    ("where", "command", "completed"),
    [
        ("laptop", "lupin play serve-clock", "lupin play serve-clock --config 'my robots.toml'"),
        ("laptop", "lupin dds setup 10.42.0.1 && source /a", "lupin dds setup 10.42.0.1 && source /a"),
        ("robot", "lupin play heal", "lupin play heal --robot pot --config 'my robots.toml'"),
        (
            "robot",
            "ssh -t pot 'sudo true' && lupin home",
            "ssh -t pot 'sudo true' && lupin home --robot pot --config 'my robots.toml'",
        ),
        ("link", "lupin transport show --robot pot", "lupin transport show --robot pot --config 'my robots.toml'"),
    ],
)
def test_commands_repeat_the_inventory(finding: Callable[..., Any], where: str, command: str, completed: str) -> None:
    found = replace(finding("x", where=where), fix=Fix(command))
    snapshot = replace(NOTHING, link=Link("pot", "10.42.0.1"))
    repeat_inventory(Path("my robots.toml"))
    try:
        (root,) = diagnose([Check("x", lambda _e: [found])], snapshot).roots
    finally:
        repeat_inventory(None)
    assert root.finding.fix.command == completed
