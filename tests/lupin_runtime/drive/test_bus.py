"""Properties of the drive bus, checked against an oracle that evaluates the complete history of events."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from lupin_runtime.drive import INPUTS, ZERO, Bus, HardLimits, Twist
from lupin_runtime.drive.arbiter import ESTOP_TIMEOUT_S
from lupin_runtime.drive.bus import IDLE_PERIOD_S, ZERO_REPEAT_S
from lupin_runtime.drive.ramp import LINEAR_MPS2, MAX_GAP_S, REST_GAP_S, SLACK_S, YAW_RADPS2
from lupin_runtime.safety.estop_monitor import ESTOP_ENGAGED, ESTOP_NOT_RECEIVED, ESTOP_SILENT, QUIET_S, RELEASE_COUNT

MS = 1_000_000
S = 1_000 * MS
TICK = 50 * MS
PRIORITY = {item.key: item.priority for item in INPUTS}
TIMEOUT_S = {item.key: item.timeout_s for item in INPUTS}
FORWARD = Twist(0.1, 0.0, 0.1)  # within the ramp's first step
RELEASE_NS = 600 * MS  # the bridge repeats released for this long until it counts


@dataclass
class Driver:
    """Feeds a bus and records its output: (time, twist)."""

    bus: Bus = field(default_factory=Bus)
    now_ns: int = 10 * S
    estop_ns: int = 0
    sink: list[tuple[int, Twist]] = field(default_factory=list)

    def _take(self, out: Twist | None) -> Twist | None:
        if out is not None:
            self.sink.append((self.now_ns, out))
        return out

    def wait(self, ns: int, released: bool | None = None) -> None:
        """Let time pass with ticks at 20 Hz, and with the e-stop state at 5 Hz unless `released` is None."""
        end_ns = self.now_ns + ns
        while self.now_ns < end_ns:
            self.now_ns = min(end_ns, self.now_ns + TICK)
            if released is not None and self.now_ns - self.estop_ns >= 4 * TICK:
                self.estop(not released)
            self.tick()

    def command(self, key: str, twist: Twist | None) -> Twist | None:
        return self._take(self.bus.handle_command(key, twist, self.now_ns))

    def estop(self, engaged: bool) -> Twist | None:
        self.estop_ns = self.now_ns
        return self._take(self.bus.handle_estop_state(engaged, self.now_ns))

    def tick(self) -> Twist | None:
        return self._take(self.bus.tick(self.now_ns))

    def release(self) -> None:
        """Release the e-stop as the bridge does, until the bus is unlocked."""
        self.estop(False)
        self.wait(RELEASE_NS + 200 * MS, released=True)

    def ready(self) -> Driver:
        """Unlock the bus with every input at rest and then silent."""
        self.estop(False)
        self.wait(200 * MS, released=True)
        for key in PRIORITY:
            self.command(key, ZERO)
        self.wait(2 * S, released=True)
        return self


# -- random event sequences --------------------------------------------------------------------------------------------
NUMBER = st.sampled_from([0.0, 0.0, 0.3, -0.3, 5.0, math.nan, math.inf])
COMMAND = st.tuples(st.sampled_from(sorted(PRIORITY)), st.builds(Twist, NUMBER, NUMBER, NUMBER))
EVENT = st.one_of(COMMAND, COMMAND, COMMAND, st.sampled_from(["engage", "release", "release", "release", "tick"]))
STEP = st.sampled_from([0, 1, 20, 50, 50, 50, 150, 150, 310, 510, 1100, 2500])
CONFIRMED_RELEASE = st.tuples(st.sampled_from([150, 200, 310]), st.just("release")).map(lambda step: [step] * 4)
STEPS = st.one_of(*[st.tuples(STEP, EVENT).map(lambda step: [step])] * 6, CONFIRMED_RELEASE)
# Most sequences begin with a release and inputs at rest; otherwise the bus would nearly always be locked.
READY = [(0, "release"), (200, "release"), *((0, (key, ZERO)) for key in PRIORITY)]
SEQUENCES = st.builds(
    list.__add__,
    st.sampled_from([READY, READY, []]),
    st.lists(STEPS, min_size=1, max_size=60).map(lambda parts: list(itertools.chain(*parts))),
)


@dataclass
class History:
    """The events up to now, for the oracle."""

    estop: list[tuple[int, bool]] = field(default_factory=list)
    received: dict[str, int] = field(default_factory=dict)

    def locked(self, now_ns: int) -> bool:
        return not self.estop or self.engaged() or now_ns - self.estop[-1][0] > ESTOP_TIMEOUT_S * S

    def engaged(self) -> bool:
        trues = [index for index, (_, engaged) in enumerate(self.estop) if engaged]
        if not trues:
            return False
        falses = [time_ns for time_ns, _ in self.estop[trues[-1] + 1 :]]
        return not any(time_ns >= self.estop[trues[-1]][0] + QUIET_S * S for time_ns in falses[RELEASE_COUNT - 1 :])

    def winner(self, now_ns: int) -> str | None:
        fresh = [k for k, t in self.received.items() if now_ns - t <= TIMEOUT_S[k] * S]
        return max(fresh, key=PRIORITY.__getitem__, default=None)


def run_sequence(sequence: list[Any]) -> list[tuple[History, int, object, Twist | None, str | None]]:
    """Run a sequence; return per event the history, the time, the event, the output and the reported winner."""
    bus, history, now_ns, rows = Bus(), History(), 5 * S, []
    for step_ms, what in sequence:
        now_ns += step_ms * MS
        if what == "tick":
            out = bus.tick(now_ns)
        elif what in ("engage", "release"):
            history.estop.append((now_ns, what == "engage"))
            out = bus.handle_estop_state(what == "engage", now_ns)
        else:
            history.received[what[0]] = now_ns
            out = bus.handle_command(*what, now_ns)  # type: ignore[call-arg]
        snapshot = History(list(history.estop), dict(history.received))
        rows.append((snapshot, now_ns, what, out, bus.decision(now_ns).winner))
    return rows


@settings(max_examples=300)
@given(SEQUENCES)
def test_locked_bus_sends_only_zero(sequence: list[Any]) -> None:
    for history, now_ns, _, out, _ in run_sequence(sequence):
        if history.locked(now_ns):
            assert out in (None, ZERO)


@settings(max_examples=300)
@given(SEQUENCES)
def test_motion_is_the_message_just_received_from_the_winner(sequence: list[Any]) -> None:
    for history, now_ns, what, out, _ in run_sequence(sequence):
        if out is None or out == ZERO:
            continue
        event("moved")
        assert isinstance(what, tuple)
        key, twist = what
        assert all(abs(v) <= abs(full) and v * full >= 0.0 for v, full in zip(out, HardLimits().clamp(twist)))
        assert key == history.winner(now_ns)


@settings(max_examples=300)
@given(SEQUENCES)
def test_winner_is_the_highest_fresh_input_of_an_unlocked_bus(sequence: list[Any]) -> None:
    for history, now_ns, _, _, winner in run_sequence(sequence):
        assert winner == (None if history.locked(now_ns) else history.winner(now_ns))


@settings(max_examples=300)
@given(SEQUENCES)
def test_sink_commands_are_finite_and_within_the_limits(sequence: list[Any]) -> None:
    limits = HardLimits()
    for *_, out, _ in run_sequence(sequence):
        if out is not None:
            assert out.is_finite()
            assert max(abs(out.x), abs(out.y)) <= limits.linear_mps and abs(out.yaw) <= limits.yaw_radps


@settings(max_examples=300)
@given(SEQUENCES)
def test_after_an_estop_an_input_must_rest_before_it_moves(sequence: list[Any]) -> None:
    rested: dict[str, bool] = {}
    last: dict[str, int] = {}
    moved: dict[str, int] = {}
    was_neutral: dict[str, bool] = {}
    unlocked_ns: int | None = None
    engaged = False
    for history, now_ns, what, out, _ in run_sequence(sequence):
        if history.engaged() and not engaged:
            rested = dict.fromkeys(PRIORITY, False)  # a repeated stop is the same stop
        engaged = history.engaged()
        if history.locked(now_ns):
            unlocked_ns = None
        elif unlocked_ns is None:
            unlocked_ns = now_ns
        if isinstance(what, tuple):
            key, twist = what
            silent_ns = now_ns - max(unlocked_ns or now_ns, last.get(key, 0))
            neutral = not twist.is_finite() or twist.is_neutral()
            motionless = now_ns - moved.get(key, 0) > TIMEOUT_S[key] * S
            if (motionless and (neutral or was_neutral.get(key, False))) or silent_ns >= 2 * S:
                rested[key] = True
            last[key], was_neutral[key] = now_ns, neutral
            if not neutral:
                moved[key] = now_ns
            if out not in (None, ZERO):
                assert rested.get(key, True)


@given(st.sampled_from(sorted(PRIORITY.keys() - {"zero"})), st.integers(0, 40))
def test_silent_winner_is_followed_by_zero_within_a_tick(key: str, messages: int) -> None:
    driver = Driver().ready()
    for _ in range(messages + 1):
        driver.wait(TICK, released=True)
        assert driver.command(key, FORWARD) == FORWARD
    last_ns = driver.now_ns
    driver.wait(2 * S, released=True)
    after = [time_ns for time_ns, twist in driver.sink if time_ns > last_ns]
    assert all(twist == ZERO for time_ns, twist in driver.sink if time_ns > last_ns)
    assert after[0] - last_ns <= TIMEOUT_S[key] * S + TICK
    assert sum(time_ns - after[0] <= ZERO_REPEAT_S * S for time_ns in after) >= 20


def test_idle_unlocked_bus_sends_zero_twice_a_second() -> None:
    driver = Driver().ready()
    driver.wait(2 * S, released=True)
    driver.sink.clear()
    driver.wait(10 * S, released=True)
    assert len(driver.sink) == round(10 / IDLE_PERIOD_S)


def test_locked_bus_sends_zero_with_every_tick() -> None:
    driver = Driver().ready()
    driver.estop(True)
    driver.wait(3 * S, released=False)
    driver.sink.clear()
    driver.wait(2 * S, released=False)
    assert [twist for _, twist in driver.sink] == [ZERO] * 40


def test_estop_edge_sends_zero_at_once() -> None:
    driver = Driver().ready()
    assert driver.command("auto", FORWARD) == FORWARD
    assert driver.estop(True) == ZERO
    assert driver.command("auto", FORWARD) is None


def test_bus_without_an_estop_message_is_locked() -> None:
    driver = Driver()
    assert driver.command("auto", FORWARD) is None
    assert driver.bus.decision(driver.now_ns).locks == (ESTOP_NOT_RECEIVED,)
    assert driver.tick() == ZERO


def test_silent_estop_locks_after_its_timeout() -> None:
    driver = Driver().ready()
    driver.estop(False)
    start_ns = driver.now_ns
    driver.sink.clear()
    while driver.now_ns < start_ns + 2 * S:
        driver.command("auto", FORWARD)
        driver.wait(TICK)
    moved = [time_ns for time_ns, twist in driver.sink if twist != ZERO]
    assert max(moved) - start_ns <= ESTOP_TIMEOUT_S * S
    stopped = [time_ns for time_ns, twist in driver.sink if twist == ZERO]
    assert min(stopped) - start_ns <= ESTOP_TIMEOUT_S * S + TICK
    assert driver.bus.decision(driver.now_ns).locks[0].startswith(ESTOP_SILENT)


def test_restarted_estop_bridge_passes_autonomy_not_operators() -> None:
    driver = Driver().ready()
    for _ in range(40):
        driver.command("auto", FORWARD)
        driver.command("manual", FORWARD)
        driver.wait(TICK)
    driver.estop(False)
    driver.wait(150 * MS)
    assert driver.command("manual", FORWARD) == ZERO
    driver.wait(600 * MS, released=True)
    assert driver.command("auto", FORWARD) == FORWARD


def test_commands_queued_at_the_release_do_not_pass() -> None:
    driver = Driver().ready()
    driver.estop(True)
    driver.command("auto", ZERO)
    for _ in range(RELEASE_COUNT):
        driver.wait(200 * MS)
        driver.estop(False)
    assert driver.command("auto", FORWARD) == ZERO
    driver.wait(100 * MS)
    assert driver.command("auto", FORWARD) == FORWARD


def test_stick_held_through_an_estop_must_be_released_first() -> None:
    driver = Driver().ready()
    driver.command("manual", FORWARD)
    driver.estop(True)
    for _ in range(20):
        driver.wait(TICK, released=False)
        driver.command("manual", FORWARD)
    driver.sink.clear()
    for _ in range(100):
        driver.wait(TICK, released=True)
        driver.command("manual", FORWARD)
        driver.command("auto", ZERO)
        driver.command("auto", FORWARD)
    assert {twist for _, twist in driver.sink} == {ZERO}, "it wins the bus at zero, even against autonomy"
    assert "at rest once" in driver.bus.decision(driver.now_ns).why["manual"]
    for _ in range(12):
        driver.wait(TICK, released=True)
        driver.command("manual", ZERO)
    assert driver.command("manual", FORWARD) == FORWARD


def test_stick_held_beside_a_publisher_at_rest_stays_at_zero() -> None:
    driver = Driver().ready()
    driver.estop(True)
    driver.sink.clear()
    for _ in range(100):
        driver.wait(TICK, released=True)
        driver.command("manual", FORWARD)
        driver.command("manual", ZERO)
    assert {twist for _, twist in driver.sink} == {ZERO}


def test_one_neutral_message_counts_as_rest() -> None:
    driver = Driver().ready()
    driver.estop(True)
    driver.command("manual", FORWARD)
    driver.command("manual", ZERO)
    driver.release()
    assert driver.command("manual", FORWARD) == FORWARD


def test_stick_pushed_during_an_estop_is_not_at_rest() -> None:
    driver = Driver().ready()
    driver.estop(True)
    driver.command("manual", ZERO)
    driver.command("manual", FORWARD)
    driver.release()
    assert driver.command("manual", FORWARD) == ZERO


def test_input_long_after_the_release_needs_no_neutral() -> None:
    driver = Driver().ready()
    driver.estop(True)
    driver.command("manual", FORWARD)
    driver.release()
    driver.wait(2100 * MS, released=True)
    assert driver.command("manual", FORWARD) == FORWARD


@pytest.mark.parametrize(("silent_s", "passes"), [(2.1, True), (1.0, False)])
def test_autonomy_silent_before_a_lost_bridge_has_rested(silent_s: float, passes: bool) -> None:
    driver = Driver().ready()
    driver.command("auto", FORWARD)
    driver.estop(True)
    driver.release()
    driver.wait(int(silent_s * S), released=True)
    driver.wait(1500 * MS)  # the bridge is lost
    sent = []
    for _ in range(100):  # a stream that began during the lock, and never rests
        sent.append(driver.command("auto", FORWARD))
        driver.wait(TICK, released=True)
    assert (FORWARD in sent) == passes


def test_time_in_which_the_bus_was_suspended_is_no_silence() -> None:
    driver = Driver().ready()
    driver.command("auto", FORWARD)
    driver.estop(True)
    driver.release()
    driver.now_ns += 10 * S
    driver.tick()
    for _ in range(20):
        driver.command("auto", FORWARD)
        driver.wait(TICK, released=True)
    assert driver.command("auto", FORWARD) == ZERO


def test_estop_after_a_lost_bridge_also_stops_autonomy() -> None:
    driver = Driver().ready()
    driver.command("auto", FORWARD)
    driver.wait(1500 * MS)
    driver.estop(True)
    driver.wait(200 * MS)
    driver.release()
    assert driver.command("auto", FORWARD) == ZERO


def test_clock_jump_back_stops_the_bus_until_new_messages() -> None:
    driver = Driver().ready()
    assert driver.command("auto", FORWARD) == FORWARD
    driver.now_ns -= 8 * S
    assert driver.tick() == ZERO
    decision = driver.bus.decision(driver.now_ns)
    assert decision.winner is None and decision.locks[0].startswith(ESTOP_SILENT)
    driver.estop(False)
    driver.wait(200 * MS, released=True)
    assert driver.command("auto", FORWARD) == FORWARD


def test_without_heartbeat_rule_only_an_estop_locks() -> None:
    driver = Driver(Bus(require_heartbeat=False))
    driver.wait(3 * S)
    assert driver.command("manual", FORWARD) == FORWARD
    assert driver.estop(True) == ZERO
    assert driver.bus.decision(driver.now_ns).locks == (ESTOP_ENGAGED,)


def test_after_a_lock_autonomy_continues_and_sticks_must_rest() -> None:
    driver = Driver().ready()
    assert driver.command("auto", FORWARD) == FORWARD
    assert driver.bus.tick(driver.now_ns, "slam does not respond") == ZERO
    assert driver.command("auto", FORWARD) is None and driver.command("manual", FORWARD) is None
    assert driver.bus.decision(driver.now_ns).locks == ("slam does not respond",)
    driver.wait(700 * MS, released=True)
    assert driver.command("auto", FORWARD) == FORWARD
    assert driver.command("manual", FORWARD) == ZERO


def test_closed_bus_stays_locked() -> None:
    driver = Driver().ready()
    driver.command("auto", FORWARD)
    assert driver.bus.close(driver.now_ns) == ZERO
    driver.estop(False)
    driver.wait(3 * S, released=True)
    assert driver.command("auto", FORWARD) is None


def test_rejected_commands_are_counted_and_act_as_zero() -> None:
    driver = Driver().ready()
    assert driver.command("joy", Twist(math.nan, 0.0, 0.0)) == ZERO
    assert driver.command("joy", None) == ZERO
    assert driver.bus.rejected["joy"] == 2
    assert driver.command("auto", FORWARD) is None, "a source of malformed commands still wins the bus, at zero"


# -- the ramp ----------------------------------------------------------------------------------------------------------
STREAM = st.lists(
    st.tuples(st.sampled_from([1, 10, 20, 50, 50, 100, 250, 450, 700, 1500]), NUMBER, NUMBER), min_size=1, max_size=60
)


@given(STREAM)
def test_speed_never_grows_faster_than_the_ramp(stream: list[tuple[int, float, float]]) -> None:
    driver, before, before_ns = Driver().ready(), ZERO, 0
    for step_ms, x, yaw in stream:
        driver.wait(step_ms * MS, released=True)
        stopped = [twist for time_ns, twist in driver.sink if time_ns > before_ns and twist == ZERO]
        out = driver.command("joy", Twist(x, 0.0, yaw))
        assert out is not None
        at_rest = stopped or driver.now_ns - before_ns > REST_GAP_S * S
        reached = ZERO if at_rest else before
        credit_s = SLACK_S + (0.0 if at_rest and before_ns else min(MAX_GAP_S, (driver.now_ns - before_ns) / S))
        assert abs(out.x) <= (abs(reached.x) if reached.x * out.x > 0 else 0.0) + LINEAR_MPS2 * credit_s + 1e-9
        assert abs(out.yaw) <= (abs(reached.yaw) if reached.yaw * out.yaw > 0 else 0.0) + YAW_RADPS2 * credit_s + 1e-9
        before, before_ns = out, driver.now_ns


@given(st.lists(NUMBER, min_size=1, max_size=20))
def test_slower_command_passes_at_once(speeds: list[float]) -> None:
    driver = Driver().ready()
    for speed in speeds:
        driver.wait(TICK, released=True)
        out = driver.command("joy", Twist(speed, 0.0, 0.0))
        assert out is not None and abs(out.x) <= (abs(speed) if math.isfinite(speed) else 0.0)


def test_constant_command_reaches_full_speed_in_250_ms() -> None:
    driver = Driver().ready()
    for _ in range(5):
        driver.wait(TICK, released=True)
        out = driver.command("joy", Twist(0.6, 0.0, 1.2))
    assert out == Twist(0.6, 0.0, 1.2)


@pytest.mark.parametrize("gap_ms", [210, 300, 450, 900])
def test_full_speed_after_a_gap_starts_from_rest(gap_ms: int) -> None:
    driver = Driver().ready()
    for _ in range(10):
        driver.wait(TICK, released=True)
        driver.command("auto", Twist(0.5, 0.0, 0.0))
    driver.wait(gap_ms * MS, released=True)
    out = driver.command("auto", Twist(0.5, 0.0, 0.0))
    assert out is not None and out.x == pytest.approx(LINEAR_MPS2 * SLACK_S)


def test_idle_input_never_moves_the_base() -> None:
    driver = Driver().ready()
    assert driver.command("zero", Twist(0.5, 0.0, 0.0)) == ZERO
    assert driver.bus.rejected["zero"] == 1
