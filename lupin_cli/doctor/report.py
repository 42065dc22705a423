"""A diagnosis as terminal text, JSON, JUnit XML, Markdown, and exit status."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from lupin_cli.checks.base import Finding, Severity
from lupin_cli.doctor.engine import Diagnosis, RootCause
from lupin_cli.exit_codes import FAILURE, NO_RESULT, SUCCESS, UNREACHABLE
from lupin_cli.terminal import printable

if TYPE_CHECKING:
    from lupin_cli.facts.link import Link


def exit_status(diagnosis: Diagnosis, link: Link | None = None) -> int:
    """Return 0 healthy, 1 something needs attention, 3 the robot cannot be reached, 4 not everything could be examined.

    A diagnosis with gaps is never healthy. One with findings needs attention, whether it has gaps or not.
    """
    if link is not None and not link.reachable:
        return UNREACHABLE
    if diagnosis.roots:
        return FAILURE
    return NO_RESULT if diagnosis.check_errors or diagnosis.unknown else SUCCESS


def to_dict(diagnosis: Diagnosis, link: Link | None = None) -> dict[str, Any]:
    """Return the diagnosis as JSON-able data, with the same keys in every version."""
    return {
        "status": exit_status(diagnosis, link),
        "robot": None if link is None else {"name": link.robot, "address": link.address, "unreachable": link.kind or None},
        "findings": [
            {**_finding(root.finding), "consequences": [_finding(finding) for finding in root.consequences]}
            for root in diagnosis.roots
        ],
        "unknown": list(diagnosis.unknown),
        "broken": list(diagnosis.check_errors),
        "checks": list(diagnosis.checks),
    }


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "id": finding.id,
        "severity": finding.severity.value,
        "where": finding.where,
        "symptom": finding.symptom,
        "cause": finding.cause,
        "evidence": list(finding.evidence),
        "fix": {
            "command": finding.fix.command,
            "playbook": finding.fix.playbook or None,
            "variables": finding.fix.variables,
            "safe": finding.fix.safe,
        },
        "explains": sorted(finding.explains),
    }


def to_json(diagnosis: Diagnosis, link: Link | None = None) -> str:
    """Return the diagnosis as one JSON document."""
    return json.dumps(to_dict(diagnosis, link), indent=2)


def to_junit(diagnosis: Diagnosis, name: str = "lupin doctor") -> str:
    """Return the diagnosis as one JUnit test suite: a test case for each check, which fails if the check found something."""
    from xml.etree.ElementTree import Element, SubElement, indent, tostring

    failures = sum(1 for findings in diagnosis.by_check.values() if findings)
    suite = Element("testsuite", name=name, tests=str(len(diagnosis.checks) + len(diagnosis.unknown)))
    suite.set("failures", str(failures))
    suite.set("errors", str(len(diagnosis.check_errors) + len(diagnosis.unknown)))
    for check in diagnosis.checks:
        case = SubElement(suite, "testcase", classname="lupin.doctor", name=check)
        if findings := diagnosis.by_check.get(check):
            failure = SubElement(case, "failure", type=findings[0].id, message=printable(findings[0].cause))
            failure.text = printable("\n\n".join(_plain(finding) for finding in findings))
        elif check not in diagnosis.by_check:
            reason = next((line for line in diagnosis.check_errors if line.startswith(f"check {check}: ")), "did not run")
            SubElement(case, "error", type="check", message=printable(reason))
    for line in diagnosis.unknown:
        case = SubElement(suite, "testcase", classname="lupin.doctor.fact", name=line.split(": ")[1])
        SubElement(case, "error", type="fact", message=printable(line))
    for line in diagnosis.check_errors:
        if not line.startswith("check "):
            case = SubElement(suite, "testcase", classname="lupin.doctor.plugin", name=line.split(" ")[1])
            SubElement(case, "error", type="plug-in", message=printable(line))
            suite.set("tests", str(int(suite.get("tests", "0")) + 1))
    indent(suite)
    return tostring(suite, encoding="unicode")


def to_markdown(diagnosis: Diagnosis, title: str) -> str:
    """Return the diagnosis as Markdown, for an issue or a logbook."""
    lines = [f"# {title}", "", summary(diagnosis), ""]
    for root in diagnosis.roots:
        finding = root.finding
        lines += [f"## {finding.cause}", "", f"`{finding.id}` · {finding.severity.value} · {finding.where}", ""]
        played = " (`--fix` plays it)" if _is_fixed_without_asking(finding) else ""
        lines += [f"- Symptom: {finding.symptom}", f"- Fix: `{finding.fix.command}`{played}"]
        lines += [f"- Explains: {other.cause} (`{other.id}`, {other.where})" for other in root.consequences]
        fence = "`" * max(3, 1 + max((len(run) for line in finding.evidence for run in re.findall("`+", line)), default=0))
        lines += ["", fence, *finding.evidence, fence, ""]
    if gaps := (*diagnosis.unknown, *diagnosis.check_errors):
        lines += ["## Not examined", "", *(f"- {line}" for line in gaps), ""]
    return printable("\n".join(lines))


def summary(diagnosis: Diagnosis) -> str:
    """Return the number of problems, warnings, checks and gaps, in one line."""
    problems = sum(root.finding.severity is Severity.PROBLEM for root in diagnosis.roots)
    warnings = len(diagnosis.roots) - problems
    gaps = len(diagnosis.unknown) + len(diagnosis.check_errors)
    counts = [_count(problems, "problem"), _count(warnings, "warning")]
    found = " and ".join(filter(None, counts)) or ("nothing found" if gaps else "healthy")
    return f"{found}; {_count(len(diagnosis.checks), 'check')}" + (f"; {gaps} not examined" if gaps else "")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}" if number else ""


def _is_fixed_without_asking(finding: Finding) -> bool:
    return finding.fix.safe and bool(finding.fix.playbook)


def _plain(finding: Finding) -> str:
    return "\n".join(
        [
            f"[{finding.id}] {finding.where}: {finding.cause}",
            f"symptom: {finding.symptom}",
            *(f"  | {line}" for line in finding.evidence),
            f"fix: {finding.fix.command}",
        ]
    )


def print_terminal(diagnosis: Diagnosis, *, verbose: bool = False) -> None:
    """Print the diagnosis: one line if healthy, root causes with their evidence otherwise."""
    import sys

    if not sys.stdout.isatty():
        for line in _lines(diagnosis, verbose):
            print(line)
        return
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True)
    for line in _lines(diagnosis, verbose):
        console.print(Text(line, style=_style(line)))


def _lines(diagnosis: Diagnosis, verbose: bool) -> Iterable[str]:
    """Yield every line, made printable: any field may contain text from a robot, such as a process name in a cause."""
    for root in diagnosis.roots:
        yield from (printable(line) for line in _root_lines(root, verbose))
        yield ""
    for line in diagnosis.unknown:
        yield f"? {printable(line)}"
    for line in diagnosis.check_errors:
        yield f"! {printable(line)}"
    yield summary(diagnosis)


def _root_lines(root: RootCause, verbose: bool) -> Iterable[str]:
    finding = root.finding
    mark = "✗" if finding.severity is Severity.PROBLEM else "▲"
    yield f"{mark} {finding.where}: {finding.cause}  [{finding.id}]"
    yield f"  symptom   {finding.symptom}"
    shown = finding.evidence if verbose else finding.evidence[:6]
    for line in shown:
        yield f"  │ {line}"
    if len(shown) < len(finding.evidence):
        yield f"  │ … {len(finding.evidence) - len(shown)} more lines (--verbose)"
    for other in root.consequences:
        yield f"  explains  {other.where}: {other.cause}  [{other.id}]"
    yield f"  fix       {finding.fix.command}" + ("   (--fix plays it)" if _is_fixed_without_asking(finding) else "")


_STYLES = {"✗": "bold red", "▲": "bold yellow", "?": "yellow", "!": "red"}


def _style(line: str) -> str:
    if line[:1] in _STYLES:
        return _STYLES[line[:1]]
    if line.startswith("  │"):
        return "dim"
    if line.startswith("  fix"):
        return "green"
    return "green" if line.startswith("healthy") else ""
