"""Conventions: names of tests are short, folders of tests mirror the packages, and a suppressed lint has a reason."""

from __future__ import annotations

import ast
import re

from tests.support.paths import ROOT

PACKAGES = ("lupin_cli", "lupin_runtime", "lupin_sim")
MAX_LENGTH = 60


def test_names_of_tests_are_at_most_60_characters() -> None:
    too_long = [
        f"{path.relative_to(ROOT)}::{node.name}"
        for path in (ROOT / "tests").rglob("test_*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and len(node.name) > MAX_LENGTH
        if node.name.startswith("test_")
    ]
    assert too_long == []


def test_every_package_has_a_folder_of_tests() -> None:
    folders = {path.parent.relative_to(ROOT) for name in PACKAGES for path in (ROOT / name).rglob("__init__.py")}
    assert {folder for folder in folders if not list((ROOT / "tests" / folder).glob("test_*.py"))} == set()


def test_every_folder_of_tests_mirrors_a_package() -> None:
    folders = {
        path.parent.relative_to(ROOT / "tests") for name in PACKAGES for path in (ROOT / "tests" / name).rglob("test_*.py")
    }
    assert {folder for folder in folders if not (ROOT / folder / "__init__.py").is_file()} == set()


def test_every_suppressed_lint_has_a_reason() -> None:
    folders = (*PACKAGES, "tests", "tools", "bench", "interfaces/rosidl_build")
    bare = [
        f"{path.relative_to(ROOT)}:{number}"
        for folder in folders
        for path in (ROOT / folder).rglob("*.py")
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if re.search(r"# (ruff: )?noqa(: [A-Z0-9, ]+)?$", line)
    ]
    assert bare == []
