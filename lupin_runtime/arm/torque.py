"""The sequence of calls that switches the arm's torque.

A command passes two switches: the vendor's command gate and the servos' torque. With torque off and the gate open the
controller continues to write set-points, and the arm jumps to them when the torque returns. Therefore the gate closes first and
opens last, and before it opens, the controller's set-point is replaced by the arm's present pose.
"""

from __future__ import annotations

from typing import NamedTuple

from lupin_runtime import graph
from lupin_runtime.graph import Service

# The controller runs at 10 Hz and interpolates to the held pose over 0.1 s.
PIN_SETTLE_S = 0.35


class TorqueStep(NamedTuple):
    """A call of the service `row` with `value`; without a row, the arm's pose is held for `settle_s`.

    `optional`: skipped if the service has no server (a simulation without the gate). `reversible`: undone if a later step
    fails.
    """

    row: Service | None
    value: bool = False
    optional: bool = False
    reversible: bool = False
    settle_s: float = 0.0

    def undone(self) -> TorqueStep | None:
        """Return the step that undoes this one; None if undoing would do harm: switching the torque off drops the arm."""
        return self._replace(value=not self.value) if self.reversible else None


HOLD = TorqueStep(None, settle_s=PIN_SETTLE_S)
TORQUE_OFF = TorqueStep(graph.VENDOR_TORQUE, False)


def steps(on: bool) -> tuple[TorqueStep, ...]:
    """Return the steps that switch the torque, in order."""
    if on:
        return (HOLD, TorqueStep(graph.VENDOR_TORQUE, True), TorqueStep(graph.VENDOR_ARM_GATE, True, optional=True))
    return (TorqueStep(graph.VENDOR_ARM_GATE, False, optional=True, reversible=True), TORQUE_OFF)
