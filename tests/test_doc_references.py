"""Pages that say which test holds a promise say nothing that is not so: tests and files exist, and nothing is left out."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
REFERENCE = re.compile(r"`(tests/[\w/]+\.py)(?:::(\w+))?`")
FAULTS = 67
ABSENT = "not in this release"
FAULT = re.compile(r"^\| (?P<number>\d+) \| (?P<fault>[^|]+) \| (?P<file>[^|]+) \| (?P<held>[^|]+) \|$", re.MULTILINE)
# What a robot, its link and its operators do to Lupin: a line each in docs/resilience.md, in this order.
SURVIVED = (
    "The link is cut", "The robot reboots", "accepts and never answers", "half open", "One robot of several",
    "wrong key", "changed key", "wrong user", "sudo", "full disk", "read-only file system", "no python3",
    "clock stepped back", "stack is stopped", "last login", "no chrony", "100 MB",
    "languages, time zones", "login shell", "Two operators", "SIGKILL",
)  # fmt: skip


@cache
def names_in(path: Path) -> set[str]:
    """Names of the test functions of a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")}


def faults() -> list[re.Match[str]]:
    return list(FAULT.finditer((DOCS / "regressions.md").read_text(encoding="utf-8")))


@pytest.mark.parametrize("page", sorted(DOCS.glob("*.md")), ids=lambda page: page.stem)
def test_every_test_that_a_page_names_exists(page: Path) -> None:
    for file, name in REFERENCE.findall(page.read_text(encoding="utf-8")):
        assert (ROOT / file).is_file(), file
        assert not name or name in names_in(ROOT / file), f"{file}::{name}"


def test_every_fault_is_on_its_page_once() -> None:
    assert sorted(int(row["number"]) for row in faults()) == list(range(1, FAULTS + 1))


@pytest.mark.parametrize("row", faults(), ids=lambda row: row["number"])
def test_a_fault_names_a_file_and_a_test_or_says_why_not(row: re.Match[str]) -> None:
    if row["held"] == ABSENT:
        assert row["file"] == "–"
        return
    assert (ROOT / row["file"].strip("`")).is_file()
    assert all(name for _, name in REFERENCE.findall(row["held"]))
    assert len(REFERENCE.findall(row["held"])) == len(row["held"].split("<br>"))


def test_everything_that_is_to_be_survived_is_on_its_page_with_a_test() -> None:
    rows = re.findall(
        r"^\| (?!-|Event)(.+?) \|.+\| (.+?) \|$", (DOCS / "resilience.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert len(rows) == len(SURVIVED)
    for (what, held), word in zip(rows, SURVIVED):
        assert word.lower() in what.lower()
        assert all(name for _, name in REFERENCE.findall(held)) and REFERENCE.findall(held), what
