"""The arm's controls of a pad: what they command, when they count, and what is published of them."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.teleop.arm_jogger import ARM_RADPS, AT_REST, GRIPPER_RADPS, ArmJogger, ArmRates
from lupin_runtime.teleop.events import (
    ABS_HAT0X,
    ABS_HAT0Y,
    ABS_RX,
    ABS_RZ,
    ABS_X,
    ABS_Z,
    BTN_EAST,
    BTN_NORTH,
    BTN_SOUTH,
    BTN_TL,
    BTN_TL2,
    BTN_TR2,
    BTN_WEST,
    Event,
)
from lupin_runtime.teleop.map_files import read_map, write_map
from lupin_runtime.teleop.pad_maps import MAPS, PadId, find_map
from lupin_runtime.teleop.pad_state import QUIET_S, STALE_S, PadState, Snapshot
from tests.support import pad_ids
from tests.support.optional import present
from tests.support.pad_events import CONNECTED_NS, MS, SETTLED_NS, axis, dropped, key, new_state, report, xbox

NOW_NS = SETTLED_NS + 100 * MS
PAD = "event7"


def rested_state(found: PadId = pad_ids.XBOX_USB, quiet_s: float | None = None) -> PadState:
    """Return the state of a pad of which everything has been seen at rest."""
    row = present(find_map(found))
    state = PadState(row, found.bus, {}, CONNECTED_NS, quiet_s=quiet_s)
    state.handle(key(row.dead_man, 0, NOW_NS), NOW_NS)
    return state


def rates_after(state: PadState, events: list[Event], now_ns: int = NOW_NS) -> ArmRates:
    """Return what a pad commands after some events; AT_REST if nothing is published."""
    jogger = ArmJogger()
    state.handle(events, now_ns)
    return (jogger.step({PAD: state}, None, now_ns) or (AT_REST,))[-1]


@pytest.mark.parametrize(
    ("events", "expected"),
    [
        (key(BTN_EAST, 1, NOW_NS), ArmRates(pan=ARM_RADPS)),
        (key(BTN_NORTH, 1, NOW_NS), ArmRates(pan=-ARM_RADPS)),  # X, which is to the left
        (key(BTN_WEST, 1, NOW_NS), ArmRates(lift=ARM_RADPS)),  # Y, which is at the top
        (key(BTN_SOUTH, 1, NOW_NS), ArmRates(lift=-ARM_RADPS)),
        (axis(ABS_HAT0Y, -1, NOW_NS), ArmRates(elbow=ARM_RADPS)),
        (axis(ABS_HAT0Y, 1, NOW_NS), ArmRates(elbow=-ARM_RADPS)),
        (axis(ABS_HAT0X, -1, NOW_NS), ArmRates(wrist=ARM_RADPS)),
        (axis(ABS_RZ, 1023, NOW_NS), ArmRates(gripper=-GRIPPER_RADPS)),
        (axis(ABS_Z, 1023, NOW_NS), ArmRates(gripper=GRIPPER_RADPS)),
        (axis(ABS_Z, 60, NOW_NS), AT_REST),
        (axis(ABS_RX, -32768, NOW_NS), AT_REST),  # the right stick
        (axis(ABS_X, -32768, NOW_NS), AT_REST),
        (axis(ABS_HAT0Y, 40, NOW_NS), AT_REST),
        (key(BTN_EAST, 1, NOW_NS) + key(BTN_NORTH, 1, NOW_NS), AT_REST),
    ],
)
def test_control_commands_its_joint(events: list[Event], expected: ArmRates) -> None:
    assert rates_after(rested_state(), events) == expected


@pytest.mark.parametrize(
    ("found", "code", "expected"),
    [
        (pad_ids.DUALSHOCK4_USB, BTN_WEST, ArmRates(pan=-ARM_RADPS)),  # square
        (pad_ids.SWITCH_PRO, BTN_NORTH, ArmRates(lift=ARM_RADPS)),  # X, which is at the top
        (pad_ids.SWITCH_PRO, BTN_TR2, ArmRates(gripper=-GRIPPER_RADPS)),
        (pad_ids.SWITCH_PRO, BTN_TL2, ArmRates(gripper=GRIPPER_RADPS)),
        (pad_ids.XBOX_OLD_FIRMWARE, 0x132, ArmRates(pan=-ARM_RADPS)),
    ],
)
def test_buttons_are_found_by_their_place(found: PadId, code: int, expected: ArmRates) -> None:
    assert rates_after(rested_state(found), key(code, 1, NOW_NS)) == expected


@pytest.mark.parametrize("row", MAPS, ids=lambda row: row.name)
def test_no_control_of_the_arm_also_drives(row: object) -> None:
    from lupin_runtime.teleop.pad_maps import PadMap

    assert isinstance(row, PadMap)
    arm = present(row.arm)
    assert not {row.dead_man, row.turbo} & set(arm.buttons)
    assert not set(row.axes) & set(arm.ranges)
    assert len(set(arm.buttons)) == len(arm.buttons)


@pytest.mark.parametrize("value", [5000, -5000, 2**31 - 1, -(2**31)])
def test_trigger_far_outside_its_range_counts_as_released(value: int) -> None:
    assert rates_after(rested_state(), axis(ABS_RZ, value, NOW_NS)) == AT_REST


def test_left_shoulder_silences_the_arm_until_all_is_released() -> None:
    state, jogger = rested_state(), ArmJogger()
    state.handle(key(BTN_EAST, 1, NOW_NS), NOW_NS)
    assert jogger.step({PAD: state}, None, NOW_NS) == (AT_REST, ArmRates(pan=ARM_RADPS))
    state.handle(key(BTN_TL, 1, NOW_NS), NOW_NS)
    assert jogger.step({PAD: state}, PAD, NOW_NS) == (AT_REST,)
    assert jogger.step({PAD: state}, PAD, NOW_NS + MS) == ()
    state.handle(key(BTN_TL, 0, NOW_NS), NOW_NS)
    assert jogger.step({PAD: state}, None, NOW_NS + 2 * MS) == ()
    state.handle(key(BTN_EAST, 0, NOW_NS) + key(BTN_EAST, 1, NOW_NS), NOW_NS)
    state.handle(key(BTN_EAST, 0, NOW_NS), NOW_NS)
    state.handle(key(BTN_EAST, 1, NOW_NS), NOW_NS)
    assert jogger.step({PAD: state}, None, NOW_NS + 3 * MS) == (AT_REST, ArmRates(pan=ARM_RADPS))


def test_tap_of_the_left_shoulder_in_one_read_silences_the_arm() -> None:
    state = rested_state()
    state.handle(key(BTN_EAST, 1, NOW_NS), NOW_NS)
    assert rates_after(state, key(BTN_TL, 1, NOW_NS) + key(BTN_TL, 0, NOW_NS)) == AT_REST


def test_left_shoulder_that_may_be_held_silences_the_arm() -> None:
    state, early_ns = new_state(), CONNECTED_NS + 10 * MS
    state.handle(key(BTN_TL, 1, early_ns), early_ns)
    state.handle([], NOW_NS)
    assert rates_after(state, key(BTN_EAST, 1, NOW_NS)) == AT_REST
    assert rates_after(state, key(BTN_TL, 0, NOW_NS)) == AT_REST
    assert rates_after(state, key(BTN_EAST, 0, NOW_NS)) == AT_REST
    assert rates_after(state, key(BTN_EAST, 1, NOW_NS)) == ArmRates(pan=ARM_RADPS)


def test_no_pad_jogs_while_another_one_drives() -> None:
    state, jogger = rested_state(), ArmJogger()
    state.handle(key(BTN_EAST, 1, NOW_NS), NOW_NS)
    assert jogger.step({PAD: state}, "event3", NOW_NS) == ()
    assert jogger.step({PAD: state}, None, NOW_NS + MS) == ()  # what was held all along
    state.handle(key(BTN_EAST, 0, NOW_NS), NOW_NS)
    assert jogger.step({PAD: state}, None, NOW_NS + 2 * MS) == ()
    state.handle(key(BTN_EAST, 1, NOW_NS), NOW_NS)
    assert jogger.step({PAD: state}, None, NOW_NS + 3 * MS) == (AT_REST, ArmRates(pan=ARM_RADPS))


def test_control_held_since_the_connection_does_not_count() -> None:
    row = xbox()
    state = new_state()
    held = Snapshot({BTN_EAST}, {})
    state.resynchronize(held)
    state.handle([], NOW_NS)
    assert rates_after(state, axis(ABS_HAT0Y, -1, NOW_NS)) == AT_REST
    state.handle(key(BTN_EAST, 0, NOW_NS) + axis(ABS_HAT0Y, 0, NOW_NS), NOW_NS)
    assert rates_after(state, key(row.arm.right if row.arm else 0, 1, NOW_NS)) == ArmRates(pan=ARM_RADPS)


def test_press_in_the_first_report_does_not_count() -> None:
    state, early_ns = new_state(), CONNECTED_NS + 10 * MS
    state.handle(key(BTN_TL, 0, early_ns) + key(BTN_EAST, 1, early_ns), early_ns)
    assert rates_after(state, [], NOW_NS) == AT_REST


@pytest.mark.parametrize("fault", ["dropped", "late", "unread", "quiet", "garbage"])
def test_doubt_ends_the_jog_until_all_is_at_rest(fault: str) -> None:
    state = rested_state(quiet_s=QUIET_S if fault == "quiet" else None)
    assert rates_after(state, key(BTN_EAST, 1, NOW_NS)) == ArmRates(pan=ARM_RADPS)
    later_ns = NOW_NS + 10 * MS
    if fault == "dropped":
        state.handle([dropped(later_ns), report(later_ns)], later_ns)
    elif fault == "late":
        later_ns = NOW_NS + int(STALE_S * 1e9) + 2 * MS
        for now_ns in range(NOW_NS, later_ns, 100 * MS):
            state.handle([], now_ns)
        state.handle(axis(ABS_X, 0, NOW_NS), later_ns)
    elif fault == "unread":
        later_ns = NOW_NS + int(STALE_S * 1e9) + MS
        state.handle([], later_ns)
    elif fault == "quiet":
        later_ns = NOW_NS + int(QUIET_S * 1e9) + 200 * MS
        for now_ns in range(NOW_NS, later_ns, 100 * MS):
            state.handle([], now_ns)
    else:
        state.handle(key(BTN_EAST, 7, later_ns), later_ns)
    assert rates_after(state, [], later_ns) == AT_REST
    state.handle(key(BTN_TL, 0, later_ns), later_ns)
    assert rates_after(state, [], later_ns) == AT_REST
    state.handle(key(BTN_EAST, 0, later_ns), later_ns)
    assert rates_after(state, key(BTN_EAST, 1, later_ns), later_ns) == ArmRates(pan=ARM_RADPS)


def test_held_control_is_published_twenty_times_a_second() -> None:
    state, jogger = rested_state(), ArmJogger()
    state.handle(key(BTN_EAST, 1, NOW_NS), NOW_NS)
    sent = list(itertools.chain(*(jogger.step({PAD: state}, None, NOW_NS + index * MS) for index in range(1000))))
    assert sent == [AT_REST, *[ArmRates(pan=ARM_RADPS)] * 20]


def test_pad_that_is_gone_publishes_one_rest() -> None:
    state, jogger = rested_state(), ArmJogger()
    state.handle(key(BTN_EAST, 1, NOW_NS), NOW_NS)
    jogger.step({PAD: state}, None, NOW_NS)
    assert jogger.step({}, None, NOW_NS + MS) == (AT_REST,)
    assert jogger.step({}, None, NOW_NS + 100 * MS) == ()


def test_of_two_pads_the_first_one_jogs_until_its_rest() -> None:
    first, second, jogger = rested_state(), rested_state(), ArmJogger()
    pads = {"event1": first, "event2": second}
    first.handle(key(BTN_EAST, 1, NOW_NS), NOW_NS)
    jogger.step(pads, None, NOW_NS)
    second.handle(key(BTN_NORTH, 1, NOW_NS), NOW_NS)
    assert jogger.step(pads, None, NOW_NS + 60 * MS) == (ArmRates(pan=ARM_RADPS),)
    first.handle(key(BTN_EAST, 0, NOW_NS), NOW_NS)
    assert jogger.step(pads, None, NOW_NS + 70 * MS) == (AT_REST,)
    assert jogger.step(pads, None, NOW_NS + 140 * MS) == ()
    second.handle(key(BTN_NORTH, 0, NOW_NS), NOW_NS)
    jogger.step(pads, None, NOW_NS + 150 * MS)
    second.handle(key(BTN_NORTH, 1, NOW_NS), NOW_NS)
    assert jogger.step(pads, None, NOW_NS + 160 * MS) == (AT_REST, ArmRates(pan=-ARM_RADPS))


@given(st.lists(st.tuples(st.booleans(), st.booleans(), st.integers(1, 80)), max_size=40))
def test_stream_begins_and_ends_with_rest(steps: list[tuple[bool, bool, int]]) -> None:
    state, jogger, now_ns = rested_state(), ArmJogger(), NOW_NS
    sent: list[ArmRates] = []
    for pressed, drives, after_ms in [*steps, (False, False, 60)]:
        now_ns += after_ms * MS
        state.handle(key(BTN_EAST, int(pressed), now_ns), now_ns)
        sent += jogger.step({PAD: state}, PAD if drives else None, now_ns)
    rests = [rates == AT_REST for rates in sent]
    assert not sent or (rests[0] and rests[-1])


@pytest.mark.parametrize(("dead_man", "keeps"), [(BTN_TL, True), (BTN_EAST, False)])
def test_calibrated_pad_has_the_tables_arm_unless_it_drives(dead_man: int, keeps: bool, tmp_path: Path) -> None:
    found = pad_ids.XBOX_USB
    row = replace(
        xbox(), dead_man=dead_man, arm=None, products=(found.product,), version_bits=0, declares=tuple(sorted(found.axes))
    )
    write_map(tmp_path / "pad.json", row)
    assert present(read_map(tmp_path / "pad.json", found)).arm == (xbox().arm if keeps else None)
