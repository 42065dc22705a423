"""Write the pages that are generated, docs/commands.md and docs/topics.md, and the generated tables of other pages.

    python -m tools.write_docs [--check]

A table stands between two markers; `TABLES` lists each with its page and source. `--check` changes nothing, and exits with 1 if
a page differs from the code.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import typer

from bench.fault_table import CASES
from lupin_cli.app import COMMANDS, app
from lupin_cli.checks.findings import FINDINGS, FindingRow
from lupin_cli.operations.table import OPERATIONS
from lupin_runtime import graph
from lupin_runtime.voice.arguments import Argument, Outside
from lupin_runtime.voice.tools import TOOLS, Gate, Tool
from tests.support.finding_proofs import PROOFS
from tools.known_faults import KNOWN_FAULTS
from tools.nav2_qos import UPSTREAM
from tools.resilience_events import EVENTS

DOCS = Path(__file__).parents[1] / "docs"
FINDINGS_HEADER = ("Symptom", "Layer", "Check", "Finding", "Bench", "Test", "`--fix`")
GENERATED = "This page is generated: `python -m tools.write_docs`."


# -- docs/doctor.md ---------------------------------------------------------------------------------------------------
def faults_by_finding() -> dict[str, list[str]]:
    """Return the faults of `bench.fault_table` that cause each finding, by the finding's id.

    Raises KeyError if a fault's finding has no row, and ValueError if a fault hides an unknown one.
    """
    if unknown := {name for case in CASES for name in case.hides} - {case.name for case in CASES}:
        raise ValueError(f"`hides` in bench.fault_table names unknown faults: {sorted(unknown)}")
    faults: dict[str, list[str]] = {row.id: [] for row in FINDINGS}
    for case in CASES:
        for finding in sorted(case.expected):
            faults[finding].append(case.name)
    return faults


def findings_table() -> str:
    """Return the table of findings in Markdown, with a line for each finding."""
    faults = faults_by_finding()
    rows = []
    for row in FINDINGS:
        bench = ", ".join(f"`{name}`" for name in faults[row.id]) or "–"
        proof = PROOFS[row.id]
        test = f"{'captured: ' if proof.captured else ''}`{proof.test}`" + (f" ({proof.note})" if proof.note else "")
        rows.append((row.symptom, row.path_layer, f"`{row.check}`", f"`{row.id}`", bench, test, _fix(row)))
    return _table(FINDINGS_HEADER, rows)


def _fix(row: FindingRow) -> str:
    fix = "person" if not row.playbook else f"plays `{row.playbook}`" if row.safe else f"asks, then plays `{row.playbook}`"
    return f"{fix}; {row.fix_note}" if row.fix_note else fix


# -- docs/playbooks.md ------------------------------------------------------------------------------------------------
def operations_table() -> str:
    """Return the table of operations in Markdown."""
    rows = [(f"`{name}`", operation.effect, operation.undo_effect) for name, operation in OPERATIONS.items()]
    return _table(("Operation", "What it ensures", "Undo"), rows)


# -- docs/regressions.md ----------------------------------------------------------------------------------------------
def known_faults_tables() -> str:
    """Return the known faults in Markdown, with a heading and a table for each section."""
    parts = []
    for heading, faults in KNOWN_FAULTS.items():
        rows = [
            (str(each.number), each.fault, f"`{each.prevented_in}`", _tests(each.tests))
            if each.tests
            else (str(each.number), each.fault, "–", "not in this release")
            for each in faults
        ]
        parts += [f"## {heading}", _table(("No.", "Fault", "Prevented in", "Tests"), rows)]
    return "\n\n".join(parts)


# -- docs/resilience.md -----------------------------------------------------------------------------------------------
def events_table() -> str:
    """Return the table of events in Markdown."""
    return _table(("Event", "Reaction", "Tests"), [(each.event, each.reaction, _tests(each.tests)) for each in EVENTS])


def _tests(tests: Iterable[str]) -> str:
    return "<br>".join(f"`{test}`" for test in tests)


# -- docs/commands.md -------------------------------------------------------------------------------------------------
def commands_page() -> str:
    """Return the page with every command, its help, arguments and options."""
    group = typer.main.get_command(app)
    context = group.make_context("lupin", ["doctor"], resilient_parsing=True)
    parts = ["# Commands", "", f"{GENERATED} Each text is what `--help` prints.", ""]
    for name in COMMANDS:
        for words, command in _leaves((name,), group.get_command(context, name)):  # type: ignore[attr-defined]
            parts += [f"## `lupin {' '.join(words)}`", "", *_command(command), ""]
    return "\n".join(parts).rstrip() + "\n"


# Any: Typer bundles click privately, so its commands and parameters have no public types.
def _leaves(words: tuple[str, ...], command: Any) -> Iterator[tuple[tuple[str, ...], Any]]:
    subcommands = getattr(command, "commands", None)
    if not subcommands:
        yield words, command
        return
    if command.invoke_without_command:
        yield words, command
    for name, subcommand in subcommands.items():
        yield from _leaves((*words, name), subcommand)


def _command(command: Any) -> Iterator[str]:
    yield "\n".join(line.strip() for line in (command.help or "").split("\f")[0].strip().splitlines())
    parameters = [parameter for parameter in command.params if not getattr(parameter, "hidden", False)]
    rows = [(f"`{_names(parameter)}`", _cell(getattr(parameter, "help", "") or "")) for parameter in parameters]
    if rows:
        yield ""
        yield _table(("Argument or option", ""), rows)


def _names(parameter: Any) -> str:
    if parameter.param_type_name == "argument":
        return str(parameter.name).upper()
    return ", ".join([*parameter.opts, *parameter.secondary_opts])


# -- docs/topics.md ---------------------------------------------------------------------------------------------------
def topics_page() -> str:
    """Return the page with every topic, service and action of the graph."""
    topics = [
        (
            f"`{topic.name}`",
            f"`{topic.type}`",
            _qos(topic.qos),
            "on change" if topic.rate_hz is None else f"{topic.rate_hz:g} Hz",
            ", ".join(topic.publishers) or "–",
            "every message" if topic.recorded_hz == graph.ALL else f"{topic.recorded_hz:g} Hz" if topic.recorded_hz else "–",
            ", ".join(name for name in ("repeats", "probed", "monitored") if getattr(topic, name)) or "–",
            topic.console or "–",
            topic.note,
        )
        for topic in graph.topics()
    ]
    parts = [
        "# Topics, services and actions",
        "",
        f"{GENERATED} Its source is `lupin_runtime/graph.py`.",
        "",
        "*Published by*: processes of the stack, the vendor's software, or `operator`: a console client, a gamepad or RViz.",
        "*Watched*: *repeats* if it is published continuously, so that silence is a fault; *probed* if the doctor waits for a",
        "sample although it may be silent; *monitored* if `lupin up` measures its rate.",
        "*Console*: who may publish the topic, call the service or send a goal through [the console](console.md).",
        "`viewer` means every client, `operator` only the session that has control, – nobody.",
        "",
        "## Topics",
        "",
        _table(("Topic", "Type", "QoS", "Rate", "Published by", "Recorded", "Watched", "Console", "Notes"), topics),
    ]
    for heading, rows in (("Services", graph.services()), ("Actions", graph.actions())):
        table = _table(
            (heading[:-1], "Type", "Console", "Notes"),
            [(f"`{row.name}`", f"`{row.type}`", row.console or "–", row.note) for row in rows],
        )
        parts += ["", f"## {heading}", "", table]
    return "\n".join(parts) + "\n"


def _qos(qos: graph.Qos) -> str:
    words = ["reliable" if qos.reliable else "best effort", *(["latched"] if qos.latched else []), str(qos.depth)]
    return ", ".join(words)


# -- docs/interoperation.md -------------------------------------------------------------------------------------------
def nav2_qos_table() -> str:
    """Return the table of the QoS that Nav2's publishers and Lupin's offer."""
    rows = [
        (
            f"`{row.topic.name}`",
            row.node,
            _qos(row.qos),
            _qos(row.topic.qos),
            row.why_less or ("–" if row.is_matched else "less"),
        )
        for row in UPSTREAM
    ]
    return _table(("Topic", "Published elsewhere by", "Its QoS", "Lupin's", "Why Lupin offers less"), rows)


# -- docs/voice.md ----------------------------------------------------------------------------------------------------
def voice_tools_table() -> str:
    """Return the table of the voice agent's tools in Markdown."""
    rows = [
        (
            f"`{tool.name}`",
            "<br>".join(_argument(argument) for argument in tool.arguments) or "–",
            tool.does,
            tool.effect.value,
            _gate(tool),
            _read_back(tool),
            ", ".join(f"`{field}`" for field in tool.results) or "–",
        )
        for tool in TOOLS
    ]
    return _table(("Tool", "Arguments", "Effect", "Kind", "Gate", "Read back", "Result"), rows)


