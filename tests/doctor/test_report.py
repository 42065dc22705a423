"""What a diagnosis looks like to people and programs."""

from __future__ import annotations

import json
from xml.etree import ElementTree

import pytest

from lupin_cli.checks import Check, Evidence, Fix, Severity
from lupin_cli.diagnosis import Diagnosis, diagnose
from lupin_cli.facts import Facts, Unknown
from lupin_cli.facts.link import Link
from lupin_cli.report import exit_status, print_terminal, summary, to_json, to_junit, to_markdown

HEALTHY = Evidence(Facts("laptop", {}), None)
QUIET = Check("quiet", lambda e: ())


@pytest.fixture
def sick(finding) -> Diagnosis:
    def breaks(evidence: Evidence):
        raise KeyError("x")

    root = finding("no-server", "blank", playbook="recover-discovery", safe=True)
    checks = [QUIET, Check("server", lambda e: [root]), Check("page", lambda e: [finding("blank")]), Check("odd", breaks)]
    return diagnose(
        checks, Evidence(Facts("laptop", {"routes": Unknown("slow")}), None), ["plug-in theirs (a:b): ImportError: x"]
    )


def test_exit_statuses_are_those_of_the_manual(sick, finding) -> None:
    healthy = diagnose([QUIET], HEALTHY)
    warned = diagnose([Check("w", lambda e: [finding("w", severity=Severity.WARNING)])], HEALTHY)
    gap = diagnose([QUIET], Evidence(Facts("laptop", {"a": Unknown("slow")}), None))
    broken = diagnose([QUIET], HEALTHY, ["plug-in x (y): z"])
    assert [exit_status(d) for d in (healthy, warned, sick, gap, broken)] == [0, 1, 1, 4, 4]
    assert exit_status(sick, Link("r", "10.42.0.1", "timeout")) == 3
    assert exit_status(healthy, Link("r", "10.42.0.1")) == 0


def test_json_holds_the_whole_tree(sick) -> None:
    told = json.loads(to_json(sick, Link("r", "10.42.0.1")))
    (root,) = told["findings"]
    assert (root["id"], [c["id"] for c in root["consequences"]]) == ("no-server", ["blank"])
    assert root["evidence"] == ["line of no-server"]
    assert root["fix"] == {"command": "mend no-server", "playbook": "recover-discovery", "variables": {}, "safe": True}
    assert told["unknown"] == ["laptop: routes: slow"]
    assert told["status"] == 1


def test_junit_counts_what_it_tells(sick) -> None:
    suite = ElementTree.fromstring(to_junit(sick))
    cases = suite.findall("testcase")
    assert int(suite.get("tests")) == len(cases) == 6
    assert int(suite.get("failures")) == len(suite.findall("testcase/failure")) == 2
    assert int(suite.get("errors")) == len(suite.findall("testcase/error")) == 3


def test_markdown_has_a_heading_per_cause_and_its_evidence(sick) -> None:
    text = to_markdown(sick, "Robot r")
    assert text.startswith("# Robot r\n")
    assert "## cause of no-server" in text
    assert "## cause of blank" not in text
    assert "line of no-server" in text


def test_the_terminal_is_quiet_when_healthy(capsys) -> None:
    print_terminal(diagnose([QUIET], HEALTHY))
    assert capsys.readouterr().out == "healthy; 1 check\n"


def test_the_terminal_shows_cause_evidence_consequence_and_fix(sick, capsys) -> None:
    print_terminal(sick)
    out = capsys.readouterr().out
    assert "✗ robot: cause of no-server  [no-server]" in out
    assert "│ line of no-server" in out
    assert "explains  robot: cause of blank  [blank]" in out
    assert "fix       mend no-server   (--fix does it)" in out
    assert "\x1b" not in out


def test_escape_sequences_of_evidence_never_reach_a_terminal_or_a_report(finding, capsys) -> None:
    from dataclasses import replace

    words = "\x1b]0;title\x07\x1b[2J"
    other = replace(finding("y"), cause=words)  # a process may be called anything
    nasty = replace(finding("x", "y"), cause=words, symptom=words, evidence=(words,), fix=Fix(f"kill {words}"))
    diagnosis = diagnose([Check("x", lambda e: [nasty, other])], HEALTHY)
    print_terminal(diagnosis)
    for text in (capsys.readouterr().out, to_markdown(diagnosis, "t"), to_junit(diagnosis)):
        assert "\x1b" not in text
        assert "\x07" not in text
    ElementTree.fromstring(to_junit(diagnosis))


def test_evidence_never_ends_its_own_block_of_markdown(finding) -> None:
    from dataclasses import replace

    quoting = replace(finding("x"), evidence=("```", "# not a heading", "````"))
    text = to_markdown(diagnose([Check("x", lambda e: [quoting])], HEALTHY), "t")
    assert text.count("\n`````\n") == 2


def test_summaries_count(sick) -> None:
    assert summary(sick) == "1 problem; 4 checks; 3 not looked at"
