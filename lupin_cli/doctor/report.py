"""A diagnosis as terminal text, JSON, JUnit XML, Markdown, and exit status."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from lupin_cli.checks.base import Finding, Severity
from lupin_cli.checks.ground_truth import GroundTruth, State
from lupin_cli.checks.layers import LAYERS
from lupin_cli.doctor.areas import FAILED, OK, UNKNOWN, WARNED
from lupin_cli.doctor.engine import Diagnosis, RootCause
from lupin_cli.exit_codes import FAILURE, NO_RESULT, SUCCESS, UNREACHABLE
from lupin_cli.terminal import echo, printable, wrapped

if TYPE_CHECKING:
    from lupin_cli.facts.link import Link

_LABEL = re.compile(r" +(?:│ |[a-z-]+ {2,})")  # of a line of evidence, or of a field of a finding
ALL_DETAILS = 2  # the level of `--verbose` from which nothing is left out


def exit_status(diagnosis: Diagnosis, link: Link | None = None) -> int:
    """Return 0 healthy, 1 something needs attention, 3 the robot cannot be reached, 4 not everything could be examined.

    A diagnosis with gaps is never healthy. One with findings needs attention, whether it has gaps or not.
    """
    if link is not None and not link.reachable:
        return UNREACHABLE
    if diagnosis.roots or (diagnosis.ground_truth is not None and diagnosis.ground_truth.state is State.BROKEN):
        return FAILURE
    return NO_RESULT if diagnosis.gaps else SUCCESS


def to_dict(diagnosis: Diagnosis, link: Link | None = None) -> dict[str, Any]:
    """Return the diagnosis as JSON-able data, with the same keys in every version."""
    return {
        "status": exit_status(diagnosis, link),
        "robot": None if link is None else {"name": link.robot, "address": link.address, "unreachable": link.kind or None},
        "findings": [
            {**_finding(root.finding), "consequences": [_finding(finding) for finding in root.consequences]}
            for root in diagnosis.roots
        ],
        "ground_truth": None if diagnosis.ground_truth is None else _ground_truth(diagnosis.ground_truth),
        "layers": _layers(diagnosis),
        "unknown": list(map(str, diagnosis.unknown)),
        "broken": list(map(str, diagnosis.check_errors)),
        "checks": list(diagnosis.checks),
    }


class UnknownFieldError(ValueError):
    """A report has no such field."""


def select_fields(report: Mapping[str, Any], fields: Sequence[str]) -> dict[str, Any]:
    """Return only these fields of a report; `findings.id` is the field `id` of each finding. Raises UnknownFieldError."""
    selected: dict[str, Any] = {}
    wanted: dict[str, list[str]] = {}
    for field in fields:
        name, _, rest = field.partition(".")
        wanted.setdefault(name, []).append(rest)
    for name, inner in wanted.items():
        if name not in report:
            raise UnknownFieldError(f"there is no field {name!r} in {', '.join(report)}")
        value = report[name]
        if "" not in inner and isinstance(value, list):
            value = [select_fields(each, inner) for each in value]
        elif "" not in inner and value is not None:
            value = select_fields(value if isinstance(value, Mapping) else {}, inner)
        selected[name] = value
    return selected


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "id": finding.id,
        "severity": finding.severity.value,
        "where": finding.where,
        "layer": finding.layer,
        "machine": finding.where,
        "symptom": finding.symptom,
        "cause": finding.cause,
        "evidence": list(finding.evidence),
        "fix": {
            "instruction": finding.fix.instruction,
            "command": finding.fix.command,
            "playbook": finding.fix.playbook or None,
            "variables": finding.fix.variables,
            "safe": finding.fix.safe,
        },
        "explains": sorted(finding.explains),
    }


def _ground_truth(truth: GroundTruth) -> dict[str, Any]:
    return {
        "state": truth.state.value,
        "machine": "laptop",
        "graph": truth.graph,
        "environment": dict(truth.environment),
        "topics": [vars(topic) for topic in truth.topics],
        "services": [{"name": name, "round_trip_s": round_trip_s} for name, round_trip_s in truth.services],
        "drive": truth.drive,
        "missing_nodes": list(truth.missing_nodes),
        "lost": {part: list(lines) for part, lines in truth.losses.items()},
        "unobserved": list(truth.unobserved),
    }


def _layers(diagnosis: Diagnosis) -> list[dict[str, str]]:
    """Return the layers in which a problem was found, lowest first, and what is a consequence."""
    causes = {root.finding.layer: root.finding.cause for root in diagnosis.roots if root.finding.severity is Severity.PROBLEM}
    return [{"layer": layer, "state": "failed", "detail": causes[layer]} for layer in LAYERS if layer in causes]


def to_json(diagnosis: Diagnosis, link: Link | None = None) -> str:
    """Return the diagnosis as one JSON document."""
    return json.dumps(to_dict(diagnosis, link), indent=2)


def to_junit(diagnosis: Diagnosis, name: str = "lupin doctor") -> str:
    """Return the diagnosis as one JUnit test suite: a test case for each check, which fails if the check found something."""
    from xml.etree.ElementTree import Element, SubElement, indent, tostring

    failures = sum(1 for findings in diagnosis.by_check.values() if findings)
    suite = Element("testsuite", name=name, tests=str(len(diagnosis.checks) + len(diagnosis.unknown)))
    suite.set("failures", str(failures))
    suite.set("errors", str(len(diagnosis.gaps)))
    for check in diagnosis.checks:
        case = SubElement(suite, "testcase", classname="lupin.doctor", name=check)
        if findings := diagnosis.by_check.get(check):
            failure = SubElement(case, "failure", type=findings[0].id, message=printable(findings[0].cause))
            failure.text = printable("\n\n".join(_plain(finding) for finding in findings))
        elif check not in diagnosis.by_check:
            reasons = [str(gap) for gap in diagnosis.check_errors if (gap.kind, gap.name) == ("check", check)]
            SubElement(case, "error", type="check", message=printable(next(iter(reasons), "did not run")))
    for gap in diagnosis.unknown:
        case = SubElement(suite, "testcase", classname="lupin.doctor.fact", name=gap.name)
        SubElement(case, "error", type="fact", message=printable(str(gap)))
    if (truth := diagnosis.ground_truth) is not None:
        for line in truth.unobserved:
            case = SubElement(suite, "testcase", classname="lupin.doctor.ground-truth", name=line.partition(":")[0])
            SubElement(case, "error", type="unobserved", message=printable(line))
            suite.set("tests", str(int(suite.get("tests", "0")) + 1))
    for gap in diagnosis.check_errors:
        if gap.kind == "plug-in":
            case = SubElement(suite, "testcase", classname="lupin.doctor.plugin", name=printable(gap.name))
            SubElement(case, "error", type="plug-in", message=printable(str(gap)))
            suite.set("tests", str(int(suite.get("tests", "0")) + 1))
    indent(suite)
    return tostring(suite, encoding="unicode")


def to_markdown(diagnosis: Diagnosis, title: str) -> str:
    """Return the diagnosis as Markdown, for an issue or a logbook."""
    lines = [f"# {title}", "", summary(diagnosis), ""]
    for root in diagnosis.roots:
        finding = root.finding
        lines += [f"## {finding.cause}", "", f"`{finding.id}` · {finding.severity.value} · {finding.where}", ""]
        lines += [f"- Symptom: {finding.symptom}"]
        lines += [f"- To do: {finding.fix.instruction}"] if finding.fix.instruction else []
        lines += [f"- Fix: `{finding.fix.command}`"] if finding.fix.command else []
        lines += [f"- `lupin doctor --fix` {_playing(finding)}"] if finding.fix.playbook else []
        lines += [f"- Explains: {other.cause} (`{other.id}`, {other.where})" for other in root.consequences]
        fence = "`" * max(3, 1 + max((len(run) for line in finding.evidence for run in re.findall("`+", line)), default=0))
        lines += ["", fence, *finding.evidence, fence, ""]
    if diagnosis.gaps:
        lines += ["## Not observed", "", *(f"- {line}" for line in diagnosis.gaps), ""]
    return printable("\n".join(lines))


TRANSPORTS = {"wired": "cable", "router": "router", "ap": "access point"}


def describe_subject(link: Link | None) -> str:
    """Return what was examined: the robot with transport and address, or this machine."""
    if link is None:
        return "this machine"
    transport = f" over {TRANSPORTS[link.transport]}" if link.transport in TRANSPORTS else ""
    return f"{link.robot}{transport}" + (f" ({link.address})" if link.address not in ("", link.robot) else "")


def verdict(diagnosis: Diagnosis, link: Link | None = None) -> str:
    """Return the result in one sentence that names its subject."""
    truth = diagnosis.ground_truth
    return f"{describe_subject(link)}: {_health(diagnosis)}, {_delivery(truth)}"


def _health(diagnosis: Diagnosis) -> str:
    if diagnosis.healthy:
        return "healthy"
    broken = diagnosis.ground_truth is not None and diagnosis.ground_truth.state is State.BROKEN
    if broken or any(root.finding.severity is Severity.PROBLEM for root in diagnosis.roots):
        return "not healthy"
    return "needs attention" if diagnosis.roots else "nothing found"


def _delivery(truth: GroundTruth | None) -> str:
    if truth is None:
        return "topics were not measured"
    if not truth.graph:
        return "no ROS graph was measured"
    if not truth.heard:
        return "no topic delivers samples to this machine"
    if truth.state is State.BROKEN:
        heard = sum(topic.required and topic.samples > 0 for topic in truth.topics)
        return f"{heard} of {truth.required} required topics deliver samples to this machine"
    return f"{truth.heard} topics with samples"


def summary(diagnosis: Diagnosis) -> str:
    """Return the number of problems, warnings, checks and gaps, in one line."""
    problems = sum(root.finding.severity is Severity.PROBLEM for root in diagnosis.roots)
    warnings = len(diagnosis.roots) - problems
    counts = [_count(problems, "problem"), _count(warnings, "warning")]
    found = " and ".join(filter(None, counts)) or ("healthy" if diagnosis.healthy else "nothing found")
    gaps = len(diagnosis.gaps)
    return f"{found}; {_count(len(diagnosis.checks), 'check')}" + (f"; {gaps} not observed" if gaps else "")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}" if number else ""


def _playing(finding: Finding) -> str:
    """Return what `--fix` does for a finding that has a playbook."""
    return f"plays {finding.fix.playbook}" if finding.fix.safe else f"asks, then plays {finding.fix.playbook}"


def _plain(finding: Finding) -> str:
    return "\n".join(
        [
            f"[{finding.id}] {finding.where}: {finding.cause}",
            f"symptom: {finding.symptom}",
            *(f"  | {line}" for line in finding.evidence),
            *([f"do: {finding.fix.instruction}"] if finding.fix.instruction else []),
            *([f"fix: {finding.fix.command}"] if finding.fix.command else []),
        ]
    )


def print_terminal(diagnosis: Diagnosis, link: Link | None = None, *, verbose: int = 0) -> None:
    """Print the diagnosis: the verdict, then root causes with their evidence, and what was not observed.

    verbose: 1 adds all lines of evidence and the topics, 2 the evidence of consequences and the result of each check.
    """
    import sys

    lines = (replace(line, text=printable(line.text)) for line in _lines(diagnosis, link, verbose))
    if not sys.stdout.isatty():
        for line in lines:
            echo(line.text)
        return
    from rich.text import Text

    from lupin_cli.safe_console import SafeConsole

    console = SafeConsole(soft_wrap=True)
    columns = shutil.get_terminal_size().columns
    for line in lines:
        console.print(Text(line.text if line.pasted else wrapped(line.text, columns, _LABEL), style=line.style))


@dataclass(frozen=True)
class Line:
    """A line of the report and its style. A `pasted` one is never broken: the break would be pasted, too."""

    text: str
    style: str = ""
    pasted: bool = False


_BLANK = Line("")


def _lines(diagnosis: Diagnosis, link: Link | None, verbose: int) -> Iterable[Line]:
    """Yield every line. Any may contain text from a robot, such as the name of a process in a cause."""
    yield Line(verdict(diagnosis, link), "green" if diagnosis.healthy else "")
    if diagnosis.areas:
        yield _BLANK
        yield from (Line(area.line(), _STYLES.get(area.mark, "")) for area in diagnosis.areas)
    for root in diagnosis.roots:
        yield _BLANK
        yield from _root_lines(root, verbose)
    if diagnosis.gaps:
        yield _BLANK
        yield Line("Not observed")
        yield from (Line(f"{UNKNOWN} {gap}", _STYLES[UNKNOWN]) for gap in diagnosis.gaps)
    if verbose and diagnosis.ground_truth is not None:
        yield _BLANK
        yield Line("Topics as they arrive here")
        yield from (Line(f"  {topic.line()}") for topic in diagnosis.ground_truth.topics)
    if verbose >= ALL_DETAILS:
        yield _BLANK
        yield Line(f"Checks, which took {diagnosis.duration_s * 1e3:.0f} ms")
        yield from (Line(f"  {_check_line(diagnosis, check)}") for check in diagnosis.checks)
    if diagnosis.roots or diagnosis.gaps:
        yield _BLANK
        yield Line(summary(diagnosis))


def _check_line(diagnosis: Diagnosis, check: str) -> str:
    found = diagnosis.by_check.get(check)
    if found is None:
        return f"{check}: failed"
    return f"{check}: {', '.join(dict.fromkeys(finding.id for finding in found)) or 'nothing found'}"


def _root_lines(root: RootCause, verbose: int) -> Iterable[Line]:
    finding = root.finding
    mark = FAILED if finding.severity is Severity.PROBLEM else WARNED
    yield Line(f"{mark} {finding.where}: {finding.cause}  [{finding.id}]", _STYLES[mark])
    yield Line(f"  symptom   {finding.symptom}")
    shown = finding.evidence if verbose else finding.evidence[:6]
    for line in shown:
        yield Line(f"  │ {line}", "dim")
    if len(shown) < len(finding.evidence):
        yield Line(f"  │ … {len(finding.evidence) - len(shown)} more lines (--verbose)", "dim")
    for other in root.consequences:
        yield Line(f"  explains  {other.where}: {other.cause}  [{other.id}]")
        yield from (Line(f"            │ {line}", "dim") for line in other.evidence if verbose >= ALL_DETAILS)
    if finding.fix.instruction:
        yield Line(f"  do        {finding.fix.instruction}")
    if finding.fix.command:
        yield Line(f"  fix       {finding.fix.command}", "green", pasted=True)
    if finding.fix.playbook:
        yield Line(f"  --fix     {_playing(finding)}")


_STYLES = {FAILED: "bold red", WARNED: "bold yellow", UNKNOWN: "yellow", OK: "green"}
