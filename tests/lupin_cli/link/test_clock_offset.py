"""Clock offset and its bound: laws, and real shells behind links with artificial delay."""

from __future__ import annotations

import random
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.link import clock_offset
from lupin_cli.link.clock_offset import (
    CLOCK_SCRIPT,
    ClockError,
    ClockPair,
    LineExchange,
    Sample,
    estimate,
    measure,
    parse_epoch,
)

MS = 1_000_000
DELAYS = st.integers(0, 50 * MS)


@given(st.integers(-(10**14), 10**14), st.lists(st.tuples(DELAYS, DELAYS, st.integers(0, 5 * MS)), min_size=1, max_size=30))
def test_true_offset_is_within_bound_for_any_delays(offset_ns: int, delays: list[tuple[int, int, int]]) -> None:
    samples, now = [], 1_700_000_000_000_000_000
    for request, reply, pause in delays:
        samples.append(Sample(now, now + request + offset_ns, now + request + reply))
        now += request + reply + pause
    drift = estimate(samples)
    assert drift.steady
    assert abs(drift.offset.offset_s - offset_ns * 1e-9) <= drift.offset.bound_s + 1e-6
    assert (
        drift.offset.bound_s
        <= min(request + reply for request, reply, _ in delays) * 0.5e-9 + 500e-6 * (now - 17 * 10**17) * 1e-9 + 1e-6
    )


@given(st.lists(st.tuples(DELAYS, DELAYS), min_size=2, max_size=20), st.floats(-500e-6, 500e-6))
def test_bound_allows_for_crystal_drift(delays: list[tuple[int, int]], rate: float) -> None:
    samples, now = [], 0
    for request, reply in delays:
        read = now + request
        samples.append(Sample(now, read + round(rate * read), read + reply))
        now = read + reply
    drift = estimate(samples)
    assert drift.steady and abs(drift.offset.offset_s - rate * now * 1e-9) <= drift.offset.bound_s + 1e-6


def test_clock_step_is_unsteady_and_within_bound() -> None:
    samples = [Sample(n * MS, n * MS + (0 if n < 10 else 4000 * MS), (n + 1) * MS) for n in range(20)]
    drift = estimate(samples)
    assert not drift.steady and drift.offset.at_most_s >= 4.0 >= 2 * abs(drift.offset.offset_s) - 0.1


@pytest.mark.parametrize("text", ["", "1700000000", "1700000000.N", "date: bad", "17.5 s", "-1.5"])
def test_answer_that_is_not_a_time_is_rejected(text: str) -> None:
    with pytest.raises(ClockError, match="expected seconds since 1970"):
        parse_epoch(text)


def test_bash_and_date_answers_parse_alike() -> None:
    assert parse_epoch("1700000000.123456\n") == 1_700_000_000_123_456_000
    assert parse_epoch("1700000000.123456789") == 1_700_000_000_123_456_789


