"""The page of known faults says nothing that is not so: its files and tests exist, and no fault is left out."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "faults.md"
FAULTS = 67
ABSENT = "not in this release"
ROW = re.compile(r"^\| (?P<number>\d+) \| (?P<fault>[^|]+) \| (?P<file>[^|]+) \| (?P<held>[^|]+) \|$", re.MULTILINE)


def rows() -> list[re.Match[str]]:
    return list(ROW.finditer(PAGE.read_text(encoding="utf-8")))


def names_in(path: Path) -> set[str]:
    """Names of the test functions of a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")}


def test_every_fault_is_on_the_page_once() -> None:
    assert sorted(int(row["number"]) for row in rows()) == list(range(1, FAULTS + 1))


@pytest.mark.parametrize("row", rows(), ids=lambda row: row["number"])
def test_a_row_names_a_file_and_tests_that_exist_or_says_why_not(row: re.Match[str]) -> None:
    if row["held"] == ABSENT:
        assert row["file"] == "–"
        return
    assert (ROOT / row["file"].strip("`")).is_file()
    for reference in row["held"].split("<br>"):
        file, _, name = reference.strip("`").partition("::")
        assert (ROOT / file).is_file(), file
        assert name in names_in(ROOT / file), reference
