"""The manual's table of faults against the code: every check and every finding is there, and every proof exists."""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

import lupin_cli.checks
from bench.triage import CASES
from lupin_cli.checks.drive import INPUTS
from lupin_cli.checks.ports import RESERVED
from lupin_cli.checks.table import built_in
from lupin_cli.runbook import load

PROJECT = Path(__file__).parents[2]
CHECKS = Path(lupin_cli.checks.__file__).parent
FIXES = re.compile(r"(unasked|asks): `([a-z-]+)`|person")


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    check: str
    findings: tuple[str, ...]
    cases: tuple[str, ...]
    tests: tuple[str, ...]
    captured: bool
    fix: str


@cache
def rows() -> tuple[Row, ...]:
    text = (PROJECT / "docs" / "doctor.md").read_text()
    found = []
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 6 and re.fullmatch(r"`[a-z.-]+`", cells[1]):
            words = [tuple(re.findall(r"`([^`]+)`", cell)) for cell in cells]
            tests = tuple(word for word in words[4] if "::" in word)
            found.append(Row(words[1][0], words[2], words[3], tests, cells[4].startswith("captured: "), cells[5]))
    return tuple(found)


def constants(node: ast.AST) -> set[str]:
    return {each.value for each in ast.walk(node) if isinstance(each, ast.Constant) and isinstance(each.value, str)}


def findings_of_the_code() -> set[str]:
    """Every name that a check can give: an `id=`, the first argument of a `_finding`, the first of a yielded pair."""
    found = {id for id, _, _ in INPUTS.values()} | {f"port-{each.port}-taken" for each in RESERVED}
    for path in CHECKS.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.keyword) and node.arg == "id" and isinstance(node.value, ast.Constant):
                found.add(str(node.value.value))
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "_finding" and node.args:
                found |= constants(node.args[0])
            elif path.stem == "profiles" and isinstance(node, ast.Yield) and isinstance(node.value, ast.Tuple):
                found |= constants(node.value.elts[0])
            elif isinstance(node, ast.IfExp) and constants(node) & {"type-mismatch"}:
                found |= constants(node.body) | constants(node.orelse)
    return {name for name in found if re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)+", name)}


def test_every_check_is_in_the_table_and_no_other() -> None:
    assert {row.check for row in rows()} == {check.name for check in built_in()}


def test_every_finding_is_in_the_table_once_for_its_check_and_no_other() -> None:
    named = [finding for row in rows() for finding in row.findings]
    assert sorted(named) == sorted(findings_of_the_code())


@pytest.mark.parametrize("row", rows(), ids=lambda row: row.findings[0])
def test_every_proof_exists(row: Row) -> None:
    assert row.tests
    for place in row.tests:
        path, _, name = place.partition("::")
        tree = ast.parse((PROJECT / path).read_text())
        assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, place


@pytest.mark.parametrize("row", rows(), ids=lambda row: row.findings[0])
def test_what_is_not_made_for_real_is_said_to_be_captured(row: Row) -> None:
    texts = [(PROJECT / place.partition("::")[0]).read_text() for place in row.tests]
    real = any(mark in text for text in texts for mark in ("pytest.mark.host", "pytest.mark.graph", "def sourced("))
    assert row.captured == (not real and not row.cases)


def test_every_fault_of_the_bench_stands_where_its_name_stands() -> None:
    told = {case: set(row.findings) for row in rows() for case in row.cases}
    several = {case for case in told if sum(case in row.cases for row in rows()) > 1}
    assert set(told) == {case.name for case in CASES}
    for case in CASES:
        assert case.name in several or case.expected <= told[case.name], case.name
        assert set(case.hides) <= set(told), case.name


def _module_fixes(tree: ast.Module) -> dict[str, ast.Call]:
    return {
        target.id: node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call)
        for target in node.targets
        if isinstance(target, ast.Name)
    }


def fixes_of_the_code() -> dict[str, tuple[str, bool]]:
    """Finding → playbook (empty: a person) and whether it is played unasked, as far as the text alone tells."""
    found = {}
    for path in CHECKS.glob("*.py"):
        tree = ast.parse(path.read_text())
        known = _module_fixes(tree)
        for node in ast.walk(tree):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Finding"):
                continue
            fields = {keyword.arg: keyword.value for keyword in node.keywords}
            id, fix = fields.get("id"), fields.get("fix")
            if isinstance(fix, ast.Name):
                fix = known.get(fix.id)
            if not (isinstance(id, ast.Constant) and isinstance(fix, ast.Call) and getattr(fix.func, "id", "") == "Fix"):
                continue
            words = {keyword.arg: keyword.value for keyword in fix.keywords}
            playbook, safe = words.get("playbook"), words.get("safe")
            if safe is None or isinstance(safe, ast.Constant):
                name = playbook.value if isinstance(playbook, ast.Constant) else ""
                found[str(id.value)] = (str(name), bool(safe and safe.value))
    return found


def test_what_fix_does_is_what_the_table_says() -> None:
    code = fixes_of_the_code()
    assert len(code) > 35
    for row in rows():
        told = FIXES.fullmatch(row.fix)
        assert told, row.fix
        if told[2]:
            assert load(told[2]).name == told[2]
        for finding in row.findings:
            if finding in code:
                playbook, unasked = code[finding]
                expected = f"{'unasked' if unasked else 'asks'}: `{playbook}`" if playbook else "person"
                assert row.fix == expected or len(row.findings) > 1, finding
