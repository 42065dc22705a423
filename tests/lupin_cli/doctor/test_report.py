"""A diagnosis as terminal text, JSON, JUnit XML and Markdown."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import pytest

from lupin_cli.checks import Check, Finding, Fix, Gap, Severity, Snapshot
from lupin_cli.doctor.engine import Diagnosis, diagnose
from lupin_cli.doctor.report import (
    UnknownFieldError,
    exit_status,
    print_terminal,
    select_fields,
    summary,
    to_json,
    to_junit,
    to_markdown,
)
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
        checks, Snapshot(Facts("laptop", {"routes": Unknown("slow")}), None), [Gap("plug-in", "theirs (a:b)", "ImportError: x")]
    )


def test_exit_status_matches_the_manual(diagnosis: Diagnosis, finding: Callable[..., Any]) -> None:
    healthy = diagnose([QUIET], HEALTHY)
    warned = diagnose([Check("w", lambda _e: [finding("w", severity=Severity.WARNING)])], HEALTHY)
    gap = diagnose([QUIET], Snapshot(Facts("laptop", {"a": Unknown("slow")}), None))
    broken = diagnose([QUIET], HEALTHY, [Gap("plug-in", "x (y)", "z")])
    assert [exit_status(d) for d in (healthy, warned, diagnosis, gap, broken)] == [0, 1, 1, 4, 4]
    assert exit_status(diagnosis, Link("r", "10.42.0.1", "timeout")) == 3
    assert exit_status(healthy, Link("r", "10.42.0.1")) == 0


def test_json_contains_roots_and_consequences(diagnosis: Diagnosis) -> None:
    report = json.loads(to_json(diagnosis, Link("r", "10.42.0.1")))
    (root,) = report["findings"]
    assert (root["id"], [c["id"] for c in root["consequences"]]) == ("no-server", ["blank"])
    assert root["evidence"] == ["line of no-server"]
    assert root["fix"] == {
        "instruction": "",
        "command": "fix no-server",
        "playbook": "recover-discovery",
        "variables": {},
        "safe": True,
    }
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


def test_nothing_found_is_one_line_and_not_called_healthy(capsys: pytest.CaptureFixture[str]) -> None:
    print_terminal(diagnose([QUIET], HEALTHY))
    assert capsys.readouterr().out == "this machine: nothing found, topics were not measured\n"


def test_terminal_shows_cause_evidence_consequence_and_fix(diagnosis: Diagnosis, capsys: pytest.CaptureFixture[str]) -> None:
    print_terminal(diagnosis)
    out = capsys.readouterr().out
    assert "✗ robot: cause of no-server  [no-server]" in out
    assert "│ line of no-server" in out
    assert "explains  robot: cause of blank  [blank]" in out
    assert "\n  fix       fix no-server\n  --fix     plays recover-discovery\n" in out
    assert "\x1b" not in out


@pytest.mark.parametrize("columns", [80, 100])
def test_only_the_command_is_longer_than_a_line(
    columns: int, finding: Callable[..., Any], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    words = "every word of this text stays whole " * 6
    command = (
        "ssh -t mirte@10.42.0.1 'sudo systemctl restart mirte-ros.service' && " + "lupin play heal --robot greenhouse " * 3
    )
    fix = Fix(command.strip(), "heal", instruction=words.strip())
    long = replace(finding("x"), cause=words, symptom=words, evidence=(words, "/" + "a" * 120), fix=fix)
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    print_terminal(diagnose([Check("x", lambda _e: [long])], HEALTHY))
    out = re.sub(r"\x1b\[[0-9;]*m", "", capsys.readouterr().out)
    lines = out.splitlines()
    assert [line for line in lines if len(line) > columns] == ["  │ /" + "a" * 120, f"  fix       {command.strip()}"]
    assert f"do {words.strip()} fix" in " ".join(out.split())


def test_fix_by_hand_has_no_command(finding: Callable[..., Any], capsys: pytest.CaptureFixture[str]) -> None:
    by_hand = replace(finding("x"), fix=Fix(instruction="charge the battery"))
    both = replace(finding("y"), fix=Fix("lupin doctor", instruction="plug the cable in"))
    diagnosis = diagnose([Check("x", lambda _e: [by_hand]), Check("y", lambda _e: [both])], HEALTHY)
    print_terminal(diagnosis)
    out = capsys.readouterr().out
    assert out.count("  do        ") == 2 and out.count("  fix       ") == 1
    assert "  do        plug the cable in\n  fix       lupin doctor\n" in out
    assert "- To do: charge the battery\n" in to_markdown(diagnosis, "t") and "do: charge the battery" in to_junit(diagnosis)


def test_each_level_of_detail_shows_more(diagnosis: Diagnosis, capsys: pytest.CaptureFixture[str]) -> None:
    levels = []
    for verbose in range(3):
        print_terminal(diagnosis, verbose=verbose)
        levels.append(capsys.readouterr().out)
    assert levels[0] == levels[1]  # six lines of evidence fit, and no topic was measured
    assert "│ line of blank" not in levels[1] and "│ line of blank" in levels[2]
    for line in ("quiet: nothing found", "server: no-server", "page: blank", "odd: failed"):
        assert f"  {line}\n" in levels[2] and line not in levels[1]


def test_selected_fields_keep_their_place(diagnosis: Diagnosis) -> None:
    report = json.loads(to_json(diagnosis, Link("r", "10.42.0.1")))
    assert select_fields(report, ["status", "findings.id", "findings.fix.command", "robot.name"]) == {
        "status": 1,
        "findings": [{"id": "no-server", "fix": {"command": "fix no-server"}}],
        "robot": {"name": "r"},
    }
    assert select_fields({**report, "robot": None}, ["robot.name"]) == {"robot": None}
    assert select_fields(report, ["findings.id", "findings"]) == {"findings": report["findings"]}
    for unknown in ("finding", "findings.name", "status.x"):
        with pytest.raises(UnknownFieldError, match="there is no field"):
            select_fields(report, [unknown])


def test_escape_sequences_are_removed_from_every_report(
    finding: Callable[..., Any], capsys: pytest.CaptureFixture[str]
) -> None:
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
    quoting = replace(finding("x"), evidence=("```", "# not a heading", "````"))
    text = to_markdown(diagnose([Check("x", lambda _e: [quoting])], HEALTHY), "t")
    assert text.count("\n`````\n") == 2


def test_summary_counts_problems_checks_and_gaps(diagnosis: Diagnosis) -> None:
    assert summary(diagnosis) == "1 problem; 4 checks; 3 not observed"
