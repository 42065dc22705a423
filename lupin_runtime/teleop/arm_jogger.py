"""What a pad that moves the arm publishes: rates of the joints while one of its controls is used, zeros before and after.

The zeros before tell the arm's node that the controls were at rest; without them it moves nothing. No pad moves the arm while
one drives: the left shoulder button silences the arm.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from lupin_runtime.teleop.pad_selection import FirstHeld, Pacer
from lupin_runtime.teleop.pad_state import ArmDeflections, PadState

ARM_RADPS = 1.5  # of a joint whose control is used all the way: 0.15 rad at 10 Hz
GRIPPER_RADPS = 0.4


class ArmRates(NamedTuple):
    """Rates in rad/s; the gripper closes with a positive one."""

    pan: float = 0.0
    lift: float = 0.0
    elbow: float = 0.0
    wrist: float = 0.0
    gripper: float = 0.0


AT_REST = ArmRates()


def command_rates(deflections: ArmDeflections) -> ArmRates:
    """Return the rates that the controls command."""
    return ArmRates(
        ARM_RADPS * deflections.pan,
        ARM_RADPS * deflections.lift,
        ARM_RADPS * deflections.elbow,
        ARM_RADPS * deflections.wrist,
        GRIPPER_RADPS * deflections.gripper,
    )


class ArmJogger:
    """Decides what to publish. Of several pads, the one that is used first moves the arm until its controls are at rest."""

    def __init__(self) -> None:
        self._used = FirstHeld()
        self._pacer = Pacer(AT_REST)
        self.rates = AT_REST  # that were published last

    @property
    def jogging(self) -> str | None:
        """The pad that moves the arm."""
        return self._used.selected

    @property
    def delayed(self) -> bool:
        """Whether a change of the rates waits to be published."""
        return self._pacer.delayed

    def step(self, pads: Mapping[str, PadState], driving: str | None, now_ns: int) -> tuple[ArmRates, ...]:
        """Return the rates to publish now, in order. `pads` are the connected ones by name, of which `driving` drives."""
        was_jogging = self.jogging
        used = [name for name, state in pads.items() if command_rates(state.arm) != AT_REST]
        if driving is not None:
            return self._publish(AT_REST) if self._used.refuse(used) else ()
        if self._used.update(used):
            return self._publish(AT_REST)
        if self.jogging is None:
            return ()
        rates = command_rates(pads[self.jogging].arm)
        if was_jogging is None:
            self._pacer.restart()
        if not self._pacer.is_due(rates, now_ns):
            return ()
        return self._publish(rates) if was_jogging else (AT_REST, *self._publish(rates))

    def _publish(self, rates: ArmRates) -> tuple[ArmRates, ...]:
        self.rates = rates
        return (rates,)
