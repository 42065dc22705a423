"""Calibration: the controls of a pad are learned from its events, and kept in a file."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.teleop.calibration import STABLE_S, STEPS, Calibrator, can_be_calibrated
from lupin_runtime.teleop.connected_pads import ConnectedPads
from lupin_runtime.teleop.events import ABS_RX, ABS_RY, ABS_X, ABS_Y, ABS_Z, Event
from lupin_runtime.teleop.map_files import map_path, map_text, read_map, write_map
from lupin_runtime.teleop.pad_maps import KERNEL_LAYOUT, SIGNED_16, PadMap
from lupin_runtime.teleop.velocity import Sticks
from tests.support import pad_ids
from tests.support.fake_pads import FakePads
from tests.support.pad_events import CONNECTED_NS, MS, axis, key, new_state

STABLE_NS = int(STABLE_S * 1e9)
GENERIC = pad_ids.DUALSHOCK4_GENERIC
L1, R1 = 0x134, 0x135


class Person:
    """Uses controls, each for long enough, and lets go of them."""

    def __init__(self, rest: dict[int, int] | None = None) -> None:
        self.calibrator = Calibrator(dict.fromkeys(GENERIC.axes, SIGNED_16), {**dict.fromkeys(GENERIC.axes, 0), **(rest or {})})
        self._now_ns = 0

    def send(self, events: list[Event], hold_ns: int = STABLE_NS) -> None:
        for chunk in (events, []):
            self.calibrator.handle(chunk, self._now_ns)
            self._now_ns += hold_ns

    def button(self, code: int) -> None:
        self.send(key(code, 1, 0))
        self.send(key(code, 0, 0))

    def stick(self, code: int, value: int) -> None:
        self.send(axis(code, value, 0))
        self.send(axis(code, 100, 0))


def calibrated() -> PadMap:
    person = Person()
    for code in (L1, R1):
        person.button(code)
    for code, value in ((ABS_Y, -32768), (ABS_X, 30000), (ABS_Z, -25000)):
        person.stick(code, value)
    assert person.calibrator.step is None
    return person.calibrator.row("A pad", GENERIC, SIGNED_16)


def test_controls_are_learned_in_the_order_of_the_steps() -> None:
    row = calibrated()
    assert (row.dead_man, row.turbo, row.axes, row.above_center) == (L1, R1, (ABS_X, ABS_Y, ABS_Z), (ABS_X,))
    assert row.fits(GENERIC)
    assert not row.fits(pad_ids.DUALSHOCK4_USB)


def test_short_press_and_two_buttons_at_once_are_ignored() -> None:
    person = Person()
    person.send(key(L1, 1, 0), hold_ns=MS)
    person.send(key(L1, 0, 0))
    person.send(key(L1, 1, 0) + key(R1, 1, 0))
    assert person.calibrator.step is STEPS[0]


def test_control_is_not_learned_twice_nor_before_it_is_let_go() -> None:
    person = Person()
    person.send(key(L1, 1, 0))
    assert person.calibrator.step is STEPS[1] and person.calibrator.waits_for_rest
    person.send([])
    person.send(key(L1, 0, 0))
    person.button(L1)
    assert person.calibrator.step is STEPS[1] and not person.calibrator.waits_for_rest


def test_stick_that_is_moved_a_little_is_ignored() -> None:
    person = Person()
    for code in (L1, R1):
        person.button(code)
    person.stick(ABS_Y, -15000)
    assert person.calibrator.step is STEPS[2]


def test_pad_that_has_not_reported_its_sticks_yet_is_learned() -> None:
    ranges = dict.fromkeys(GENERIC.axes, (0, 65535))
    person = Person()
    person.calibrator = Calibrator(ranges, dict.fromkeys(GENERIC.axes, 0))
    person.send([event for code in (ABS_X, ABS_Y, ABS_Z) for event in axis(code, 32768, 0)] + key(L1, 1, 0))
    person.send(key(L1, 0, 0))
    person.button(R1)
    for code in (ABS_Y, ABS_X, ABS_Z):
        person.send(axis(code, 0, 0))
        person.send(axis(code, 32768, 0))
    assert person.calibrator.step is None and person.calibrator.above_center == []


def test_trigger_is_not_taken_for_a_stick() -> None:
    person = Person({ABS_RX: -32768})
    for code in (L1, R1):
        person.button(code)
    person.send(axis(ABS_RX, 32767, 0))
    person.send(axis(ABS_RX, -32768, 0))
    assert person.calibrator.step is STEPS[2]


def test_file_of_another_driver_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "pad.json"
    path.write_text(map_text(calibrated()))
    for other in (replace(GENERIC, axes=GENERIC.axes - {ABS_RY}), replace(GENERIC, version=GENERIC.version | KERNEL_LAYOUT)):
        with pytest.raises(MalformedFile, match="another driver"):
            read_map(path, other)


def test_axis_reported_the_other_way_round_drives_the_same_way() -> None:
    state = new_state(calibrated())
    state.handle(axis(ABS_X, 32767, CONNECTED_NS) + axis(ABS_Y, -32768, CONNECTED_NS), CONNECTED_NS)
    assert state.sticks == Sticks(1.0, 1.0, 0.0)


def test_file_is_for_one_link_and_keeps_the_former(tmp_path: Path) -> None:
    path = map_path(tmp_path / "pads", GENERIC)
    assert path.name == "054c-09cc-bluetooth.json"
    assert read_map(path, GENERIC) is None
    row = calibrated()
    assert write_map(path, row) is None
    former = path.read_text()
    assert read_map(path, GENERIC) == row
    assert write_map(path, row) == path.with_name("054c-09cc-bluetooth.json.bak")
    assert path.with_name("054c-09cc-bluetooth.json.bak").read_text() == former


@pytest.mark.parametrize(
    "change",
    [
        {"dead_man": "x"}, {"dead_man": True}, {"dead_man": None}, {"dead_man": R1}, {"dead_man": 0x2FE}, {"turbo": 1 << 40},
        {"yaw_axis": ABS_X}, {"yaw_axis": 0x3F}, {"above_center": 3}, {"axis_range": [5, 5]}, {"axis_range": [0]}, {"name": 7},
    ],
)  # fmt: skip
def test_broken_file_is_refused_with_its_name(change: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "pad.json"
    path.write_text(json.dumps({**json.loads(map_text(calibrated())), **change}))
    with pytest.raises(MalformedFile, match=r"pad\.json: does not name the controls"):
        read_map(path, GENERIC)


@pytest.mark.parametrize("text", ["", "{", "[]", "3"])
def test_file_that_is_no_object_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "pad.json"
    path.write_text(text)
    with pytest.raises(MalformedFile, match=r"pad\.json"):
        read_map(path, GENERIC)


def test_calibrated_pad_is_opened_and_a_broken_file_is_named(fake_pads: FakePads) -> None:
    told: list[str] = []
    warnings: list[str] = []
    fake_pads.plug("event5", GENERIC)
    path = map_path(fake_pads.maps, GENERIC)
    for text, opened in ((map_text(calibrated()), ["event5"]), ("{}", [])):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        pads = ConnectedPads(fake_pads.devices, fake_pads.sysfs, maps=fake_pads.maps, inform=told.append, warn=warnings.append)
        pads.scan(CONNECTED_NS)
        pads.scan(CONNECTED_NS)
        assert list(pads.pads) == opened
        pads.close()
    assert len(warnings) == 1 and str(path) in warnings[0] and "lupin teleop calibrate" in warnings[0]


def test_only_gamepads_can_be_calibrated() -> None:
    assert can_be_calibrated(pad_ids.XBOX_USB) and can_be_calibrated(GENERIC)
    assert not can_be_calibrated(pad_ids.MICROSOFT_MOUSE)
    assert not can_be_calibrated(pad_ids.DUALSHOCK4_MOTION)
