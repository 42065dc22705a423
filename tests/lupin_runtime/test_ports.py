"""Ports are numbers of one module."""

from __future__ import annotations

import ast

from lupin_runtime import ports
from tests.support.paths import ROOT

NUMBERS = {value for name, value in vars(ports).items() if name.endswith("_PORT")}


def test_port_numbers_are_distinct() -> None:
    assert len(NUMBERS) == len([name for name in vars(ports) if name.endswith("_PORT")])


def test_port_numbers_are_written_in_their_module_only() -> None:
    files = [path for package in ("lupin_cli", "lupin_runtime", "lupin_sim") for path in (ROOT / package).rglob("*.py")]
    found = {
        str(path.relative_to(ROOT))
        for path in files
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and type(node.value) is int and node.value in NUMBERS
    }
    assert found == {"lupin_runtime/ports.py"}
