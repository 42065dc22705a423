"""A diagnosis as terminal text, JSON, JUnit XML and Markdown."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import pytest

from lupin_cli.checks import Check, Finding, Fix, Severity, Snapshot
from lupin_cli.doctor.engine import Diagnosis, diagnose
from lupin_cli.doctor.report import exit_status, print_terminal, summary, to_json, to_junit, to_markdown
from lupin_cli.facts import Facts, Unknown
from lupin_cli.facts.link import Link

HEALTHY = Snapshot(Facts("laptop", {}), None)
QUIET = Check("quiet", lambda _e: ())


@pytest.fixture
def diagnosis(finding: Callable[..., Finding]) -> Diagnosis:
    def breaks(_snapshot: Snapshot) -> None:
        raise KeyError("x")

    root = finding("no-server", "blank", playbook="recover-discovery", safe=True)
    checks = [QUIET, Check("server", lambda _e: [root]), Check("page", lambda _e: [finding("blank")]), Check("odd", breaks)]  # type: ignore[arg-type]
    return diagnose(
        checks, Snapshot(Facts("laptop", {"routes": Unknown("slow")}), None), ["plug-in theirs (a:b): ImportError: x"]
    )


def test_exit_status_matches_the_manual(diagnosis: Diagnosis, finding: Callable[..., Any]) -> None:
    healthy = diagnose([QUIET], HEALTHY)
    warned = diagnose([Check("w", lambda _e: [finding("w", severity=Severity.WARNING)])], HEALTHY)
    gap = diagnose([QUIET], Snapshot(Facts("laptop", {"a": Unknown("slow")}), None))
    broken = diagnose([QUIET], HEALTHY, ["plug-in x (y): z"])
    assert [exit_status(d) for d in (healthy, warned, diagnosis, gap, broken)] == [0, 1, 1, 4, 4]
    assert exit_status(diagnosis, Link("r", "10.42.0.1", "timeout")) == 3
    assert exit_status(healthy, Link("r", "10.42.0.1")) == 0


def test_json_contains_roots_and_consequences(diagnosis: Diagnosis) -> None:
    report = json.loads(to_json(diagnosis, Link("r", "10.42.0.1")))
    (root,) = report["findings"]
    assert (root["id"], [c["id"] for c in root["consequences"]]) == ("no-server", ["blank"])
    assert root["evidence"] == ["line of no-server"]
    assert root["fix"] == {"command": "fix no-server", "playbook": "recover-discovery", "variables": {}, "safe": True}
    assert report["unknown"] == ["laptop: routes: slow"]
    assert report["status"] == 1


def test_junit_counters_match_its_cases(diagnosis: Diagnosis) -> None:
    suite = ElementTree.fromstring(to_junit(diagnosis))
    cases = suite.findall("testcase")
    assert int(suite.attrib["tests"]) == len(cases) == 6
    assert int(suite.attrib["failures"]) == len(suite.findall("testcase/failure")) == 2
    assert int(suite.attrib["errors"]) == len(suite.findall("testcase/error")) == 3


def test_markdown_has_a_heading_and_evidence_per_root_cause(diagnosis: Diagnosis) -> None:
    text = to_markdown(diagnosis, "Robot r")
    assert text.startswith("# Robot r\n")
    assert "## cause of no-server" in text
    assert "## cause of blank" not in text
    assert "line of no-server" in text


def test_terminal_prints_one_line_if_healthy(capsys: pytest.CaptureFixture[str]) -> None:
    print_terminal(diagnose([QUIET], HEALTHY))
    assert capsys.readouterr().out == "healthy; 1 check\n"


def test_terminal_shows_cause_evidence_consequence_and_fix(diagnosis: Diagnosis, capsys: pytest.CaptureFixture[str]) -> None:
    print_terminal(diagnosis)
    out = capsys.readouterr().out
    assert "✗ robot: cause of no-server  [no-server]" in out
    assert "│ line of no-server" in out
    assert "explains  robot: cause of blank  [blank]" in out
    assert "fix       fix no-server   (--fix plays it)" in out
    assert "\x1b" not in out


def test_escape_sequences_are_removed_from_every_report(
    finding: Callable[..., Any], capsys: pytest.CaptureFixture[str]
) -> None:
    from dataclasses import replace

    words = "\x1b]0;title\x07\x1b[2J"
    other = replace(finding("y"), cause=words)  # a process may be called anything
    nasty = replace(finding("x", "y"), cause=words, symptom=words, evidence=(words,), fix=Fix(f"kill {words}"))
    unsafe = diagnose([Check("x", lambda _e: [nasty, other])], HEALTHY)
    print_terminal(unsafe)
    for text in (capsys.readouterr().out, to_markdown(unsafe, "t"), to_junit(unsafe)):
        assert "\x1b" not in text
        assert "\x07" not in text
    ElementTree.fromstring(to_junit(unsafe))


def test_evidence_cannot_close_its_markdown_fence(finding: Callable[..., Any]) -> None:
    from dataclasses import replace

    quoting = replace(finding("x"), evidence=("```", "# not a heading", "````"))
    text = to_markdown(diagnose([Check("x", lambda _e: [quoting])], HEALTHY), "t")
    assert text.count("\n`````\n") == 2


def test_summary_counts_problems_checks_and_gaps(diagnosis: Diagnosis) -> None:
    assert summary(diagnosis) == "1 problem; 4 checks; 3 not examined"
