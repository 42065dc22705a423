"""Laws of the bus, checked against an oracle that looks at the whole history of events instead of keeping state."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from hypothesis import event, given, settings
from hypothesis import strategies as st

from lupin_runtime.drive import INPUTS, ZERO, Bus, HardLimits, Twist
from lupin_runtime.drive.arbiter import ESTOP_ENGAGED, ESTOP_SILENT, ESTOP_UNHEARD
from lupin_runtime.drive.bus import HOLD_S, IDLE_PERIOD_S

MS = 1_000_000
S = 1_000 * MS
TICK = 50 * MS
PRIORITY = {item.key: item.priority for item in INPUTS}
TIMEOUT_S = {item.key: item.timeout_s for item in INPUTS}
FORWARD = Twist(0.2, 0.0, 0.1)


@dataclass
class Driver:
    """Feeds a bus and keeps what came out: (time, twist)."""

    bus: Bus = field(default_factory=Bus)
    now_ns: int = 10 * S
    sink: list[tuple[int, Twist]] = field(default_factory=list)

    def _take(self, out: Twist | None) -> Twist | None:
        if out is not None:
            self.sink.append((self.now_ns, out))
        return out

    def wait(self, ns: int, released: bool | None = None) -> None:
        """Let time pass with ticks at 20 Hz, and with the e-stop state at 5 Hz where `released` says which."""
        end_ns = self.now_ns + ns
        while self.now_ns < end_ns:
            self.now_ns = min(end_ns, self.now_ns + TICK)
            if released is not None and self.now_ns % (4 * TICK) == 0:
                self.estop(not released)
            self.tick()

    def command(self, key: str, twist: Twist | None) -> Twist | None:
        return self._take(self.bus.command(key, twist, self.now_ns))

    def estop(self, engaged: bool) -> Twist | None:
        return self._take(self.bus.estop(engaged, self.now_ns))

    def tick(self) -> Twist | None:
        return self._take(self.bus.tick(self.now_ns))

    def ready(self) -> Driver:
        """Unlocked, every input at rest a moment ago, all silent now."""
        self.estop(False)
        self.wait(200 * MS, released=True)
        for key in PRIORITY:
            self.command(key, ZERO)
        self.wait(2 * S, released=True)
        return self


# -- a random life of the bus ------------------------------------------------------------------------------------------
NUMBER = st.sampled_from([0.0, 0.0, 0.3, -0.3, 5.0, math.nan, math.inf])
COMMAND = st.tuples(st.sampled_from(sorted(PRIORITY)), st.builds(Twist, NUMBER, NUMBER, NUMBER))
EVENT = st.one_of(COMMAND, COMMAND, COMMAND, st.sampled_from(["engage", "release", "release", "release", "tick"]))
STEP = st.sampled_from([0, 1, 20, 50, 50, 50, 150, 150, 310, 510, 1100, 2500])
# Most lives begin with a release and inputs at rest, or nearly all of them would be spent locked.
READY = [(0, "release"), (200, "release"), *((0, (key, ZERO)) for key in PRIORITY)]
LIFE = st.builds(list.__add__, st.sampled_from([READY, READY, []]), st.lists(st.tuples(STEP, EVENT), min_size=1, max_size=60))


@dataclass
class History:
    """What happened up to now, for the oracle."""

    estop: list[tuple[int, bool]] = field(default_factory=list)
    heard: dict[str, int] = field(default_factory=dict)

    def locked(self, now_ns: int) -> bool:
        if not self.estop:
            return True
        time_ns, engaged = self.estop[-1]
        return engaged or now_ns - time_ns > 1 * S

    def winner(self, now_ns: int) -> str | None:
        fresh = [k for k, t in self.heard.items() if now_ns - t <= TIMEOUT_S[k] * S]
        return max(fresh, key=PRIORITY.__getitem__, default=None)


def live(life) -> list[tuple[History, int, object, Twist | None, str | None]]:
    """Run a life; per event: the history including it, the time, the event, what came out and who is said to have won."""
    bus, history, now_ns, rows = Bus(), History(), 5 * S, []
    for step_ms, what in life:
        now_ns += step_ms * MS
        if what == "tick":
            out = bus.tick(now_ns)
        elif what in ("engage", "release"):
            history.estop.append((now_ns, what == "engage"))
            out = bus.estop(what == "engage", now_ns)
        else:
            history.heard[what[0]] = now_ns
            out = bus.command(*what, now_ns)
        snapshot = History(list(history.estop), dict(history.heard))
        rows.append((snapshot, now_ns, what, out, bus.decision(now_ns).winner))
    return rows


@settings(max_examples=300, deadline=None)
@given(LIFE)
def test_nothing_but_zero_reaches_the_sink_while_locked(life):
    for history, now_ns, _, out, _ in live(life):
        if history.locked(now_ns):
            assert out in (None, ZERO)


@settings(max_examples=300, deadline=None)
@given(LIFE)
def test_motion_is_only_ever_the_message_just_received_from_the_highest_fresh_priority(life):
    for history, now_ns, what, out, _ in live(life):
        if out is None or out == ZERO:
            continue
        event("moved")
        assert isinstance(what, tuple)
        key, twist = what
        assert out == HardLimits().clamp(twist)
        assert key == history.winner(now_ns)


@settings(max_examples=300, deadline=None)
@given(LIFE)
def test_the_winner_is_the_highest_fresh_priority_and_nobody_while_locked(life):
    for history, now_ns, _, _, winner in live(life):
        assert winner == (None if history.locked(now_ns) else history.winner(now_ns))


@settings(max_examples=300, deadline=None)
@given(LIFE)
def test_every_number_at_the_sink_is_finite_and_within_the_limits(life):
    limits = HardLimits()
    for *_, out, _ in live(life):
        if out is not None:
            assert out.is_finite()
            assert max(abs(out.x), abs(out.y)) <= limits.linear_mps and abs(out.yaw) <= limits.yaw_radps


@settings(max_examples=300, deadline=None)
@given(LIFE)
def test_after_an_engaged_stop_an_input_moves_only_once_it_was_at_rest(life):
    rested: dict[str, bool] = {}
    last: dict[str, int] = {}
    unlocked_ns: int | None = None
    for history, now_ns, what, out, _ in live(life):
        if what == "engage" and not (len(history.estop) > 1 and history.estop[-2][1]):
            rested = dict.fromkeys(PRIORITY, False)  # a stop that is said again is the same stop
        if history.locked(now_ns):
            unlocked_ns = None
        elif unlocked_ns is None:
            unlocked_ns = now_ns
        if isinstance(what, tuple):
            key, twist = what
            silent_ns = now_ns - max(unlocked_ns or now_ns, last.get(key, 0))
            if not twist.is_finite() or twist.is_neutral() or silent_ns >= 2 * S:
                rested[key] = True
            last[key] = now_ns
            if out not in (None, ZERO):
                assert rested.get(key, True)


@given(st.sampled_from(sorted(PRIORITY)), st.integers(0, 40))
def test_when_the_winner_falls_silent_zero_follows_within_a_tick(key, messages):
    driver = Driver().ready()
    for _ in range(messages + 1):
        driver.wait(TICK, released=True)
        assert driver.command(key, FORWARD) == FORWARD
    last_ns = driver.now_ns
    driver.wait(2 * S, released=True)
    after = [time_ns for time_ns, twist in driver.sink if time_ns > last_ns]
    assert all(twist == ZERO for time_ns, twist in driver.sink if time_ns > last_ns)
    assert after[0] - last_ns <= TIMEOUT_S[key] * S + TICK
    assert sum(time_ns - after[0] <= HOLD_S * S for time_ns in after) >= 20


def test_an_idle_unlocked_bus_says_zero_twice_a_second():
    driver = Driver().ready()
    driver.wait(2 * S, released=True)
    driver.sink.clear()
    driver.wait(10 * S, released=True)
    assert len(driver.sink) == round(10 / IDLE_PERIOD_S)


def test_a_locked_bus_says_zero_with_every_tick():
    driver = Driver().ready()
    driver.estop(True)
    driver.wait(3 * S, released=False)
    driver.sink.clear()
    driver.wait(2 * S, released=False)
    assert [twist for _, twist in driver.sink] == [ZERO] * 40


def test_the_edge_of_the_stop_is_answered_with_zero_at_once():
    driver = Driver().ready()
    assert driver.command("auto", FORWARD) == FORWARD
    assert driver.estop(True) == ZERO
    assert driver.command("auto", FORWARD) is None


def test_a_bus_that_never_heard_of_the_stop_is_locked_and_says_why():
    driver = Driver()
    assert driver.command("auto", FORWARD) is None
    assert driver.bus.decision(driver.now_ns).locks == (ESTOP_UNHEARD,)
    assert driver.tick() == ZERO


def test_a_stop_that_falls_silent_locks_within_a_tick_of_a_second():
    driver = Driver().ready()
    driver.estop(False)
    start_ns = driver.now_ns
    driver.sink.clear()
    while driver.now_ns < start_ns + 2 * S:
        driver.command("auto", FORWARD)
        driver.wait(TICK)
    moved = [time_ns for time_ns, twist in driver.sink if twist != ZERO]
    assert max(moved) - start_ns <= 1 * S
    stopped = [time_ns for time_ns, twist in driver.sink if twist == ZERO]
    assert min(stopped) - start_ns <= 1 * S + TICK
    assert driver.bus.decision(driver.now_ns).locks[0].startswith(ESTOP_SILENT)


def test_a_restarted_stop_bridge_lets_autonomy_go_on_but_asks_a_hand_for_neutral():
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


def test_what_was_queued_when_the_stop_was_released_does_not_pass():
    driver = Driver().ready()
    driver.estop(True)
    driver.command("auto", ZERO)
    driver.estop(False)
    assert driver.command("auto", FORWARD) == ZERO
    driver.wait(100 * MS)
    assert driver.command("auto", FORWARD) == FORWARD


def test_a_stick_held_through_the_stop_moves_nothing_until_it_was_let_go():
    driver = Driver().ready()
    driver.command("manual", FORWARD)
    driver.estop(True)
    for _ in range(20):
        driver.wait(TICK, released=False)
        driver.command("manual", FORWARD)
    driver.estop(False)
    driver.sink.clear()
    for _ in range(100):
        driver.wait(TICK, released=True)
        driver.command("manual", FORWARD)
        driver.command("auto", ZERO)
        driver.command("auto", FORWARD)
    assert {twist for _, twist in driver.sink} == {ZERO}, "it holds the bus, at zero, also against autonomy"
    assert "come to rest" in driver.bus.decision(driver.now_ns).why["manual"]
    driver.command("manual", ZERO)
    assert driver.command("manual", FORWARD) == FORWARD


def test_a_stick_pushed_again_during_the_stop_does_not_count_as_at_rest():
    driver = Driver().ready()
    driver.estop(True)
    driver.command("manual", ZERO)
    driver.command("manual", FORWARD)
    driver.estop(False)
    driver.wait(150 * MS, released=True)
    assert driver.command("manual", FORWARD) == ZERO


def test_a_source_that_begins_long_after_the_release_needs_no_neutral():
    driver = Driver().ready()
    driver.estop(True)
    driver.command("manual", FORWARD)
    driver.estop(False)
    driver.wait(2100 * MS, released=True)
    assert driver.command("manual", FORWARD) == FORWARD


def test_a_stop_pressed_while_its_bridge_was_lost_also_stops_autonomy_for_good():
    driver = Driver().ready()
    driver.command("auto", FORWARD)
    driver.wait(1500 * MS)
    driver.estop(True)
    driver.wait(200 * MS)
    driver.estop(False)
    driver.wait(150 * MS, released=True)
    assert driver.command("auto", FORWARD) == ZERO


def test_a_clock_that_jumps_back_stops_the_bus_until_all_is_heard_anew():
    driver = Driver().ready()
    assert driver.command("auto", FORWARD) == FORWARD
    driver.now_ns -= 8 * S
    assert driver.tick() == ZERO
    decision = driver.bus.decision(driver.now_ns)
    assert decision.winner is None and decision.locks[0].startswith(ESTOP_SILENT)
    driver.estop(False)
    driver.wait(200 * MS, released=True)
    assert driver.command("auto", FORWARD) == FORWARD


def test_without_the_heartbeat_rule_only_an_engaged_stop_locks():
    driver = Driver(Bus(require_heartbeat=False))
    driver.wait(3 * S)
    assert driver.command("manual", FORWARD) == FORWARD
    assert driver.estop(True) == ZERO
    assert driver.bus.decision(driver.now_ns).locks == (ESTOP_ENGAGED,)


def test_closing_locks_for_good():
    driver = Driver().ready()
    driver.command("auto", FORWARD)
    assert driver.bus.close(driver.now_ns) == ZERO
    driver.estop(False)
    driver.wait(3 * S, released=True)
    assert driver.command("auto", FORWARD) is None


def test_rejected_commands_are_counted_and_act_as_zero():
    driver = Driver().ready()
    assert driver.command("joy", Twist(math.nan, 0.0, 0.0)) == ZERO
    assert driver.command("joy", None) == ZERO
    assert driver.bus.rejected["joy"] == 2
    assert driver.command("auto", FORWARD) is None, "a source that talks nonsense still holds the bus, at zero"
