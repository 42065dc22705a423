"""`reboot`: the robot starts anew, and is there again."""

from __future__ import annotations

import contextlib
import time
from dataclasses import replace
from typing import Any, ClassVar

from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.operations.shell import look
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Target, TargetError

_PAUSE_S = 0.5


@dataclass(frozen=True, kw_only=True)
class Reboot:
    """Always differs until the robot has been started anew since this step began: its `when` says whether it is needed.

    `back_within_s` bounds the wait for its return; the step's `timeout` must not be shorter.
    """

    name: ClassVar[str] = "reboot"

    back_within_s: float = 120.0
    machine: str = "robot"
    _old: str = ""  # the boot in which the step began

    def __post_init__(self) -> None:
        if self.machine == "laptop":
            raise ValueError("the laptop is not rebooted under the one who plays")

    def begun(self, before: dict[str, Any]) -> Reboot:
        return replace(self, _old=before["boot_id"])

    def _boot(self, target: Target) -> str:
        output = look(target, "cat /proc/sys/kernel/random/boot_id")
        if not output.ok or not output.stdout.strip():
            raise OperationError(f"{target.name} did not tell which boot this is: {output.stderr.strip()}")
        return output.stdout.strip()

    def differs(self, target: Target) -> Difference | None:
        boot_id = self._boot(target)
        if self._old and boot_id != self._old:
            return None
        return Difference(f"{target.name} is rebooted", "", {"boot_id": boot_id})

    def change(self, target: Target, difference: Difference) -> None:
        old = difference.before["boot_id"]
        with contextlib.suppress(TargetError):  # it takes the connection down with it, sometimes before it has answered
            target.run("sync; systemctl reboot", root=True, bound_s=15.0)
        deadline = time.monotonic() + self.back_within_s
        while True:
            target.close()
            try:
                if self._boot(target) != old:
                    return
                seen = f"{target.name} is still up"
            except (TargetError, OperationError) as error:
                seen = str(error)
            if time.monotonic() + _PAUSE_S > deadline:
                raise OperationError(f"{target.name} did not come back within {self.back_within_s:g} s: {seen}", "lupin doctor")
            time.sleep(_PAUSE_S)

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        """Nothing: what the boot brought about is taken back by the steps before it, and another boot."""
