"""The offset of a clock and its bound: laws, and real shells that answer over pipes that are slow on purpose."""

from __future__ import annotations

import random
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli import clock
from lupin_cli.clock import ANSWERING, ChannelConversation, ClockError, Sample, estimate, measure, read_answer

MS = 1_000_000
DELAYS = st.integers(0, 50 * MS)


@given(st.integers(-(10**14), 10**14), st.lists(st.tuples(DELAYS, DELAYS, st.integers(0, 5 * MS)), min_size=1, max_size=30))
def test_the_truth_lies_within_the_bound_whatever_the_way_there_and_back_takes(offset_ns: int, ways) -> None:
    samples, now = [], 1_700_000_000_000_000_000
    for there, back, pause in ways:
        samples.append(Sample(now, now + there + offset_ns, now + there + back))
        now += there + back + pause
    drift = estimate(samples)
    assert drift.steady
    assert abs(drift.offset.offset_s - offset_ns * 1e-9) <= drift.offset.bound_s + 1e-6
    assert (
        drift.offset.bound_s
        <= min(there + back for there, back, _ in ways) * 0.5e-9 + 500e-6 * (now - 17 * 10**17) * 1e-9 + 1e-6
    )


@given(st.lists(st.tuples(DELAYS, DELAYS), min_size=2, max_size=20), st.floats(-500e-6, 500e-6))
def test_a_crystal_that_runs_off_is_allowed_for(ways, rate: float) -> None:
    samples, now = [], 0
    for there, back in ways:
        read = now + there
        samples.append(Sample(now, read + round(rate * read), read + back))
        now = read + back
    drift = estimate(samples)
    assert drift.steady and abs(drift.offset.offset_s - rate * now * 1e-9) <= drift.offset.bound_s + 1e-6


def test_a_clock_that_is_stepped_while_it_is_read_is_said_to_move_and_the_bound_holds_both() -> None:
    samples = [Sample(n * MS, n * MS + (0 if n < 10 else 4000 * MS), (n + 1) * MS) for n in range(20)]
    drift = estimate(samples)
    assert not drift.steady and drift.offset.at_most_s >= 4.0 >= 2 * abs(drift.offset.offset_s) - 0.1


@pytest.mark.parametrize("text", ["", "1700000000", "1700000000.N", "date: bad", "17.5 s", "-1.5"])
def test_an_answer_that_is_no_time_is_refused(text: str) -> None:
    with pytest.raises(ClockError, match="expected seconds since 1970"):
        read_answer(text)


def test_answers_of_bash_and_of_date_are_read_alike() -> None:
    assert read_answer("1700000000.123456\n") == 1_700_000_000_123_456_000
    assert read_answer("1700000000.123456789") == 1_700_000_000_123_456_789


