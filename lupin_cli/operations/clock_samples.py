"""Measures how far a target's wall clock is from this machine's, with a few probes that this machine times."""

from __future__ import annotations

import time

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.facts.clock import Offset
from lupin_cli.link.clock_offset import ClockError, Sample, estimate, parse_epoch
from lupin_cli.operations.base import OperationError

_CLOCK = Script("clock", "date +%s.%N", 5.0)
_TIMEOUT_S = 8.0
_SAMPLES = 3


def take_samples(target: Target) -> Output:
    """Read the target's clock a few times. Each line has sent_ns and received_ns by this machine's clock, and the reading.

    It uses batches because every target has them; not every target has a channel that stays open.
    """
    lines = []
    for _ in range(_SAMPLES):
        sent_ns, before_ns = time.time_ns(), time.monotonic_ns()
        output = target.batch([_CLOCK], _TIMEOUT_S)[_CLOCK.name]
        received_ns = sent_ns + time.monotonic_ns() - before_ns
        reading = (output.stdout.strip() or output.stderr.strip() or "nothing").splitlines()[0]
        lines.append(f"{sent_ns} {received_ns} {reading}\n")
    return Output(0, "".join(lines))


def parse_offset(output: Output) -> Offset:
    """Return the offset that `take_samples` measured, with its bound. Raises OperationError."""
    samples, line = [], ""
    try:
        for line in output.stdout.splitlines():
            sent_ns, received_ns, reading = line.split(" ", 2)
            samples.append(Sample(int(sent_ns), parse_epoch(reading), int(received_ns)))
        return estimate(samples).offset
    except (ClockError, ValueError) as error:
        raise OperationError(f"could not read the clock: found {line[:120]!r}", "lupin doctor") from error


def offset_values(offset: Offset) -> dict[str, float]:
    """Return an offset for later steps' conditions: `offset_s`, positive if the target is ahead, and its `bound_s`."""
    return {"offset_s": round(offset.offset_s, 3), "bound_s": round(offset.bound_s, 3)}
