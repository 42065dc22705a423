"""No node replaces an attribute of rclpy's Node: `self._clients = {}` once crashed a whole process."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import pytest

from tests.support.optional import present

pytestmark = pytest.mark.graph

ROOT = Path(__file__).resolve().parents[3]


def assigned(tree: ast.AST) -> set[str]:
    """Return the names X of every `self.X = ...` below a node."""
    names = set()
    for node in ast.walk(tree):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        for target in (item for t in targets for item in (t.elts if isinstance(t, ast.Tuple) else [t])):
            if isinstance(target, ast.Attribute) and isinstance(target.value, ast.Name) and target.value.id == "self":
                names.add(target.attr)
    return names


def test_no_node_assigns_an_attribute_of_rclpy_node() -> None:
    from rclpy.node import Node

    taken = assigned(ast.parse(inspect.getsource(present(inspect.getmodule(Node))))) | {
        n for n in dir(Node) if not n.startswith("__")
    }
    assert "_clients" in taken
    found = []
    for package in ("lupin_runtime", "lupin_sim"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.ClassDef) and any(
                    isinstance(base, ast.Name) and base.id.endswith("Node") for base in node.bases
                ):
                    found += [f"{path.name}:{node.name}.{name}" for name in sorted(assigned(node) & taken)]
    assert found == []
