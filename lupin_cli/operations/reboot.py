"""`reboot`: reboot the robot and wait until it is back."""

from __future__ import annotations

import contextlib
import re
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Script, Target, TargetError
from lupin_cli.operations.base import Difference, Operation, OperationError, probe_script
from lupin_cli.operations.shell import observe, text_of

_PAUSE_S = 0.5
_BOOT_ID = re.compile(r"[0-9a-f-]{36}\Z")


@dataclass(frozen=True, kw_only=True)
class Reboot(Operation):
    """Finds a difference until the robot has rebooted in this step; the step's `when` says whether that is needed.

    `back_within_s` limits the wait for its return; the step's `timeout` must not be shorter. Undo does nothing: the undo of
    other steps restores what they changed, and takes effect at the next reboot.
    """

    name: ClassVar[str] = "reboot"
    effect: ClassVar[str] = "the robot was rebooted in this step and is reachable again"

    back_within_s: float = 120.0
    _boot_before: str = ""  # the boot id when the step began

    def __post_init__(self) -> None:
        if self.machine == "laptop":
            raise ValueError("it reboots the robot; the laptop runs the playbook")

    def with_baseline(self, before: Mapping[str, Any]) -> Reboot:
        return replace(self, _boot_before=before["boot_id"])

    def probe(self) -> Script:
        return probe_script("cat /proc/sys/kernel/random/boot_id")

    def _boot_id(self, output: Output) -> str:
        boot_id = text_of(output, "the boot id").strip()
        if not _BOOT_ID.match(boot_id):
            raise OperationError(f"could not read the boot id: found {boot_id[:80]!r}", "lupin doctor")
        return boot_id

    def judge(self, output: Output) -> Difference | None:
        boot_id = self._boot_id(output)
        if self._boot_before and boot_id != self._boot_before:
            return None
        return Difference("reboot the robot", "", {"boot_id": boot_id})

    def change(self, target: Target, difference: Difference) -> None:
        old = difference.before["boot_id"]
        with contextlib.suppress(TargetError):  # the reboot closes the connection, sometimes before the command has returned
            target.run("sync; systemctl reboot", root=True, timeout_s=15.0)
        deadline = time.monotonic() + self.back_within_s
        while True:
            target.close()
            try:
                if self._boot_id(observe(self, target)) != old:
                    return
                reason = f"{target.name} is still up"
            except (TargetError, OperationError) as error:
                reason = str(error)
            if time.monotonic() + _PAUSE_S > deadline:
                raise OperationError(
                    f"{target.name} did not come back within {self.back_within_s:g} s: {reason}", "lupin doctor"
                )
            time.sleep(_PAUSE_S)
