"""`clock-step`: the target's wall clock, set from this machine's in one step - with nothing there that watches it."""

from __future__ import annotations

import time
from typing import Any, ClassVar

from lupin_cli.clock import ClockError, Sample, estimate, read_answer
from lupin_cli.facts.clock import Offset
from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.operations.shell import change, look, read
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Script, Target

LIVE_STACK = 43

# A step under ros2_control kills it: everything expires in one tick and the wheels go dead. It is looked for by the service
# that starts it and by its libraries in any process, whoever started that. A discovery server may stay: it keeps no wall time.
_GUARD = r"""
state=$(systemctl show -p ActiveState --value mirte-ros.service 2>/dev/null)
case $state in inactive | failed | '') ;; *) echo "mirte-ros.service is $state"; exit 43 ;; esac
for d in /proc/[0-9]*; do
  grep -qsE 'lib(rcl|rclcpp|controller_manager|hardware_interface)\.so' "$d/maps" || continue
  echo "process ${d#/proc/} ($(cat "$d/comm" 2>/dev/null)) is part of a ROS stack"; exit 43
done
"""


@dataclass(frozen=True, kw_only=True)
class ClockStep:
    """Within `tolerance_s` of this machine's clock; nothing is done where it is. Refuses while the stack runs, by any path.

    A clock isn't set back by undo: the wrong time is nobody's.
    """

    name: ClassVar[str] = "clock-step"
    reports: ClassVar[tuple[str, ...]] = ("offset_s", "bound_s")

    tolerance_s: float = 3.0
    machine: str = "robot"

    def __post_init__(self) -> None:
        if self.machine == "laptop":
            raise ValueError("it sets the robot's clock from the laptop's, never the laptop's")
        if not 0.2 <= self.tolerance_s <= 3600:
            raise ValueError(
                f"a tolerance lies between 0.2 s, which this measurement can tell, and 3600 s, unlike {self.tolerance_s}"
            )

    def differs(self, target: Target) -> Difference | None:
        found = offset(target)
        if found.at_least_s <= self.tolerance_s:
            return None
        where = "ahead of" if found.offset_s > 0 else "behind"
        amount = f"{abs(found.offset_s):.1f} s (± {found.bound_s:.1f} s)"
        summary = f"the clock of {target.name}, {amount} {where} this machine's, is set"
        return Difference(summary, "", {"offset_s": round(found.offset_s, 3)})

    def change(self, target: Target, difference: Difference) -> None:
        guard = look(target, _GUARD, root=True)
        if guard.status == LIVE_STACK:
            raise OperationError(
                f"the clock of {target.name} is not stepped under a running stack: {guard.stdout.strip()}", "lupin sync-clock"
            )
        # One short round trip first: half of it is what the command will need to get there.
        sent = time.monotonic()
        read(target, "true", "nothing")
        way_s = (time.monotonic() - sent) / 2
        # The guard again, in the same breath: what was started meanwhile is live too.
        script = f"""
read -r begun rest </proc/uptime
{_GUARD}
read -r now rest </proc/uptime
date -s "@$(awk -v t={time.time() + way_s:.3f} -v a="$begun" -v b="$now" 'BEGIN {{ printf "%.2f", t + b - a }}')" >/dev/null
"""
        change(
            target,
            script,
            "set the clock (not under a running stack)",
            root=True,
            bound_s=10.0,
            next_command="lupin sync-clock",
        )

    def report(self, target: Target) -> dict[str, Any]:
        found = offset(target)
        return {"offset_s": round(found.offset_s, 3), "bound_s": round(found.bound_s, 3)}

    def undo(self, target: Target, before: dict[str, Any]) -> None:
        """Nothing: see the class."""


def offset(target: Target, tries: int = 3) -> Offset:
    """The target's wall clock against this machine's, from a few batches: every target has those, not every one a channel."""
    samples = []
    for _ in range(tries):
        sent_ns, before_ns = time.time_ns(), time.monotonic_ns()
        output = target.batch([Script("clock", "date +%s.%N", 5.0)], 8.0)["clock"]
        received_ns = sent_ns + time.monotonic_ns() - before_ns
        try:
            samples.append(Sample(sent_ns, read_answer(output.stdout), received_ns))
        except ClockError as error:
            raise OperationError(
                f"{target.name} did not tell its time: {output.stderr.strip() or output.stdout.strip()}"
            ) from error
    return estimate(samples).offset
