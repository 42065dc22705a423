"""Measures a robot's clock offset to this machine, with a guaranteed bound, by many short exchanges on one channel.

One exchange proves only that the clock was read between sending and receiving (Cristian, Probabilistic clock synchronization,
1989). Many of them prove that the offset lies in the intersection of their intervals (Marzullo and Owicki, 1983). The path may
be asymmetric: half the round trip is used as the bound, not as an estimate of the delay.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from lupin_cli.facts.clock import Offset

# An offset that may stay while the stack runs; the message filters of mapping tolerate far more.
TOLERATED_S = 3.0

# Answers every line with the wall clock. bash 5.0 and later reads it in microseconds without starting a process; otherwise
# date(1) has to be started for each answer.
CLOCK_SCRIPT = r"""LC_ALL=C; export LC_ALL
[ ! -x /bin/bash ] || exec /bin/bash -c 'while read -r line; do echo "${EPOCHREALTIME:-$(date +%s.%N)}"; done'
while read -r line; do date +%s.%N; done
"""

_SAMPLES, _SAMPLING_S = 60, 1.0
# Generous bound for the relative drift of two free-running crystals, in seconds per second since the exchange.
_DRIFT = 500e-6
_RESOLUTION_NS = 1_000  # of bash's EPOCHREALTIME
_LAPTOP_STEP_NS = 1_000_000


class ClockError(RuntimeError):
    """The offset could not be measured; the message says what was expected and found."""


class Channel(Protocol):
    """A channel, such as paramiko's, whose reads and writes time out by themselves."""

    def sendall(self, data: bytes, /) -> object:
        """Send all of `data`."""

    def recv(self, size: int, /) -> bytes:
        """Receive up to `size` bytes; empty at the end of the stream."""

    def close(self) -> None:
        """Close the channel."""


class SshChannelOpener(Protocol):
    """A robot over SSH."""

    def open_run(self, script: str, timeout_s: float) -> Channel:
        """Start `script` and return a channel to its standard input and output, open for at most `timeout_s`."""


@dataclass(frozen=True)
class Sample:
    """One exchange, in nanoseconds since 1970: when this machine sent and received, and what the other clock showed between."""

    sent_ns: int
    read_ns: int
    received_ns: int

    def interval_s(self, at_ns: int) -> tuple[float, float]:
        """Return the smallest and the largest possible offset when this machine's clock shows `at_ns`, in seconds."""
        age_s = max(at_ns - self.sent_ns, self.received_ns - at_ns, 0) * 1e-9
        lowest, highest = self.read_ns - self.received_ns, self.read_ns + _RESOLUTION_NS - self.sent_ns
        return lowest * 1e-9 - _DRIFT * age_s, highest * 1e-9 + _DRIFT * age_s


@dataclass(frozen=True)
class OffsetEstimate:
    """A measured offset. `steady` is False if one of the clocks was stepped or slewed during the measurement."""

    offset: Offset
    round_trip_s: float  # the shortest
    samples: int
    steady: bool

    @property
    def tolerable(self) -> bool:
        """Whether the clock may stay as it is while the stack runs."""
        return abs(self.offset.offset_s) <= TOLERATED_S

    def __str__(self) -> str:
        unsteady = "" if self.steady else ", and moving"
        return f"{self.offset} ({self.samples} exchanges, shortest {self.round_trip_s * 1e3:.1f} ms{unsteady})"


def estimate(samples: Sequence[Sample]) -> OffsetEstimate:
    """Estimate the offset at the last exchange, with its bound. Raises ClockError without samples."""
    if not samples:
        raise ClockError("expected readings of the robot's clock, found none")
    at_ns = samples[-1].received_ns
    intervals = [sample.interval_s(at_ns) for sample in samples]
    lowest, highest = max(low for low, _ in intervals), min(high for _, high in intervals)
    steady = lowest <= highest
    if not steady:
        # A clock was stepped or slewed meanwhile: only the union of all intervals is sure to contain the last offset.
        lowest, highest = min(low for low, _ in intervals), max(high for _, high in intervals)
    round_trip_s = min(sample.received_ns - sample.sent_ns for sample in samples) * 1e-9
    return OffsetEstimate(Offset((lowest + highest) / 2, (highest - lowest) / 2), round_trip_s, len(samples), steady)