class Link:
    """A shell that answers, behind a way that takes its time in each direction and adds `offset_s` to every reading."""

    def __init__(
        self, script: str, offset_s: float = 0.0, there_s: float = 0.0, back_s: float = 0.0, jitter_s: float = 0.0
    ) -> None:
        self._shell = subprocess.Popen(
            ["/bin/sh", "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self.near, self._far = socket.socketpair()
        self.near.settimeout(10.0)
        self._offset_s, self._ways, self._jitter_s = offset_s, (there_s, back_s), jitter_s
        self._random = random.Random(7)
        self._thread = threading.Thread(target=self._pump, daemon=True)
        self._thread.start()

    def _pump(self) -> None:
        assert self._shell.stdin is not None and self._shell.stdout is not None
        with self._far:
            while self._far.recv(1):
                time.sleep(self._ways[0] + self._random.expovariate(1.0) * self._jitter_s)
                try:
                    self._shell.stdin.write("\n")
                except BrokenPipeError:
                    return
                line = self._shell.stdout.readline()
                if not line:
                    return
                time.sleep(self._ways[1] + self._random.expovariate(1.0) * self._jitter_s)
                shifted = read_answer(line) + round(self._offset_s * 1e9)
                self._far.sendall(f"{shifted // 10**9}.{shifted % 10**9:09d}\n".encode())

    def conversation(self) -> ChannelConversation:
        return ChannelConversation(self.near.sendall, self.near.recv)

    def close(self) -> None:
        self.near.close()
        self._shell.terminate()
        self._thread.join(10)
        self._shell.communicate(timeout=10)


@pytest.fixture
def links() -> Iterator:
    made: list[Link] = []

    def build(*arguments, **options) -> Link:
        made.append(Link(*arguments, **options))
        return made[-1]

    yield build
    for link in made:
        link.close()


WITHOUT_BASH = ANSWERING.replace("/bin/bash", "/nowhere/bash")
OLD_BASH = ANSWERING.replace("EPOCHREALTIME", "NOT_BEFORE_BASH_5")


@pytest.mark.parametrize("script", [ANSWERING, OLD_BASH, WITHOUT_BASH], ids=["bash", "old-bash", "date"])
@pytest.mark.parametrize("offset_s", [0.0, -16_440.0, 3.0])
def test_a_real_shell_is_read_and_its_offset_lies_within_the_bound(links, script: str, offset_s: float) -> None:
    drift = measure(links(script, offset_s=offset_s).conversation())
    assert abs(drift.offset.offset_s - offset_s) <= drift.offset.bound_s
    assert drift.samples >= 3 and drift.tolerable == (abs(drift.offset.offset_s) <= 3.0)


def test_a_way_that_is_slow_in_one_direction_only_cannot_fool_the_bound(links) -> None:
    drift = measure(links(ANSWERING, offset_s=1.0, there_s=0.02, back_s=0.0, jitter_s=0.002).conversation())
    assert abs(drift.offset.offset_s - 1.0) <= drift.offset.bound_s
    assert drift.offset.bound_s >= 0.009  # half of what cannot be told apart


def test_a_robot_that_hangs_up_or_never_answers_is_an_error_and_no_endless_wait(links) -> None:
    with pytest.raises(EOFError, match="hung up while its clock was read"):
        measure(links("read line; exit").conversation())
    silent = links("while read line; do :; done")
    silent.near.settimeout(0.2)
    with pytest.raises(TimeoutError):
        measure(silent.conversation())


def test_our_own_clock_being_set_meanwhile_is_noticed(links, monkeypatch: pytest.MonkeyPatch) -> None:
    real, readings = time.time_ns, iter([0])
    monkeypatch.setattr(clock.time, "time_ns", lambda: real() + next(readings, 5 * MS))
    with pytest.raises(ClockError, match="own clock was set"):
        measure(links(ANSWERING).conversation(), samples=3)


NTP_EPOCH_S = 2_208_988_800  # from 1900 to 1970, RFC 5905


class Server:
    """Answers one NTP question as a server that is `ahead_s` ahead, with this leap indicator and stratum."""

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
            question, asker = self._socket.recvfrom(512)
            seconds = time.time() + self._ahead_s + NTP_EPOCH_S
            now = struct.pack("!II", int(seconds), int(seconds % 1 * 2**32))
            root = struct.pack("!II", 0, 1 << 10) + b"LOCL"
            self._socket.sendto(self._head + root + now + question[40:48] + now + now, asker)

    def end(self) -> None:
        self._thread.join(10)


@pytest.mark.parametrize("ahead_s", [0.0, -287.5, 16_440.0])
def test_a_clock_that_is_served_over_ntp_is_read_that_way_too(ahead_s: float) -> None:
    server = Server(ahead_s)
    offset = clock.ntp_offset("127.0.0.1", 5.0, server.port)
    server.end()
    assert offset is not None and abs(offset.offset_s - ahead_s) <= offset.bound_s and offset.bound_s >= (1 << 10) / 2**16


@pytest.mark.parametrize(("leap", "stratum"), [(3, 10), (0, 0), (0, 16)])
def test_a_server_that_does_not_believe_in_its_own_clock_is_not_believed(leap: int, stratum: int) -> None:
    server = Server(0.0, leap, stratum)
    assert clock.ntp_offset("127.0.0.1", 5.0, server.port) is None
    server.end()


def test_where_nobody_serves_time_the_answer_is_none_within_the_limit() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        assert clock.ntp_offset("127.0.0.1", 0.2, silent.getsockname()[1]) is None