def _argument(argument: Argument) -> str:
    notes = [argument.expected, *(["required"] if argument.required else [])]
    notes += ["limited to the range"] if argument.outside is Outside.LIMIT else []
    notes += [] if argument.fallback is None else [f"{argument.fallback:g} for what is no number"]
    return f"`{argument.name}`: {'; '.join(notes)}"


def _gate(tool: Tool) -> str:
    gates = [*([] if tool.gate is Gate.NONE else [tool.gate.value]), *(["pose on the map"] if tool.needs_pose else [])]
    return ", ".join(gates) or "–"


def _read_back(tool: Tool) -> str:
    return ", ".join(f"for {action}" if action else "yes" for action in tool.read_back) or "–"


# -- all --------------------------------------------------------------------------------------------------------------
def _table(header: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (header, ("---",) * len(header), *rows))


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


# What stands between the markers of each page that is written by hand otherwise.
TABLES: dict[str, tuple[str, Callable[[], str]]] = {
    "doctor.md": ("findings", findings_table),
    "interoperation.md": ("Nav2's QoS", nav2_qos_table),
    "playbooks.md": ("operations", operations_table),
    "regressions.md": ("known faults", known_faults_tables),
    "resilience.md": ("events", events_table),
    "voice.md": ("tools", voice_tools_table),
}


