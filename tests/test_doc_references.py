"""What the pages say of tests is true: every test and file that they name exists, and every fault and event has one."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from tests.support.paths import ROOT
from tools.known_faults import KNOWN_FAULTS, KnownFault
from tools.resilience_events import EVENTS, Event

DOCS = ROOT / "docs"
REFERENCE = re.compile(r"`(tests/[\w/]+\.py)(?:::(\w+))?`")
FAULTS = [fault for section in KNOWN_FAULTS.values() for fault in section]


@cache
def names_in(path: Path) -> set[str]:
    """Names of the test functions of a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")}


def missing_tests(references: tuple[str, ...]) -> list[str]:
    """Return the references, each `file::test`, whose file does not exist or lacks the test."""
    split = [reference.partition("::") for reference in references]
    return [f"{file}::{name}" for file, _, name in split if not (ROOT / file).is_file() or name not in names_in(ROOT / file)]


@pytest.mark.parametrize("page", sorted(DOCS.glob("*.md")), ids=lambda page: page.stem)
def test_every_test_that_a_page_names_exists(page: Path) -> None:
    for file, name in REFERENCE.findall(page.read_text(encoding="utf-8")):
        assert (ROOT / file).is_file(), file
        assert not name or name in names_in(ROOT / file), f"{file}::{name}"


def test_known_faults_are_numbered_without_gaps() -> None:
    assert sorted(fault.number for fault in FAULTS) == list(range(1, len(FAULTS) + 1))


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: str(fault.number))
def test_fault_has_a_file_and_tests_or_neither(fault: KnownFault) -> None:
    assert bool(fault.prevented_in) == bool(fault.tests)
    assert not fault.prevented_in or (ROOT / fault.prevented_in).is_file()
    assert missing_tests(fault.tests) == []


@pytest.mark.parametrize("event", EVENTS, ids=lambda event: event.event[:40])
def test_event_has_tests(event: Event) -> None:
    assert event.tests and missing_tests(event.tests) == []
