"""When a silent process blocks motion and is replaced; while it waits for a CPU, only its CPU time counts."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.heartbeat import Beat
from lupin_runtime.stack.liveness import (
    EXAMINE_AFTER_S,
    MOTION_BLOCK_AFTER_S,
    MOTION_BLOCK_WALL_S,
    REPLACE_AFTER_S,
    REPLACE_WALL_S,
    HeartbeatRecord,
    Silence,
)
from lupin_runtime.stack.usage import Activity

MS = 1_000_000
STEP_S = 0.1
START_NS = 50_000 * MS


class Process:
    """A process with its heartbeat record: it waits for a CPU or not, and gets the share `share` of one."""

    def __init__(self, waiting: bool, share: float = 0.0) -> None:
        self.waiting, self.share, self.cpu_s = waiting, share, 0.0
        self.now_ns = START_NS
        self.record = HeartbeatRecord(lambda: Activity(self.waiting, self.cpu_s), beat=Beat(START_NS, "node"))

    def pass_time(self, seconds: float, ignore_before_ns: int = 0) -> Silence:
        silence = self.record.silence(self.now_ns, ignore_before_ns)
        for _ in range(round(seconds / STEP_S)):
            self.now_ns += int(STEP_S * 1e9)
            self.cpu_s += self.share * STEP_S
            silence = self.record.silence(self.now_ns, ignore_before_ns)
        return silence


def test_process_is_not_silent_before_its_first_heartbeat() -> None:
    record = HeartbeatRecord(lambda: Activity(False, 0.0))
    assert record.silence(START_NS + 60_000 * MS) == Silence(0.0, 0.0)


@given(st.floats(0.0, 5.0))
def test_stopped_process_blocks_motion_and_is_hung_at_limits(seconds: float) -> None:
    process = Process(waiting=False)
    silence = process.pass_time(seconds)
    passed_s = round(seconds / STEP_S) * STEP_S
    assert silence.blocks_motion == (passed_s >= MOTION_BLOCK_AFTER_S - 1e-6)
    assert silence.hung == (passed_s >= REPLACE_AFTER_S - 1e-6)


def test_busy_loop_is_hung() -> None:
    assert Process(waiting=True, share=1.0).pass_time(REPLACE_AFTER_S + 0.2).hung


@given(st.floats(0.0, 0.1))
def test_only_cpu_time_of_a_waiting_process_counts(share: float) -> None:
    silence = Process(waiting=True, share=share).pass_time(1.9)
    assert not silence.hung
    assert silence.counted_s <= EXAMINE_AFTER_S + 2 * STEP_S + share * 1.9


def test_wall_clock_limits_hold_for_a_waiting_process() -> None:
    process = Process(waiting=True)
    assert process.pass_time(MOTION_BLOCK_WALL_S + STEP_S).blocks_motion
    assert not process.pass_time(REPLACE_WALL_S - MOTION_BLOCK_WALL_S - 3 * STEP_S).hung
    assert process.pass_time(4 * STEP_S).hung


def test_heartbeat_ends_the_silence() -> None:
    process = Process(waiting=False)
    assert process.pass_time(1.0).blocks_motion
    process.record.beat = Beat(process.now_ns, "node")
    assert not process.pass_time(0.3).blocks_motion


def test_stall_of_the_monitoring_thread_is_ignored() -> None:
    process = Process(waiting=False)
    process.now_ns += 30_000 * MS  # the computer was suspended
    assert not process.pass_time(0.4, ignore_before_ns=process.now_ns).blocks_motion
    assert process.pass_time(0.2, ignore_before_ns=START_NS + 30_000 * MS).blocks_motion


@given(st.lists(st.floats(0.01, 0.3), min_size=1, max_size=40), st.booleans())
def test_process_that_sends_heartbeats_never_blocks_motion(gaps_s: list[float], waiting: bool) -> None:
    process = Process(waiting)
    for gap_s in gaps_s:
        process.record.beat = Beat(process.now_ns, "node")
        assert not process.pass_time(gap_s).blocks_motion
