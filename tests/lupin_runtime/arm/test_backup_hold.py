"""The hold of the arm in place of a process that does not respond, and without disturbing one that does."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.arm import ArmMotion, ArmState, Point, Refused
from lupin_runtime.arm.backup_hold import ANSWER_S, BackupHold
from lupin_runtime.arm.motion import DRIFT_RAD
from lupin_runtime.heartbeat import names_process

S = 10**9
TICK_NS = S // 10
AT, ELSEWHERE = (0.1, 0.2, 0.3, -0.4), (0.6, 0.2, 0.3, -0.4)


def test_arm_is_held_once_when_its_process_hangs() -> None:
    hold = BackupHold()
    assert hold.tick(True, AT, 0) is None
    assert hold.tick(False, None, TICK_NS) is None, "the pose is not known yet"
    assert hold.tick(False, AT, 2 * TICK_NS) == AT
    assert hold.tick(False, ELSEWHERE, 3 * TICK_NS) is None, "without an e-stop, other clients may move the arm"


def test_engaged_estop_brings_a_moved_arm_back() -> None:
    hold = BackupHold()
    assert hold.tick(False, AT, 0) == AT
    hold.estop(True, 0)
    assert hold.tick(False, ELSEWHERE, TICK_NS) == ELSEWHERE, "it is held where the press found it"
    assert hold.tick(False, ELSEWHERE, 2 * TICK_NS) is None
    assert hold.tick(False, AT, 3 * TICK_NS) == ELSEWHERE
    hold.trajectory([ELSEWHERE], AT)  # its own
    assert hold.tick(False, ELSEWHERE, 4 * TICK_NS) is None
    hold.trajectory([AT], ELSEWHERE)
    assert hold.tick(False, ELSEWHERE, 5 * TICK_NS) == ELSEWHERE


def test_release_replaces_a_late_trajectory_once() -> None:
    hold = BackupHold()
    hold.estop(True, 0)
    assert hold.tick(False, AT, 0) == AT
    hold.estop(False, TICK_NS)
    assert hold.tick(True, AT, TICK_NS) == AT, "also if its process responds again just now"
    assert hold.tick(True, AT, 2 * TICK_NS) is None


def test_estop_that_nobody_answers_holds_the_arm() -> None:
    hold = BackupHold()
    hold.estop(True, 0)
    answer_ns = int(ANSWER_S * S)
    assert hold.tick(True, AT, answer_ns) is None
    assert hold.tick(True, AT, answer_ns + 1) == AT
    hold.trajectory([(0.1, 0.2, 0.3, -0.45)], AT)  # the process holds the arm, a little late
    assert hold.tick(True, ELSEWHERE, answer_ns + TICK_NS) is None


@pytest.mark.parametrize(
    "path", [[], [()], [AT, ELSEWHERE], [ELSEWHERE], [(math.nan,) * 4], [AT[:2]]], ids=lambda path: str(len(path))
)
def test_trajectory_that_does_not_hold_the_arm_is_no_answer(path: Any) -> None:
    hold = BackupHold()
    hold.estop(True, 0)
    hold.trajectory(path, AT)
    assert hold.tick(True, AT, S) == AT


@pytest.mark.parametrize(
    ("reason", "named"),
    [
        ("", False),
        ("body does not respond", True),
        ("slam has exited, body is being restarted", True),
        ("body-camera has exited", False),
        ("the supervisor does not respond", False),
    ],
)
def test_reason_of_the_supervisor_names_a_process(reason: str, named: bool) -> None:
    assert names_process(reason, "body") is named


EVENTS = st.lists(
    st.one_of(
        st.sampled_from(["engage", "release", "foreign", "hang", "respond", "tick", "tick", "tick"]),
        st.tuples(*[st.floats(-0.3, 0.3)] * 4),
    ),
    max_size=60,
)


class Vendor:
    """The vendor's controller, which goes half of the way to its target per tick, and both holders of the arm.

    The holders receive each other's trajectories at once, as in one graph.
    """

    def __init__(self) -> None:
        self.pose: tuple[float, float, float, float] = AT
        self.target: tuple[float, ...] = AT
        self.now_ns = 100 * S
        self.responds, self.engaged = True, False
        self.by_body = self.by_guard = 0
        self.guard = BackupHold()
        self.body = ArmMotion(
            lambda: ArmState(self.pose, 0.0, self.now_ns), self._send, lambda: self.now_ns, real_ns=lambda: self.now_ns
        )
        self.body.set_estop(False)
        self.body.pin()

    def _send(self, path: tuple[Point, ...]) -> None:
        self.by_body += 1
        self.target = path[-1].arm
        self.guard.trajectory([point.arm for point in path], self.pose)

    def publish(self, target: tuple[float, ...], by_guard: bool = False) -> None:
        self.target = target
        self.by_guard += by_guard
        self.guard.trajectory([target], self.pose)
        if self.responds:
            self.body.counter([target])

    def move(self, arm: tuple[float, ...]) -> None:
        if self.responds:
            with suppress(Refused):
                self.body.move(arm, 1.0)

    def estop(self, engaged: bool) -> None:
        self.engaged = engaged
        self.guard.estop(engaged, self.now_ns)
        if self.responds:
            self.body.set_estop(engaged)

    def tick(self) -> None:
        self.now_ns += TICK_NS
        pan, lift, elbow, wrist = ((is_at + to) / 2 for is_at, to in zip(self.pose, self.target))
        self.pose = (pan, lift, elbow, wrist)
        if self.engaged:
            self.estop(True)
        held = self.guard.tick(self.responds, self.pose, self.now_ns)
        if held is not None:
            self.publish(held, by_guard=True)


@given(EVENTS)
def test_working_process_is_never_disturbed(events: list[Any]) -> None:
    vendor = Vendor()
    for event in events:
        if event in ("engage", "release"):
            vendor.estop(event == "engage")
        elif event == "foreign":
            vendor.publish(ELSEWHERE)
        elif event == "tick":
            vendor.tick()
        elif isinstance(event, tuple):
            vendor.move(event)
    assert vendor.by_guard == 0


@given(EVENTS)
def test_arm_stays_under_the_estop_whoever_holds_it(events: list[Any]) -> None:
    vendor = Vendor()
    for event in [*events, "engage", "tick", "foreign"]:
        if event in ("engage", "release"):
            vendor.estop(event == "engage")
        elif event in ("hang", "respond"):
            vendor.responds = event == "respond"
        elif event == "foreign":
            vendor.publish(ELSEWHERE)
        elif event == "tick":
            vendor.tick()
        else:
            vendor.move(event)
    for _ in range(10):
        vendor.tick()
    at, sent = vendor.pose, vendor.by_body + vendor.by_guard
    for _ in range(20):
        vendor.tick()
    assert all(abs(a - b) <= DRIFT_RAD for a, b in zip(vendor.pose, at))
    assert vendor.by_body + vendor.by_guard == sent, "the two do not replace each other's commands"