def insert_table(page: str, name: str, table: str) -> str:
    """Return the page with this table between its markers. Raises ValueError if the page has not exactly one pair of them."""
    begin, end = f"<!-- table of {name}: begin -->", f"<!-- table of {name}: end -->"
    if (page.count(begin), page.count(end)) != (1, 1) or page.index(begin) > page.index(end):
        raise ValueError(f"expected {begin} and then {end}, each once")
    return f"{page[: page.index(begin)]}{begin}\n\n{table}\n\n{page[page.index(end) :]}"


def main() -> int:
    """Write the pages that differ; with `--check`, write nothing and return 1 instead."""
    pages = {
        DOCS / name: insert_table((DOCS / name).read_text(encoding="utf-8"), title, table())
        for name, (title, table) in TABLES.items()
    }
    pages |= {DOCS / "commands.md": commands_page(), DOCS / "topics.md": topics_page()}
    differing = [path for path, text in pages.items() if not path.exists() or path.read_text(encoding="utf-8") != text]
    for path in differing:
        if "--check" in sys.argv:
            print(f"{path.name} differs from the code; write it with: python -m tools.write_docs")
        else:
            path.write_text(pages[path], encoding="utf-8")
    return 1 if differing and "--check" in sys.argv else 0


if __name__ == "__main__":
    sys.exit(main())
