"""What tests of the command line leave behind in this process."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from lupin_cli.printed_commands import repeat_inventory


@pytest.fixture(autouse=True)
def no_inventory_of_another_test() -> Iterator[None]:
    """Forget the --config of the commands that a test has run: a person's next command is a new process."""
    yield
    repeat_inventory(None)
