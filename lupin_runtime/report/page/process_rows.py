"""The rows of the page's process table: start-up time, CPU, memory and restarts of the stack's processes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_COLUMNS = (("up_after_s", "Up after", "s", 1), ("cpu_percent", "CPU", "%", 0), ("memory_mb", "Memory", "MB", 0))


@dataclass(frozen=True)
class Bar:
    """A value with a bar of `share` percent of the table's largest; an empty value is shown as a dash."""

    column: str
    value: str
    share: float = 0.0


@dataclass(frozen=True)
class ProcessTableRow:
    """One process of the stack; `why` explains a state other than running."""

    name: str
    bars: tuple[Bar, ...]
    restarts: int
    why: str


def process_rows(facts: Mapping[str, Any]) -> list[ProcessTableRow]:
    """Return a row for each process among the supervisor's facts."""
    stages = [stage for stage in facts.get("stages") or () if isinstance(stage, Mapping)]
    largest = {key: max([float(stage.get(key) or 0.0) for stage in stages] + [1e-9]) for key, *_ in _COLUMNS}
    return [
        ProcessTableRow(
            str(stage.get("name", "")),
            tuple(_bar(stage.get(key), label, unit, digits, largest[key]) for key, label, unit, digits in _COLUMNS),
            int(stage.get("restarts") or 0),
            str(stage.get("why") or ""),
        )
        for stage in stages
    ]


def _bar(value: Any, label: str, unit: str, digits: int, largest: float) -> Bar:
    if value is None:
        return Bar(label, "")
    return Bar(label, f"{float(value):.{digits}f} {unit}", 100.0 * float(value) / largest)
