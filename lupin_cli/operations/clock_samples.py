"""Measures how far a target's wall clock is from this machine's, with a few probes that this machine times."""

from __future__ import annotations

import time

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.facts.clock import Offset
from lupin_cli.link.clock_offset import ClockError, ClockPair, Sample, estimate, parse_epoch
from lupin_cli.operations.base import OperationError
from lupin_cli.plausible_time import SET_CLOCK, clock_fault

_CLOCK = Script("clock", "date +%s.%N", 5.0)
_TIMEOUT_S = 8.0
_SAMPLES = 3


def take_samples(target: Target) -> Output:
    """Read the target's clock a few times. Each line has sent_ns and received_ns by this machine's clock, and the reading.

    It uses batches because every target has them; not every target has a channel that stays open.
    """
    lines = []
    for _ in range(_SAMPLES):
        start = ClockPair.now()
        output = target.batch([_CLOCK], _TIMEOUT_S)[_CLOCK.name]
        sent_ns, received_ns = start.wall_ns, start.latest_wall_ns(time.monotonic_ns())
        reading = (output.stdout.strip() or output.stderr.strip() or "nothing").splitlines()[0]
        lines.append(f"{sent_ns} {received_ns} {reading}\n")
    return Output(0, "".join(lines))


def parse_samples(output: Output) -> list[Sample]:
    """Return what `take_samples` read, at least one sample. Raises OperationError."""
    samples, line = [], ""
    try:
        for line in output.stdout.splitlines():
            sent_ns, received_ns, reading = line.split(" ", 2)
            samples.append(Sample(int(sent_ns), parse_epoch(reading), int(received_ns)))
        estimate(samples)
    except (ClockError, ValueError) as error:
        raise OperationError(f"could not read the clock: found {line[:120]!r}", "lupin doctor") from error
    return samples


def parse_offset(output: Output) -> Offset:
    """Return the offset that `take_samples` measured, with its bound. Raises OperationError."""
    return estimate(parse_samples(output)).offset


def require_plausible_clock(output: Output) -> None:
    """Raise OperationError if this machine's clock was certainly wrong when `take_samples` read it: no other is set from it."""
    sent_ns = output.stdout.split(" ", 1)[0]
    fault = clock_fault(int(sent_ns) / 1e9) if sent_ns.isascii() and sent_ns.isdigit() else ""
    if fault:
        raise OperationError(f"{fault}; the robot's clock is not set from it", SET_CLOCK)


def offset_values(offset: Offset) -> dict[str, float]:
    """Return an offset for later steps' conditions: `offset_s`, positive if the target is ahead, and its `bound_s`."""
    return {"offset_s": round(offset.offset_s, 3), "bound_s": round(offset.bound_s, 3)}
