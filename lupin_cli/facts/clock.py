"""The wall clock of a machine, read twice, and its offset from this machine's clock."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, integer, parse_sections

PROBE = (
    PRELUDE
    + """echo '@@ before'; date +%s%N
echo '@@ after'; date +%s%N
echo '@@ rtc'; cat /sys/class/rtc/rtc0/since_epoch 2>/dev/null
"""
)


@dataclass(frozen=True)
class Clock:
    """Two consecutive readings of the wall clock, in nanoseconds since 1970."""

    before_ns: int
    after_ns: int
    rtc_s: int | None  # the hardware clock; None without one

    @property
    def epoch_ns(self) -> int:
        """The mean of the two readings."""
        return (self.before_ns + self.after_ns) // 2


@dataclass(frozen=True)
class Offset:
    """How far a clock is ahead of this machine's: the true offset is within offset_s ± bound_s."""

    offset_s: float
    bound_s: float

    def __str__(self) -> str:
        if abs(self.offset_s) < 1.0:
            return f"{self.offset_s * 1e3:+.2f} ms ± {self.bound_s * 1e3:.2f} ms"
        return f"{self.offset_s:+.3f} s ± {self.bound_s:.3f} s"

    @property
    def at_least_s(self) -> float:
        """The smallest possible absolute offset."""
        return max(0.0, abs(self.offset_s) - self.bound_s)

    @property
    def at_most_s(self) -> float:
        """The largest possible absolute offset."""
        return abs(self.offset_s) + self.bound_s


def offset(clock: Clock, probed_ns: tuple[int, int]) -> Offset:
    """Return the offset of `clock` from the clock that read `probed_ns` before the probe was sent and after its output arrived.

    This is Cristian's algorithm without assumptions about the path: the probe ran at some time in between.
    """
    earliest, latest = clock.before_ns - probed_ns[1], clock.after_ns - probed_ns[0]
    return Offset((earliest + latest) / 2e9, (latest - earliest) / 2e9)


def parse(output: Output) -> Clock:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    before, after = (integer(sections.text(name), "nanoseconds since 1970") for name in ("before", "after"))
    rtc = sections.get("rtc")
    return Clock(before, after, int(rtc.text) if rtc and rtc.text.isdigit() else None)


CLOCK = Fact("clock", PROBE, parse, runs_in_shared_shell=True)
