"""Pads that come and go, and that cannot be read."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from lupin_runtime.teleop import connected_pads
from lupin_runtime.teleop.connected_pads import IN_USE, ConnectedPads
from lupin_runtime.teleop.device import Device
from lupin_runtime.teleop.events import BTN_TL
from lupin_runtime.teleop.pad_state import DeadMan
from tests.support import pad_ids
from tests.support.fake_pads import FakePads
from tests.support.pad_events import CONNECTED_NS, SETTLED_NS, key

PRESS = key(BTN_TL, 0, SETTLED_NS) + key(BTN_TL, 1, SETTLED_NS)


class Rig:
    """Connected pads, and what they told."""

    def __init__(self, fake: FakePads) -> None:
        self.told: list[str] = []
        self.warnings: list[str] = []
        self.connected = ConnectedPads(fake.devices, fake.sysfs, inform=self.told.append, warn=self.warnings.append)

    def scan(self) -> list[str]:
        self.connected.scan(CONNECTED_NS)
        return list(self.connected.pads)

    def read(self) -> list[DeadMan]:
        self.connected.read(SETTLED_NS)
        return [state.dead_man for state in self.connected.states.values()]


@pytest.fixture
def rig(fake_pads: FakePads) -> Iterator[Rig]:
    made = Rig(fake_pads)
    yield made
    made.connected.close()


def test_only_the_pad_of_several_devices_is_opened(rig: Rig, fake_pads: FakePads) -> None:
    fake_pads.plug("event3", pad_ids.MICROSOFT_MOUSE)
    fake_pads.plug("event4", pad_ids.DUALSHOCK4_MOTION)
    fake_pads.plug("event5", pad_ids.DUALSHOCK4_USB, "Wireless Controller")
    (fake_pads.devices / "js0").write_bytes(b"")
    assert rig.scan() == ["event5"]
    assert rig.told == ["Wireless Controller (USB, event5) is connected: hold its left shoulder button to drive"]


def test_events_of_a_pad_change_its_state(rig: Rig, fake_pads: FakePads) -> None:
    fake_pads.plug("event5", pad_ids.XBOX_USB)
    rig.scan()
    fake_pads.send("event5", PRESS)
    assert rig.read() == [DeadMan.HELD]


def test_unplugged_pad_is_gone_and_must_be_released_after_it(rig: Rig, fake_pads: FakePads) -> None:
    fake_pads.plug("event5", pad_ids.XBOX_USB)
    rig.scan()
    fake_pads.send("event5", PRESS)
    assert rig.read() == [DeadMan.HELD]
    fake_pads.unplug("event5")
    assert rig.read() == []
    fake_pads.plug("event5", pad_ids.XBOX_BLUETOOTH)
    assert rig.scan() == ["event5"]
    fake_pads.send("event5", key(BTN_TL, 1, SETTLED_NS))
    assert rig.read() == [DeadMan.UNKNOWN]
    assert [text.partition(") ")[2].partition(":")[0] for text in rig.told] == ["is connected", "is gone", "is connected"]


def test_device_replaced_under_its_name_is_examined_anew(rig: Rig, fake_pads: FakePads) -> None:
    fake_pads.plug("event5", pad_ids.MICROSOFT_MOUSE)
    assert rig.scan() == []
    fake_pads.unplug("event5")
    fake_pads.plug("event6", pad_ids.MICROSOFT_MOUSE)  # may get the number of the file that is gone
    fake_pads.plug("event5", pad_ids.XBOX_USB)
    assert rig.scan() == ["event5"]


def test_unreadable_pad_is_named_once_with_what_helps(rig: Rig, fake_pads: FakePads, monkeypatch: pytest.MonkeyPatch) -> None:
    class Refused(Device):
        def __init__(self, path: Path) -> None:
            raise PermissionError(13, "Permission denied", str(path))

    fake_pads.plug("event5", pad_ids.XBOX_USB, "X-Box One pad")
    with monkeypatch.context() as patch:
        patch.setattr(connected_pads, "Device", Refused)
        assert rig.scan() == rig.scan() == []
    assert rig.warnings == [
        "cannot read X-Box One pad (USB, event5): Permission denied; "
        "add yourself to the group input, and log in again: sudo usermod -aG input $USER"
    ]
    assert rig.scan() == ["event5"]


def test_pad_drives_one_robot(rig: Rig, fake_pads: FakePads) -> None:
    fake_pads.plug("event5", pad_ids.XBOX_USB, "A pad")
    assert rig.scan() == ["event5"]
    other = Rig(fake_pads)
    assert other.scan() == other.scan() == other.scan() == []
    assert other.warnings == [f"A pad (USB, event5) is not used: {IN_USE}"]
    rig.connected.close()
    assert other.scan() == ["event5"]
    other.connected.close()


def test_advice_on_the_robot_names_no_command_of_a_laptops_run(rig: Rig, fake_pads: FakePads, tmp_path: Path) -> None:
    fake_pads.plug("event5", pad_ids.XBOX_USB, "A pad")
    assert rig.scan() == ["event5"]
    warnings: list[str] = []
    other = ConnectedPads(
        fake_pads.devices, fake_pads.sysfs, maps=tmp_path, inform=warnings.append, warn=warnings.append, on_robot=True
    )
    for _ in range(3):
        other.scan(CONNECTED_NS)
    path = fake_pads.devices / "event5"
    assert warnings == [
        "A pad (USB, event5) is not used: it already drives for another program of the robot; "
        f"end that, which this names: sudo fuser -v {path}"
    ]
    other.close()


def test_broken_or_missing_folders_are_no_error(rig: Rig, fake_pads: FakePads, tmp_path: Path) -> None:
    fake_pads.plug("event5", pad_ids.XBOX_USB)
    (fake_pads.sysfs / "event5" / "device" / "id" / "vendor").write_text("none\n")
    assert rig.scan() == []
    nowhere = ConnectedPads(tmp_path / "no", tmp_path / "no", inform=rig.told.append, warn=rig.warnings.append)
    nowhere.scan(CONNECTED_NS)
    assert (nowhere.pads, rig.told, rig.warnings) == ({}, [], [])


def test_flood_and_part_of_an_event_are_no_error(rig: Rig, fake_pads: FakePads) -> None:
    fake_pads.plug("event5", pad_ids.XBOX_USB)
    rig.scan()
    fake_pads.send("event5", PRESS)
    assert rig.read() == [DeadMan.HELD]
    fake_pads.send_bytes("event5", b"\xff" * 60_001)
    assert [rig.read() for _ in range(5)] == [[DeadMan.UNKNOWN]] * 5
