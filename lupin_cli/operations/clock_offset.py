"""`clock-offset`: how far a robot's wall clock is off this machine's. It changes nothing."""

from __future__ import annotations

from typing import Any, ClassVar

from lupin_cli.operations.base import Difference
from lupin_cli.operations.clock_step import offset
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target


@dataclass(frozen=True, kw_only=True)
class ClockOffset:
    """`offset_s` (positive: ahead) with its `bound_s`; `drifted` where it is surely more than `tolerance_s`."""

    name: ClassVar[str] = "clock-offset"
    read_only: ClassVar[bool] = True
    reports: ClassVar[tuple[str, ...]] = ("offset_s", "bound_s", "drifted")

    tolerance_s: float = 3.0
    machine: str = "robot"

    def differs(self, target: Target) -> Difference | None:
        return None

    def change(self, target: Target, difference: Difference) -> None:
        raise AssertionError("it never differs")

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        raise AssertionError("it never differs")

    def report(self, target: Target) -> dict[str, Any]:
        found = offset(target)
        drifted = found.at_least_s > self.tolerance_s
        return {"offset_s": round(found.offset_s, 3), "bound_s": round(found.bound_s, 3), "drifted": drifted}
