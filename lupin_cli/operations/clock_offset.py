"""`clock-offset`: how far a robot's wall clock is from this machine's. Changes nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Target
from lupin_cli.operations.base import Difference, Operation
from lupin_cli.operations.clock_samples import offset_values, parse_offset, require_plausible_clock, take_samples


@dataclass(frozen=True, kw_only=True)
class ClockOffset(Operation):
    """`drifted` is true if the offset exceeds `tolerance_s` by more than its error bound.

    If it does because this machine's clock is certainly wrong, the step fails: before anything is stopped to set the other.
    """

    name: ClassVar[str] = "clock-offset"
    effect: ClassVar[str] = "read only: how far the robot's clock is from the laptop's"
    read_only: ClassVar[bool] = True
    report_keys: ClassVar[tuple[str, ...]] = ("offset_s", "bound_s", "drifted")

    tolerance_s: float = 3.0

    def probe(self) -> None:
        """Return None: the samples need this machine's clock too, so `complete` takes them."""

    def complete(self, target: Target, output: Output) -> Output:
        return take_samples(target)

    def judge(self, output: Output) -> Difference | None:
        if parse_offset(output).at_least_s > self.tolerance_s:
            require_plausible_clock(output)
        return None

    def report(self, output: Output) -> dict[str, Any]:
        offset = parse_offset(output)
        return {**offset_values(offset), "drifted": offset.at_least_s > self.tolerance_s}
