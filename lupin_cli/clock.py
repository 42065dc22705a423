"""How far a robot's wall clock is off this machine's, with a bound that holds: many short exchanges over one open channel.

One exchange says only that the reading happened between sending and receiving (Cristian, Probabilistic clock synchronization,
1989); many of them say that the offset lies within the intersection of their intervals (Marzullo and Owicki, 1983). Nothing is
assumed of the way: half the round trip is the bound, not an estimate of the delay.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from lupin_cli.facts.clock import Offset
from lupin_cli.quick_dataclass import dataclass

# What may be left alone while the stack runs: the contract's, and far below what the message filters of mapping forgive.
TOLERATED_S = 3.0

# Answers every line with the wall clock. bash (from 5.0) reads it without a process for each answer, in microseconds; date(1)
# needs one.
ANSWERING = r"""LC_ALL=C; export LC_ALL
[ ! -x /bin/bash ] || exec /bin/bash -c 'while read -r line; do echo "${EPOCHREALTIME:-$(date +%s.%N)}"; done'
while read -r line; do date +%s.%N; done
"""

_SAMPLES, _SAMPLING_S = 60, 1.0
# Two free-running crystals, with room: no exchange is believed more than this much per second later.
_DRIFT = 500e-6
_RESOLUTION_NS = 1_000  # of what bash prints
_LAPTOP_STEP_NS = 1_000_000


class ClockError(RuntimeError):
    """The offset could not be measured: what was expected, what was found."""


class Conversation(Protocol):
    """A channel to something that answers each line with one."""

    def ask(self) -> str:
        """Send an empty line and return the answer without its end. Raises OSError, EOFError."""


class OpensChannels(Protocol):
    """A robot over SSH."""

    def open_run(self, script: str, bound_s: float) -> Any:
        """A channel to a running script, with `sendall`, `recv` and `close`."""


@dataclass(frozen=True)
class Sample:
    """One exchange, ns since 1970: by our clock before it left and after its answer came, by the other one in between."""

    sent_ns: int
    read_ns: int
    received_ns: int

    def interval_s(self, at_ns: int) -> tuple[float, float]:
        """Between which values the offset lay at the instant `at_ns` of our clock, s."""
        away_s = max(at_ns - self.sent_ns, self.received_ns - at_ns, 0) * 1e-9
        lowest, highest = self.read_ns - self.received_ns, self.read_ns + _RESOLUTION_NS - self.sent_ns
        return lowest * 1e-9 - _DRIFT * away_s, highest * 1e-9 + _DRIFT * away_s


@dataclass(frozen=True)
class Drift:
    """What was measured. `steady` is False where the clocks moved against each other while it was done."""

    offset: Offset
    round_trip_s: float  # the shortest
    samples: int
    steady: bool

    @property
    def tolerable(self) -> bool:
        """Whether it may stay as it is while the stack runs."""
        return abs(self.offset.offset_s) <= TOLERATED_S

    def __str__(self) -> str:
        moved = "" if self.steady else ", and moving"
        return f"{self.offset} ({self.samples} exchanges, shortest {self.round_trip_s * 1e3:.1f} ms{moved})"


def estimate(samples: Sequence[Sample]) -> Drift:
    """The offset at the last exchange, with its bound. Raises ClockError without samples."""
    if not samples:
        raise ClockError("expected answers of the robot's clock, found none")
    at_ns = samples[-1].received_ns
    intervals = [sample.interval_s(at_ns) for sample in samples]
    lowest, highest = max(low for low, _ in intervals), min(high for _, high in intervals)
    steady = lowest <= highest
    if not steady:
        # Stepped or slewed meanwhile: the truth at the end is somewhere among what was seen.
        lowest, highest = min(low for low, _ in intervals), max(high for _, high in intervals)
    round_trip_s = min(sample.received_ns - sample.sent_ns for sample in samples) * 1e-9
    return Drift(Offset((lowest + highest) / 2, (highest - lowest) / 2), round_trip_s, len(samples), steady)


def read_answer(text: str) -> int:
    """Nanoseconds since 1970 of `SECONDS.FRACTION`, as bash or date(1) print them. Raises ClockError."""
    seconds, _, fraction = text.strip().partition(".")
    if not seconds.isdigit() or not fraction.isdigit():
        raise ClockError(f"expected seconds since 1970 with a fraction, found {text[:40]!r}")
    return int(seconds) * 1_000_000_000 + int(fraction[:9].ljust(9, "0"))


def measure(conversation: Conversation, samples: int = _SAMPLES, bound_s: float = _SAMPLING_S) -> Drift:
    """Ask up to `samples` times within `bound_s` (at least three times). Raises ClockError, OSError, EOFError."""
    wall_ns, started_ns = time.time_ns(), time.monotonic_ns()

    def now_ns() -> int:
        # Our wall clock as it was at the start: being slewed meanwhile must not show as the robot's drift.
        return wall_ns + time.monotonic_ns() - started_ns

    taken: list[Sample] = []
    while len(taken) < samples and (len(taken) < 3 or time.monotonic_ns() - started_ns < bound_s * 1e9):
        sent_ns = now_ns()
        answer = conversation.ask()
        received_ns = now_ns()
        taken.append(Sample(sent_ns, read_answer(answer), received_ns))
    if abs(time.time_ns() - now_ns()) > _LAPTOP_STEP_NS:
        raise ClockError("this machine's own clock was set while it was compared; measure again")
    return estimate(taken)


def ntp_offset(host: str, timeout_s: float = 1.0, port: int = 123) -> Offset | None:
    """The offset of the clock that `host` serves over NTP; None where it serves none that it believes in itself (RFC 5905)."""
    import ntplib

    try:
        answer = ntplib.NTPClient().request(host, version=4, port=port, timeout=timeout_s)
    except (ntplib.NTPException, OSError):
        return None
    if answer.leap == 3 or not 0 < answer.stratum < 16:
        return None
    return Offset(answer.offset, answer.delay / 2 + answer.root_dispersion)


def measure_over(target: OpensChannels, within_s: float, samples: int = _SAMPLES, bound_s: float = _SAMPLING_S) -> Drift:
    """The offset of the clock of `target`, over one channel that is open `within_s` at most. Raises as `measure`, and
    TargetError."""
    with contextlib.closing(target.open_run(ANSWERING, within_s)) as channel:
        return measure(ChannelConversation(channel.sendall, channel.recv), samples, bound_s)


class ChannelConversation:
    """A conversation over anything with `sendall` and `recv` that bounds its own waits: a paramiko channel, a socket."""

    def __init__(self, send: Callable[[bytes], object], receive: Callable[[int], bytes]) -> None:
        self._send, self._receive = send, receive
        self._rest = b""

    def ask(self) -> str:
        """See `Conversation.ask`."""
        self._send(b"\n")
        while b"\n" not in self._rest:
            data = self._receive(4096)
            if not data:
                raise EOFError("the robot hung up while its clock was read")
            self._rest += data
        line, _, self._rest = self._rest.partition(b"\n")
        return line.decode("ascii", "backslashreplace")