def parse_epoch(text: str) -> int:
    """Return the nanoseconds since 1970 from `SECONDS.FRACTION`, as bash or date(1) print it. Raises ClockError."""
    seconds, _, fraction = text.strip().partition(".")
    if not seconds.isdigit() or not fraction.isdigit():
        raise ClockError(f"expected seconds since 1970 with a fraction, found {text[:40]!r}")
    return int(seconds) * 1_000_000_000 + int(fraction[:9].ljust(9, "0"))


class LineExchange:
    """Sends an empty line and reads one line back, over any pair of `sendall` and `recv` that time out by themselves."""

    def __init__(self, send: Callable[[bytes], object], receive: Callable[[int], bytes]) -> None:
        self._send, self._receive = send, receive
        self._buffer = b""

    def request(self) -> str:
        """Send an empty line and return the answer without its newline. Raises OSError, EOFError."""
        self._send(b"\n")
        while b"\n" not in self._buffer:
            data = self._receive(4096)
            if not data:
                raise EOFError("the robot closed the channel while its clock was read")
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line.decode("ascii", "backslashreplace")


@dataclass(frozen=True)
class ClockPair:
    """This machine's wall clock, in ns since 1970, read between two readings of its monotonic clock.

    The process may be preempted between two readings, so which instant of the monotonic clock a wall time belongs to is known
    only to lie between both. Times derived from it are therefore earliest or latest times.
    """

    before_ns: int
    wall_ns: int
    after_ns: int

    @classmethod
    def now(cls) -> ClockPair:
        """Read both clocks."""
        return cls(time.monotonic_ns(), time.time_ns(), time.monotonic_ns())

    def earliest_wall_ns(self, monotonic_ns: int) -> int:
        """Return the earliest wall time at this reading of the monotonic clock, if nobody has set the wall clock since."""
        return self.wall_ns + monotonic_ns - self.after_ns

    def latest_wall_ns(self, monotonic_ns: int) -> int:
        """Return the latest wall time at this reading of the monotonic clock, if nobody has set the wall clock since."""
        return self.wall_ns + monotonic_ns - self.before_ns

    def was_set_since(self, earlier: ClockPair) -> bool:
        """Return whether the wall clock was certainly set between both, by more than 1 ms."""
        too_late = self.wall_ns - earlier.latest_wall_ns(self.after_ns)
        too_early = earlier.earliest_wall_ns(self.before_ns) - self.wall_ns
        return max(too_late, too_early) > _LAPTOP_STEP_NS


def measure(exchange: LineExchange, samples: int = _SAMPLES, timeout_s: float = _SAMPLING_S) -> OffsetEstimate:
    """Measure with up to `samples` exchanges in `timeout_s`, but at least three. Raises ClockError, OSError, EOFError."""
    # Times of this machine are the wall clock of the start, advanced by the monotonic clock: slewing of this machine's clock
    # must not count as the robot's drift.
    start = ClockPair.now()
    exchanges: list[Sample] = []
    while len(exchanges) < samples and (len(exchanges) < 3 or time.monotonic_ns() - start.after_ns < timeout_s * 1e9):
        sent_ns = start.earliest_wall_ns(time.monotonic_ns())
        answer = exchange.request()
        received_ns = start.latest_wall_ns(time.monotonic_ns())
        exchanges.append(Sample(sent_ns, parse_epoch(answer), received_ns))
    if ClockPair.now().was_set_since(start):
        raise ClockError("this machine's own clock was set during the measurement; measure again")
    return estimate(exchanges)


def measure_target(
    target: SshChannelOpener, channel_timeout_s: float, samples: int = _SAMPLES, timeout_s: float = _SAMPLING_S
) -> OffsetEstimate:
    """Measure the clock offset of `target` over one channel that is open for at most `channel_timeout_s`. Raises what `measure`
    raises, and TargetError."""
    with contextlib.closing(target.open_run(CLOCK_SCRIPT, channel_timeout_s)) as channel:
        return measure(LineExchange(channel.sendall, channel.recv), samples, timeout_s)


def ntp_offset(host: str, timeout_s: float = 1.0, port: int = 123) -> Offset | None:
    """Measure the offset of the clock that `host` serves over NTP. Returns None if it does not answer, or calls its clock
    unsynchronized (RFC 5905)."""
    import ntplib

    try:
        answer = ntplib.NTPClient().request(host, version=4, port=port, timeout=timeout_s)
    except (ntplib.NTPException, OSError):
        return None
    if answer.leap == 3 or not 0 < answer.stratum < 16:
        return None
    return Offset(answer.offset, answer.delay / 2 + answer.root_dispersion)
