"""Every operation that a step of a playbook may name: each module of this package with such a class adds it by itself."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from pathlib import Path

from lupin_cli.operations.base import Operation


def _operations() -> Iterator[type[Operation]]:
    for module in pkgutil.iter_modules([str(Path(__file__).parent)], "lupin_cli.operations."):
        for value in vars(importlib.import_module(module.name)).values():
            if isinstance(value, type) and issubclass(value, Operation) and "name" in vars(value):
                yield value


# In the order of docs/playbooks.md: first those that change something, each part by name.
OPERATIONS: dict[str, type[Operation]] = {
    operation.name: operation for operation in sorted(_operations(), key=lambda each: (each.read_only, each.name))
}
