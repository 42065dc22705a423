"""The table of pads: each driver's device finds its own row, and no other device finds one."""

from __future__ import annotations

import pytest

from lupin_runtime.teleop.events import ABS_RX, ABS_X, ABS_Y, ABS_Z, BTN_TL, BTN_TR, BTN_WEST, BTN_Z
from lupin_runtime.teleop.pad_maps import MAPS, PadId, PadMap, find_map, parse_bits
from tests.support import pad_ids

SHOULDERS = (BTN_TL, BTN_TR)


@pytest.mark.parametrize(
    ("found", "name", "buttons", "yaw_axis"),
    [
        (pad_ids.XBOX_USB, "Xbox", SHOULDERS, ABS_RX),
        (pad_ids.XBOX_360_USB, "Xbox", SHOULDERS, ABS_RX),
        (pad_ids.XBOX_BLUETOOTH, "Xbox", SHOULDERS, ABS_Z),
        (pad_ids.XBOX_ONE_BLUETOOTH, "Xbox", SHOULDERS, ABS_Z),
        (pad_ids.XBOX_OLD_FIRMWARE, "Xbox, old firmware", (BTN_WEST, BTN_Z), ABS_RX),
        (pad_ids.XBOX_XPADNEO, "Xbox, xpadneo", SHOULDERS, ABS_RX),
        (pad_ids.DUALSHOCK4_USB, "DualShock 4 or DualSense", SHOULDERS, ABS_RX),
        (pad_ids.DUALSHOCK4_BLUETOOTH, "DualShock 4 or DualSense", SHOULDERS, ABS_RX),
        (pad_ids.SWITCH_PRO, "Switch Pro", SHOULDERS, ABS_RX),
    ],
)
def test_pad_is_found_with_its_driver(found: PadId, name: str, buttons: tuple[int, int], yaw_axis: int) -> None:
    row = find_map(found)
    assert row is not None
    assert (row.name, (row.dead_man, row.turbo), row.axes) == (name, buttons, (ABS_X, ABS_Y, yaw_axis))


@pytest.mark.parametrize("found", [pad_ids.DUALSHOCK4_GENERIC, pad_ids.DUALSHOCK4_MOTION, pad_ids.MICROSOFT_MOUSE])
def test_device_that_is_no_known_pad_is_left_alone(found: PadId) -> None:
    assert find_map(found) is None


@pytest.mark.parametrize("row", MAPS, ids=lambda row: f"{row.name}-{row.buses}")
def test_row_uses_no_control_twice(row: PadMap) -> None:
    assert row.dead_man != row.turbo
    assert len(set(row.axes)) == 3
    low, high = row.axis_range
    assert low < high


def test_bits_of_a_bitmap_begin_with_the_last_word() -> None:
    # An Xbox pad at a cable: BTN_SOUTH is 0x130, in the fifth word.
    assert parse_bits("7cdb000000000000 0 0 0 0\n") == pad_ids.XBOX_KEYS
    assert parse_bits("0") == frozenset()
    with pytest.raises(ValueError, match="invalid literal"):
        parse_bits("keys")
