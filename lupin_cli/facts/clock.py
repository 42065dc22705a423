"""The machine's wall clock, and between which two instants of its own it was read."""

from __future__ import annotations

from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, answers, integer
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

# The monotonic clock before and after a reading bounds it even while the wall clock is being slewed or stepped.
PROBE = (
    PRELUDE
    + """echo '@@ before'; date +%s%N
echo '@@ after'; date +%s%N
echo '@@ rtc'; cat /sys/class/rtc/rtc0/since_epoch 2>/dev/null
"""
)


@dataclass(frozen=True)
class Clock:
    """The wall clock in nanoseconds since 1970, read twice around one instant."""

    before_ns: int
    after_ns: int
    rtc_s: int | None  # the hardware clock, where there is one

    @property
    def epoch_ns(self) -> int:
        """The middle of the two readings."""
        return (self.before_ns + self.after_ns) // 2


@dataclass(frozen=True)
class Offset:
    """How far a clock is ahead of this machine's: the truth lies within offset_s ± bound_s."""

    offset_s: float
    bound_s: float

    def __str__(self) -> str:
        if abs(self.offset_s) < 1.0:
            return f"{self.offset_s * 1e3:+.2f} ms ± {self.bound_s * 1e3:.2f} ms"
        return f"{self.offset_s:+.3f} s ± {self.bound_s:.3f} s"

    @property
    def at_least_s(self) -> float:
        """The smallest amount by which the clocks may differ."""
        return max(0.0, abs(self.offset_s) - self.bound_s)

    @property
    def at_most_s(self) -> float:
        """The largest amount by which the clocks may differ."""
        return abs(self.offset_s) + self.bound_s


def offset(clock: Clock, asked_ns: tuple[int, int]) -> Offset:
    """The offset of `clock` against the clock that read `asked_ns` before the question left and after its answer came.

    Cristian's algorithm with nothing assumed of the way: the reading happened somewhere in between.
    """
    earliest, latest = clock.before_ns - asked_ns[1], clock.after_ns - asked_ns[0]
    return Offset((earliest + latest) / 2e9, (latest - earliest) / 2e9)


def parse(output: Output) -> Clock:
    """Pure parser of PROBE. Raises ValueError."""
    said = answers(output)
    before, after = (integer(said.text(name), "nanoseconds since 1970") for name in ("before", "after"))
    rtc = said.maybe("rtc")
    return Clock(before, after, int(rtc.text) if rtc and rtc.text.isdigit() else None)


CLOCK = Fact("clock", PROBE, parse, at_once=True)
