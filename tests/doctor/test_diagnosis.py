"""Gathering, running and folding."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lupin_cli.checks import Check, Evidence, Finding, Fix, Severity
from lupin_cli.diagnosis import ConflictingFacts, ask, diagnose, facts_of, fold, gather
from lupin_cli.facts import Fact, Facts, Unknown
from lupin_cli.facts.clock import Offset
from lupin_cli.facts.link import Link
from lupin_cli.target import HostKeyChanged, Output, Unreachable


def length(output: Output) -> int:
    if not output.stdout:
        raise ValueError("no text at all")
    return len(output.stdout)


LENGTH = Fact("length", "echo x", length)
UPTIME = Fact("uptime", "uptime", length, timeout_s=1.5)
NOTHING = Evidence(Facts("laptop", {}), None)


def test_each_machine_is_asked_once_for_the_union_of_what_checks_need(machine) -> None:
    checks = [
        Check("a", lambda e: (), laptop=(LENGTH,), robot=(LENGTH, UPTIME)),
        Check("b", lambda e: (), laptop=(LENGTH,), robot=(UPTIME,)),
    ]
    laptop, robot = machine({"length": Output(0, "four")}), machine({"length": Output(0, "xy"), "uptime": Output(0, "z")})
    evidence = gather(checks, laptop, lambda: (robot, Link("r", "10.42.0.1")))
    assert laptop.asked == [["length"]]
    assert robot.asked == [["length", "uptime"]]
    assert evidence.laptop.get(LENGTH) == 4
    assert evidence.robot is not None
    assert evidence.robot.get(LENGTH) == 2
    assert evidence.link.reachable


def test_what_could_not_be_asked_cut_off_or_read_is_unknown_with_its_reason(machine) -> None:
    facts = ask(
        machine({"length": Output(0, ""), "uptime": Output(None, "")}), "robot", [LENGTH, UPTIME, Fact("x", "", length)]
    )
    assert facts.get(LENGTH) is None
    assert facts.why_unknown(LENGTH) == "unreadable answer: no text at all"
    assert facts.why_unknown(UPTIME) == "did not answer within 1.5 s"
    assert facts.values["x"] == Unknown("the machine gave no answer")


@pytest.mark.parametrize(
    ("error", "kind"),
    [(Unreachable("gone", "no-route", "nmcli"), "no-route"), (HostKeyChanged("other key"), "host-key-changed")],
)
def test_an_unreachable_robot_costs_no_fact_of_this_machine(machine, error, kind) -> None:
    def reach():
        raise error

    check = Check("a", lambda e: (), laptop=(LENGTH,), robot=(LENGTH,))
    evidence = gather([check], machine({"length": Output(0, "four")}), reach, Link("r", "10.42.0.1"))
    assert evidence.laptop.get(LENGTH) == 4
    assert evidence.robot is None
    assert (evidence.link.kind, evidence.link.next_command) == (kind, error.next_command)


def test_two_facts_of_one_name_are_refused() -> None:
    other = Fact("length", "echo other", length)
    with pytest.raises(ConflictingFacts, match="length"):
        facts_of([Check("a", lambda e: (), laptop=(LENGTH,)), Check("b", lambda e: (), laptop=(other,))], "laptop")


def test_a_check_that_fails_is_named_and_costs_the_others_nothing(finding) -> None:
    def breaks(evidence: Evidence):
        raise ZeroDivisionError("division by zero")

    found = finding("no-server")
    diagnosis = diagnose([Check("broken", breaks), Check("works", lambda e: [found])], NOTHING)
    assert diagnosis.broken == ("check broken: ZeroDivisionError: division by zero",)
    assert diagnosis.findings == (found,)


def test_unknown_facts_are_told_with_their_machine() -> None:
    evidence = Evidence(Facts("laptop", {"a": 1, "b": Unknown("slow")}), Facts("robot", {"c": Unknown("odd")}))
    assert diagnose([], evidence).unknown == ("laptop: b: slow", "robot: c: odd")


def test_consequences_of_consequences_stand_under_the_root(finding) -> None:
    root, middle, leaf, other = finding("root", "middle"), finding("middle", "leaf"), finding("leaf"), finding("other")
    folded = fold([leaf, middle, other, root])
    assert [(r.finding.id, [c.id for c in r.consequences]) for r in folded] == [("other", []), ("root", ["leaf", "middle"])]


def test_a_cause_of_one_topics_silence_leaves_anothers_alone(finding) -> None:
    lost = finding("controllers-not-active", "topic-silent:/odom")
    odom, scan = (replace(finding("topic-silent"), about=name) for name in ("/odom", "/scan"))
    roots = fold([odom, scan, lost])
    assert [(root.finding, root.consequences) for root in roots] == [(scan, ()), (lost, (odom,))]


def test_findings_that_explain_each_other_keep_the_first_as_root(finding) -> None:
    folded = fold([finding("a", "b"), finding("b", "a", "c"), finding("c")])
    assert [(r.finding.id, [c.id for c in r.consequences]) for r in folded] == [("a", ["b", "c"])]


def test_problems_come_before_warnings(finding) -> None:
    folded = fold([finding("w", severity=Severity.WARNING), finding("p")])
    assert [root.finding.id for root in folded] == ["p", "w"]


def test_the_same_finding_of_two_checks_is_told_once(finding) -> None:
    assert len(fold([finding("a"), finding("a")])) == 1


IDS = st.sampled_from("abcdef")


@settings(deadline=None)
@given(st.lists(st.tuples(IDS, st.frozensets(IDS)), max_size=8))
def test_folding_loses_no_finding_and_tells_none_twice(edges) -> None:
    found = [
        Finding(id, Severity.PROBLEM, "robot", "s", f"c{place}", (), Fix("f"), explains)
        for place, (id, explains) in enumerate(edges)
    ]
    told = [f for root in fold(found) for f in (root.finding, *root.consequences)]
    assert sorted(f.cause for f in told) == sorted(f.cause for f in found)


def test_the_robots_clock_is_told_of_a_robot_that_was_asked(machine) -> None:
    fact = Fact("length", "echo four", lambda output: len(output.stdout))
    check = Check("c", lambda evidence: (), robot=(fact,))
    robot = machine({"length": Output(0, "four")})

    def measure() -> Offset:
        assert robot.asked == [["length"]]
        return Offset(0.25, 0.001)

    evidence = gather([check], machine({}), lambda: (robot, Link("r", "10.42.0.1")), clock=measure)
    assert evidence.link is not None
    assert evidence.link.clock == Offset(0.25, 0.001)