class DelayedShell:
    """A shell behind a link that delays each direction, and adds `offset_s` to every reading of the clock."""

    def __init__(
        self, script: str, offset_s: float = 0.0, request_s: float = 0.0, reply_s: float = 0.0, jitter_s: float = 0.0
    ) -> None:
        self._shell = subprocess.Popen(
            ["/bin/sh", "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self.near, self._far = socket.socketpair()
        self.near.settimeout(10.0)
        self._offset_s, self._delays_s, self._jitter_s = offset_s, (request_s, reply_s), jitter_s
        self._random = random.Random(7)
        self._thread = threading.Thread(target=self._pump, daemon=True)
        self._thread.start()

    def _pump(self) -> None:
        assert self._shell.stdin is not None and self._shell.stdout is not None
        with self._far:
            while self._far.recv(1):
                time.sleep(self._delays_s[0] + self._random.expovariate(1.0) * self._jitter_s)
                try:
                    self._shell.stdin.write("\n")
                except BrokenPipeError:
                    return
                line = self._shell.stdout.readline()
                if not line:
                    return
                time.sleep(self._delays_s[1] + self._random.expovariate(1.0) * self._jitter_s)
                shifted = parse_epoch(line) + round(self._offset_s * 1e9)
                self._far.sendall(f"{shifted // 10**9}.{shifted % 10**9:09d}\n".encode())

    def exchange(self) -> LineExchange:
        return LineExchange(self.near.sendall, self.near.recv)

    def close(self) -> None:
        self.near.close()
        self._shell.terminate()
        self._thread.join(60)
        self._shell.communicate(timeout=60)


@pytest.fixture
def shells() -> Iterator[Callable[..., DelayedShell]]:
    made: list[DelayedShell] = []

    def build(*arguments: Any, **options: Any) -> DelayedShell:
        made.append(DelayedShell(*arguments, **options))
        return made[-1]

    yield build
    for shell in made:
        shell.close()


WITHOUT_BASH = CLOCK_SCRIPT.replace("/bin/bash", "/nowhere/bash")
OLD_BASH = CLOCK_SCRIPT.replace("EPOCHREALTIME", "NOT_BEFORE_BASH_5")


@pytest.mark.parametrize("script", [CLOCK_SCRIPT, OLD_BASH, WITHOUT_BASH], ids=["bash", "old-bash", "date"])
@pytest.mark.parametrize("offset_s", [0.0, -16_440.0, 3.0])
def test_offset_of_real_shell_is_within_bound(shells: Callable[..., DelayedShell], script: str, offset_s: float) -> None:
    drift = measure(shells(script, offset_s=offset_s).exchange())
    assert abs(drift.offset.offset_s - offset_s) <= drift.offset.bound_s
    assert drift.samples >= 3 and drift.tolerable == (abs(drift.offset.offset_s) <= 3.0)


def test_offset_over_asymmetric_link_is_within_bound(shells: Callable[..., DelayedShell]) -> None:
    drift = measure(shells(CLOCK_SCRIPT, offset_s=1.0, request_s=0.02, reply_s=0.0, jitter_s=0.002).exchange())
    assert abs(drift.offset.offset_s - 1.0) <= drift.offset.bound_s
    assert drift.offset.bound_s >= 0.009  # half of the asymmetry, which is not observable


def test_closed_or_silent_channel_raises_in_time(shells: Callable[..., DelayedShell]) -> None:
    with pytest.raises(EOFError, match="closed the channel while its clock was read"):
        measure(shells("read line; exit").exchange())
    silent = shells("while read line; do :; done")
    silent.near.settimeout(0.2)
    with pytest.raises(TimeoutError):
        measure(silent.exchange())


def test_step_of_own_clock_during_measurement_raises(
    shells: Callable[..., DelayedShell], monkeypatch: pytest.MonkeyPatch
) -> None:
    real, readings = time.time_ns, iter([0])
    monkeypatch.setattr("lupin_cli.link.clock_offset.time.time_ns", lambda: real() + next(readings, 5 * MS))
    with pytest.raises(ClockError, match="own clock was set"):
        measure(shells(CLOCK_SCRIPT).exchange(), samples=3)


@pytest.mark.parametrize("paused", ["before", "after"])
def test_pause_beside_a_reading_of_the_clock_is_in_the_bound(
    shells: Callable[..., DelayedShell], monkeypatch: pytest.MonkeyPatch, paused: str
) -> None:
    real, pauses_s = time.time_ns, iter([0.02])

    def time_ns() -> int:
        pause_s = next(pauses_s, 0.0)
        time.sleep(pause_s if paused == "before" else 0.0)
        now = real()
        time.sleep(pause_s if paused == "after" else 0.0)
        return now

    monkeypatch.setattr("lupin_cli.link.clock_offset.time.time_ns", time_ns)
    drift = measure(shells(CLOCK_SCRIPT, offset_s=3.0).exchange())
    assert abs(drift.offset.offset_s - 3.0) <= drift.offset.bound_s and drift.steady


def test_pause_is_no_step_of_the_own_clock() -> None:
    start = ClockPair(before_ns=0, wall_ns=1_000 * MS, after_ns=20 * MS)
    assert not start.was_set_since(start)
    assert not ClockPair(100 * MS, 1_095 * MS, 130 * MS).was_set_since(start)
    assert ClockPair(100 * MS, 1_132 * MS, 130 * MS).was_set_since(start)
    assert ClockPair(100 * MS, 1_078 * MS, 130 * MS).was_set_since(start)


NTP_EPOCH_S = 2_208_988_800  # from 1900 to 1970, RFC 5905


class NtpServer:
    """Answers one NTP request as a server that is `ahead_s` ahead, with the given leap indicator and stratum."""

    def __init__(self, ahead_s: float, leap: int = 0, stratum: int = 10) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(5.0)
        self.port = self._socket.getsockname()[1]
        self._ahead_s, self._head = ahead_s, bytes([leap << 6 | 4 << 3 | 4, stratum, 6, 0xEC])
        self._thread = threading.Thread(target=self._answer, daemon=True)
        self._thread.start()

    def _answer(self) -> None:
        with self._socket:
            request, client = self._socket.recvfrom(512)
            seconds = time.time() + self._ahead_s + NTP_EPOCH_S
            now = struct.pack("!II", int(seconds), int(seconds % 1 * 2**32))
            root = struct.pack("!II", 0, 1 << 10) + b"LOCL"
            self._socket.sendto(self._head + root + now + request[40:48] + now + now, client)

    def end(self) -> None:
        self._thread.join(60)


@pytest.mark.parametrize("ahead_s", [0.0, -287.5, 16_440.0])
def test_ntp_offset_of_served_clock_is_within_bound(ahead_s: float) -> None:
    server = NtpServer(ahead_s)
    offset = clock_offset.ntp_offset("127.0.0.1", 5.0, server.port)
    server.end()
    assert offset is not None and abs(offset.offset_s - ahead_s) <= offset.bound_s and offset.bound_s >= (1 << 10) / 2**16


@pytest.mark.parametrize(("leap", "stratum"), [(3, 10), (0, 0), (0, 16)])
def test_ntp_offset_of_unsynchronized_server_is_none(leap: int, stratum: int) -> None:
    server = NtpServer(0.0, leap, stratum)
    assert clock_offset.ntp_offset("127.0.0.1", 5.0, server.port) is None
    server.end()


def test_ntp_offset_without_server_is_none_within_timeout() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        assert clock_offset.ntp_offset("127.0.0.1", 0.2, silent.getsockname()[1]) is None
