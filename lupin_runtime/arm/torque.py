"""Switching the arm's torque: which gates, in which order.

Two gates stand between a controller and a joint: the vendor's command gate and the servos' torque. With torque off and the
gate open, the controller goes on writing set-points, and the arm lurches to them when torque returns. So the gate closes
first and opens last, and before it opens the controller is told to want the pose that the arm is in.
"""

from __future__ import annotations

from typing import NamedTuple

from lupin_runtime import graph
from lupin_runtime.graph import Service

# The controller ticks at 10 Hz and interpolates to the pin over 0.1 s: until then it wants something in between.
PIN_SETTLE_S = 0.35


class Step(NamedTuple):
    """A call of `row` with `value`; without a row, a pin of the arm and a wait. `optional`: skipped where the service is
    not there (a simulation without the gate). `reversible`: undone where a later step fails."""

    row: Service | None
    value: bool = False
    optional: bool = False
    reversible: bool = False
    settle_s: float = 0.0

    def undone(self) -> Step | None:
        """The step that takes this one back; None where that would do harm: torque taken off again drops the arm."""
        return self._replace(value=not self.value) if self.reversible else None


_PIN = Step(None, settle_s=PIN_SETTLE_S)


def steps(on: bool) -> tuple[Step, ...]:
    """What switches the torque, in order."""
    if on:
        return (_PIN, Step(graph.VENDOR_TORQUE, True), Step(graph.VENDOR_ARM_GATE, True, optional=True))
    return (Step(graph.VENDOR_ARM_GATE, False, optional=True, reversible=True), Step(graph.VENDOR_TORQUE, False))
