"""`clock-step`: set the robot's wall clock from this machine's in one step, never while a ROS stack runs there."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, ClassVar

from lupin_cli.connection.base import Output, Target
from lupin_cli.operations.base import Difference, Operation, OperationError
from lupin_cli.operations.clock_samples import offset_values, parse_offset, require_plausible_clock, take_samples
from lupin_cli.operations.shell import change, query

_STACK_RUNS = 43

# A step under ros2_control kills it: everything expires in one tick and the wheels stop responding. A running stack is found by
# the service that starts it, and by its libraries in any process, however it was started. A discovery server may keep running:
# it stores no wall time.
_GUARD = r"""
state=$(systemctl show -p ActiveState --value mirte-ros.service 2>/dev/null)
case $state in inactive | failed | '') ;; *) echo "mirte-ros.service is $state"; exit 43 ;; esac
for d in /proc/[0-9]*; do
  grep -qsE 'lib(rcl|rclcpp|controller_manager|hardware_interface)\.so' "$d/maps" || continue
  echo "process ${d#/proc/} ($(cat "$d/comm" 2>/dev/null)) is part of a ROS stack"; exit 43
done
"""


@dataclass(frozen=True, kw_only=True)
class ClockStep(Operation):
    """Sets the clock only if its offset exceeds `tolerance_s` by more than the bound. Undo does not restore the wrong time."""

    name: ClassVar[str] = "clock-step"
    effect: ClassVar[str] = "the robot has the laptop's time; refuses while any part of a ROS stack runs"
    report_keys: ClassVar[tuple[str, ...]] = ("offset_s", "bound_s")

    tolerance_s: float = 3.0

    def __post_init__(self) -> None:
        if self.machine == "laptop":
            raise ValueError("it sets the robot's clock from the laptop's, but never the laptop's own")
        if not 0.2 <= self.tolerance_s <= 3600:
            raise ValueError(
                f"the tolerance must be from 0.2 s, the precision of this measurement, to 3600 s: {self.tolerance_s}"
            )

    def probe(self) -> None:
        """Return None: the samples need this machine's clock too, so `complete` takes them."""

    def complete(self, target: Target, output: Output) -> Output:
        return take_samples(target)

    def judge(self, output: Output) -> Difference | None:
        offset = parse_offset(output)
        if offset.at_least_s <= self.tolerance_s:
            return None
        require_plausible_clock(output)
        direction = "ahead of" if offset.offset_s > 0 else "behind"
        amount = f"{abs(offset.offset_s):.1f} s (± {offset.bound_s:.1f} s)"
        summary = f"set the robot's clock, which is {amount} {direction} this machine's"
        return Difference(summary, "", {"offset_s": round(offset.offset_s, 3)})

    def change(self, target: Target, difference: Difference) -> None:
        guard = query(target, _GUARD, root=True)
        if guard.status == _STACK_RUNS:
            raise OperationError(
                f"the clock of {target.name} is not stepped under a running stack: {guard.stdout.strip()}", "lupin sync-clock"
            )
        # Half the duration of a short round trip estimates how long the command takes to arrive.
        sent = time.monotonic()
        query(target, "true")
        delay_s = (time.monotonic() - sent) / 2
        # The guard runs again in the same script: a stack may have been started meanwhile.
        script = f"""
read -r start rest </proc/uptime
{_GUARD}
read -r now rest </proc/uptime
date -s "@$(awk -v t={time.time() + delay_s:.3f} -v a="$start" -v b="$now" 'BEGIN {{ printf "%.2f", t + b - a }}')" >/dev/null
"""
        what = "set the clock (not under a running stack)"
        change(target, script, what, root=True, timeout_s=10.0, next_command="lupin sync-clock")

    def report(self, output: Output) -> dict[str, Any]:
        return offset_values(parse_offset(output))
