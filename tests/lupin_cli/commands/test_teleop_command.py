"""`lupin teleop`."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lupin_cli.commands.teleop import app
from lupin_cli.run import pad_calibration
from lupin_runtime.teleop import connected_pads, pad_state
from lupin_runtime.teleop.events import ABS_Y, BTN_TL
from lupin_runtime.teleop.pad_maps import find_map
from tests.support import pad_ids
from tests.support.fake_pads import FakePads
from tests.support.pad_events import axis, key


@pytest.fixture
def fake_pads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[FakePads]:
    """The input devices of this computer, without runs."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    made = FakePads(tmp_path)
    monkeypatch.setattr(connected_pads, "DEVICES", made.devices)
    monkeypatch.setattr(connected_pads, "SYSFS", made.sysfs)
    yield made
    made.close()


def test_without_a_gamepad_the_test_fails_with_advice(fake_pads: FakePads) -> None:
    fake_pads.plug("event3", pad_ids.MICROSOFT_MOUSE)
    done = CliRunner().invoke(app, ["test", "--seconds", "0.1"])
    assert done.exit_code == 1 and "cat /proc/bus/input/devices" in done.output


def test_events_are_shown_with_what_they_would_command(fake_pads: FakePads) -> None:
    fake_pads.plug("event5", pad_ids.XBOX_USB)
    supply = fake_pads.sysfs / "event5" / "device" / "device" / "power_supply" / "battery"
    supply.mkdir(parents=True)
    (supply / "capacity").write_text("40\n")
    now_ns = time.monotonic_ns()
    fake_pads.send("event5", axis(ABS_Y, -32768, now_ns) + key(BTN_TL, 0, now_ns))
    done = CliRunner().invoke(app, ["test", "--seconds", "0.3", "--json"])
    shown = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    assert done.exit_code == 0
    assert "A pad (USB, event5) has a battery: 40 %" in done.output
    assert [(line["control"], line["value"], line["dead_man"], line["velocity"]) for line in shown] == [
        ("forward", -32768, "released", None),
        ("dead-man button", 0, "released", None),
    ]


def test_held_gamepad_shows_its_velocity(fake_pads: FakePads, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pad_state, "SETTLE_S", 0.0)
    monkeypatch.setattr(pad_state, "STALE_S", 20.0)
    fake_pads.plug("event5", pad_ids.XBOX_USB)
    over = threading.Event()

    def hold() -> None:
        while not over.wait(0.1):
            for value in (0, 1):
                fake_pads.send("event5", axis(ABS_Y, -32768 + value, time.monotonic_ns()))
                fake_pads.send("event5", key(BTN_TL, value, time.monotonic_ns()))

    sender = threading.Thread(target=hold)
    sender.start()
    try:
        done = CliRunner().invoke(app, ["test", "--seconds", "2"])
    finally:
        over.set()
        sender.join()
    assert "would send forward 0.20 m/s, left 0.00 m/s, turn left 0.00 rad/s" in done.output


def test_driving_needs_a_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    done = CliRunner().invoke(app, [])
    assert done.exit_code == 2 and "needs a terminal" in done.output


def test_calibration_needs_one_gamepad(fake_pads: FakePads) -> None:
    done = CliRunner().invoke(app, ["calibrate"])
    assert done.exit_code == 2 and "expected one gamepad, found 0" in done.output
    for name in ("event5", "event6"):
        fake_pads.plug(name, pad_ids.XBOX_USB)
    done = CliRunner().invoke(app, ["calibrate"])
    assert done.exit_code == 2 and "choose one with --device: event5 (A pad), event6 (A pad)" in done.output


def test_calibration_without_any_input_ends_in_time(fake_pads: FakePads) -> None:
    fake_pads.plug("event5", pad_ids.XBOX_USB)
    done = CliRunner().invoke(app, ["calibrate", "--timeout", "0.1"])
    assert done.exit_code == 4 and "nothing was noticed within 0.1 s" in done.output
    assert not fake_pads.maps.exists()


def test_calibration_is_written_with_a_backup(fake_pads: FakePads, monkeypatch: pytest.MonkeyPatch) -> None:
    row = find_map(pad_ids.XBOX_USB)
    monkeypatch.setattr(pad_calibration, "calibrate", lambda *_: row)
    fake_pads.plug("event5", pad_ids.XBOX_USB)
    done = CliRunner().invoke(app, ["calibrate", "--dry-run"])
    assert done.exit_code == 0 and json.loads(done.stdout)["dead_man"] == BTN_TL
    assert not fake_pads.maps.exists()
    path = fake_pads.maps / "045e-0b12-usb.json"
    for said in (f"wrote {path}\n", f"wrote {path}; the former one is {path}.bak\n"):
        done = CliRunner().invoke(app, ["calibrate"])
        assert done.exit_code == 0 and said in done.output


def test_calibration_is_refused_while_a_run_reads_gamepads(fake_pads: FakePads, monkeypatch: pytest.MonkeyPatch) -> None:
    class Live:
        id = "20260101-120000"

        def state(self) -> dict[str, object]:
            return {"stages": [{"name": "joystick"}]}

    fake_pads.plug("event5", pad_ids.XBOX_USB)
    monkeypatch.setattr("lupin_runtime.stack.runs.live_runs", lambda: [Live()])
    done = CliRunner().invoke(app, ["calibrate"])
    assert done.exit_code == 3 and "end it first: lupin down" in done.output
