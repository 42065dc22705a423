"""The table of operations and its page."""

from __future__ import annotations

from pathlib import Path

from lupin_cli.operations.table import OPERATIONS, as_markdown

PAGE = Path(__file__).parents[3] / "docs" / "playbooks.md"


def test_page_lists_every_operation() -> None:
    table = as_markdown()
    assert table in PAGE.read_text(), f"put this table into {PAGE.name}:\n{table}"


def test_every_module_of_an_operation_is_in_the_table() -> None:
    folder = PAGE.parents[1] / "lupin_cli" / "operations"
    modules = {path.stem for path in folder.glob("*.py") if "    name: ClassVar[str] =" in path.read_text()}
    assert modules == {name.replace("-", "_") for name in OPERATIONS}
