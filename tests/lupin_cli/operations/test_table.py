"""The table of operations."""

from __future__ import annotations

from lupin_cli.operations.table import OPERATIONS
from tests.support.paths import ROOT

FOLDER = ROOT / "lupin_cli/operations"


def test_every_module_of_an_operation_is_in_the_table() -> None:
    modules = {path.stem for path in FOLDER.glob("*.py") if "    name: ClassVar[str] =" in path.read_text()}
    assert modules == {name.replace("-", "_") for name in OPERATIONS}


def test_every_operation_describes_its_effect() -> None:
    assert all(operation.effect and operation.undo_effect for operation in OPERATIONS.values())
