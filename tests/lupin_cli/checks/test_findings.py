"""The table of findings against the checks, the tests that prove them, and the playbooks."""

from __future__ import annotations

import ast
import importlib
from functools import cache
from pathlib import Path

import pytest

import lupin_cli.checks
from lupin_cli.checks import Severity
from lupin_cli.checks.base import Check
from lupin_cli.checks.findings import FINDINGS, FindingRow, make_finding, modules
from lupin_cli.playbook import load
from tests.support.finding_proofs import PROOFS, Proof
from tests.support.paths import ROOT

FOLDER = Path(lupin_cli.checks.__file__).parent
PARTS = {"path": ("path_ends", "path_losses")}
# One of these is in the file of every test that causes its fault instead of judging captured output.
CAUSING_MARKS = ("pytest.mark.host", "pytest.mark.graph", "def sourced(", "SimulatedBoard(")


def sources(module: str) -> list[Path]:
    """The files of a check module: its own, and those with a part of its functions."""
    return [FOLDER / f"{name}.py" for name in (module, *PARTS.get(module, ()))]


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def constants(node: ast.AST) -> set[str]:
    return {each.value for each in ast.walk(node) if isinstance(each, ast.Constant) and isinstance(each.value, str)}


def named_ids(module: str) -> set[str]:
    """Return the strings of a check module, without those that only say what a finding explains."""
    found: set[str] = set()
    pending: list[ast.AST] = [tree_of(path) for path in sources(module)]
    while pending:
        node = pending.pop()
        if isinstance(node, ast.keyword) and node.arg == "explains":
            continue
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
        pending += ast.iter_child_nodes(node)
    return found


def test_every_check_has_a_row_in_its_module_and_no_other() -> None:
    table: dict[str, set[str]] = {}
    for row in FINDINGS:
        table.setdefault(f"lupin_cli.checks.{row.module}", set()).add(row.check)
    checks: dict[str, tuple[Check, ...]] = {module: importlib.import_module(module).CHECKS for module in modules()}
    assert table == {module: {check.name for check in each} for module, each in checks.items()}


def test_every_module_with_checks_is_in_the_table() -> None:
    with_checks = {path.stem for path in FOLDER.glob("*.py") if "\nCHECKS = (" in path.read_text(encoding="utf-8")}
    assert with_checks == {row.module for row in FINDINGS}


def test_finding_ids_are_unique() -> None:
    ids = [row.id for row in FINDINGS]
    assert len(set(ids)) == len(ids)


@pytest.mark.parametrize("row", FINDINGS, ids=lambda row: row.id)
def test_module_of_a_row_names_its_finding(row: FindingRow) -> None:
    assert row.id in named_ids(row.module)


@pytest.mark.parametrize("module", sorted({row.module for row in FINDINGS}))
def test_checks_build_only_findings_with_a_row(module: str) -> None:
    ids = {row.id for row in FINDINGS if row.module == module}
    calls = [node for path in sources(module) for node in ast.walk(tree_of(path)) if isinstance(node, ast.Call)]
    names = {call.func.id for call in calls if isinstance(call.func, ast.Name)}
    assert "make_finding" in names and "Finding" not in names
    for call in calls:
        if isinstance(call.func, ast.Name) and call.func.id == "make_finding":
            assert constants(call.args[0]) <= ids, ast.unparse(call.args[0])


def test_every_finding_has_a_proof() -> None:
    assert list(PROOFS) == [row.id for row in FINDINGS]


@pytest.mark.parametrize("proof", PROOFS.values(), ids=PROOFS)
def test_proof_of_a_finding_exists(proof: Proof) -> None:
    path, _, name = proof.test.partition("::")
    assert name in {node.name for node in tree_of(ROOT / path).body if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize("proof", PROOFS.values(), ids=PROOFS)
def test_proof_is_captured_or_causes_the_fault(proof: Proof) -> None:
    text = (ROOT / proof.test.partition("::")[0]).read_text(encoding="utf-8")
    assert proof.captured == (not any(mark in text for mark in CAUSING_MARKS))


def test_every_playbook_of_a_finding_exists() -> None:
    named = {row.playbook for row in FINDINGS}
    for path in FOLDER.glob("*.py"):
        named |= {word for node in ast.walk(tree_of(path)) if is_playbook(node) for word in constants(node)}
    for name in named - {""}:
        assert load(name).name == name


def is_playbook(node: ast.AST) -> bool:
    return isinstance(node, ast.keyword) and node.arg == "playbook"


def test_only_rows_with_a_playbook_are_safe() -> None:
    assert all(row.playbook for row in FINDINGS if row.safe)


def test_finding_takes_severity_symptom_and_fix_from_its_row() -> None:
    finding = make_finding("wifi-may-roam", where="laptop", cause="c", evidence=["line"], command="nmcli")
    assert (finding.severity, finding.symptom[:14]) == (Severity.WARNING, "the link drops")
    assert (finding.fix.playbook, finding.fix.safe) == ("pin-wifi", True)
    asked = make_finding("wifi-may-roam", where="laptop", cause="c", evidence=["line"], command="nmcli", safe=False)
    assert (asked.fix.playbook, asked.fix.safe) == ("pin-wifi", False)


def test_finding_without_playbook_is_never_safe() -> None:
    finding = make_finding("unit-failed", where="robot", cause="c", evidence=["line"], command="systemctl", playbook="")
    assert (finding.fix.playbook, finding.fix.safe) == ("", False)


def test_finding_without_row_is_rejected() -> None:
    with pytest.raises(KeyError, match="no-such-finding"):
        make_finding("no-such-finding", where="robot", cause="c", evidence=["line"], command="x")
