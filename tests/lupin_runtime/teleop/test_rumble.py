"""When a gamepad rumbles, and that one which cannot is no error."""

from __future__ import annotations

import struct

import pytest

from lupin_runtime.safety.estop_monitor import ESTOP_ENGAGED
from lupin_runtime.teleop import rumble
from lupin_runtime.teleop.rumble import LOST_S, REPEAT_S, Alert, AlertRules, Rumbles, encode_rumble
from tests.support import pad_ids
from tests.support.fake_pads import FakePads

S = 1_000_000_000
REPEAT_NS, LOST_NS = int(REPEAT_S * 1e9), int(LOST_S * 1e9)


def test_engaged_estop_is_told_once() -> None:
    rules = AlertRules()
    rules.handle_status((), 0)
    assert rules.step(False, 0) is None
    for at_ns in range(0, 3 * S, S):
        rules.handle_status((ESTOP_ENGAGED,), at_ns)
        assert rules.step(False, at_ns) is (Alert.STOPPED if at_ns == 0 else None)
    rules.handle_status((), 3 * S)
    rules.handle_status((ESTOP_ENGAGED,), 3 * S)
    assert rules.step(False, 3 * S) is Alert.STOPPED


def test_held_pad_is_told_again_that_the_bus_is_locked() -> None:
    rules = AlertRules()
    rules.handle_status(("slam does not respond",), 0)
    told = [rules.step(True, at_ns) for at_ns in range(0, 3 * REPEAT_NS, REPEAT_NS // 2)]
    assert told == [Alert.REFUSED, None] * 3
    assert rules.step(False, 3 * REPEAT_NS) is None
    rules.handle_status((), 3 * REPEAT_NS)
    assert rules.step(True, 3 * REPEAT_NS) is None


def test_pad_that_moves_the_arm_is_told_again_of_a_refusal() -> None:
    rules = AlertRules()
    rules.handle_arm("the gripper does not move: its command was refused")
    assert rules.step(False, 0) is None
    told = [rules.step(False, at_ns, jogging=True) for at_ns in range(0, 2 * REPEAT_NS, REPEAT_NS // 2)]
    assert told == [Alert.REFUSED, None] * 2
    rules.handle_arm("")
    assert rules.step(False, 3 * REPEAT_NS, jogging=True) is None


def test_silent_drive_bus_is_told_once() -> None:
    rules = AlertRules()
    assert rules.step(True, 10 * LOST_NS) is None
    rules.handle_status((), 10 * LOST_NS)
    told = [rules.step(True, 10 * LOST_NS + after_ns) for after_ns in (LOST_NS, LOST_NS + 1, LOST_NS + 2)]
    assert told == [None, Alert.LOST, None]


def test_effect_is_as_long_as_the_kernel_expects() -> None:
    # sizeof(struct ff_effect): 48 bytes with pointers of 8 bytes, 44 with those of 4.
    effect = encode_rumble(Alert.STOPPED)
    assert len(effect) == {8: 48, 4: 44}[struct.calcsize("P")]
    assert struct.unpack_from("HhHHHHH", effect) == (0x50, -1, 0, 0, 0, 600, 0)
    assert struct.unpack_from("HH", effect, 16) == (0xFFFF, 0xFFFF)


def test_pad_that_cannot_rumble_is_named_once(fake_pads: FakePads) -> None:
    told: list[str] = []
    fake_pads.plug("event5", pad_ids.XBOX_USB)
    rumbles = Rumbles(fake_pads.devices, fake_pads.sysfs, told.append)
    for _ in range(2):
        rumbles.follow(["event5"])
        rumbles.play(Alert.LOST)
    assert told == ["event5 does not rumble: Inappropriate ioctl for device"]
    rumbles.close()


def test_pad_that_a_program_has_made_is_asked_nothing(fake_pads: FakePads, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    fake_pads.plug("event5", pad_ids.XBOX_USB)
    monkeypatch.setattr(rumble, "_VIRTUAL", fake_pads.sysfs.resolve())
    rumbles = Rumbles(fake_pads.devices, fake_pads.sysfs, told.append)
    rumbles.follow(["event5"])
    assert told == ["event5 does not rumble: it is made by a program"]
    rumbles.close()
