"""Asking for the controls of a gamepad that is made of a pipe."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from lupin_cli.run.pad_calibration import CalibrationFailed, calibrate, find_candidates
from lupin_runtime.teleop.calibration import STEPS
from lupin_runtime.teleop.events import ABS_X, ABS_Y, ABS_Z, Event
from tests.support import pad_ids
from tests.support.fake_pads import FakePads
from tests.support.pad_events import axis, key

L1, R1 = 0x134, 0x135
# Using and letting go of each control, in the order of the steps.
USES: list[tuple[list[Event], list[Event]]] = [
    *((key(code, 1, 0), key(code, 0, 0)) for code in (L1, R1)),
    *((axis(code, 0, 0) + axis(code, -32768, 0), axis(code, 0, 0)) for code in (ABS_Y, ABS_X, ABS_Z)),
]


@pytest.fixture
def fake_pads(tmp_path: Path) -> Iterator[FakePads]:
    made = FakePads(tmp_path)
    yield made
    made.close()


def test_gamepads_are_found_also_if_the_table_lacks_them(fake_pads: FakePads) -> None:
    fake_pads.plug("event3", pad_ids.MICROSOFT_MOUSE)
    fake_pads.plug("event4", pad_ids.DUALSHOCK4_MOTION)
    fake_pads.plug("event5", pad_ids.DUALSHOCK4_GENERIC, "Wireless Controller")
    found = find_candidates(fake_pads.devices, fake_pads.sysfs)
    assert [(each.path.name, each.label) for each in found] == [("event5", "Wireless Controller")]
    assert find_candidates(fake_pads.devices / "no", fake_pads.sysfs) == []


def test_each_control_is_asked_for_and_learned(fake_pads: FakePads) -> None:
    fake_pads.plug("event5", pad_ids.DUALSHOCK4_GENERIC)
    (candidate,) = find_candidates(fake_pads.devices, fake_pads.sysfs)
    asked: list[str] = []
    over = threading.Event()

    def use_controls() -> None:
        while not over.is_set():
            if not asked:
                over.wait(0.01)
                continue
            use, let_go = USES[len(asked) - 1]
            fake_pads.send("event5", use)
            over.wait(0.3)
            fake_pads.send("event5", let_go)
            over.wait(0.1)

    person = threading.Thread(target=use_controls)
    person.start()
    try:
        row = calibrate(candidate, 20.0, asked.append)
    finally:
        over.set()
        person.join()
    assert asked == [step.prompt for step in STEPS]
    assert (row.dead_man, row.turbo, row.axes) == (L1, R1, (ABS_X, ABS_Y, ABS_Z))


def test_control_that_is_not_used_in_time_is_named(fake_pads: FakePads) -> None:
    fake_pads.plug("event5", pad_ids.DUALSHOCK4_GENERIC)
    (candidate,) = find_candidates(fake_pads.devices, fake_pads.sysfs)
    with pytest.raises(CalibrationFailed, match=r"left shoulder button: .* nothing was noticed within 0\.1 s"):
        calibrate(candidate, 0.1, lambda _: None)
