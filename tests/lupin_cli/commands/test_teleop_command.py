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
from lupin_cli.run import pad_test
from lupin_runtime.teleop.events import ABS_Y, BTN_TL
from tests.support import pad_ids
from tests.support.fake_pads import FakePads
from tests.support.pad_events import axis, key


@pytest.fixture
def fake_pads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[FakePads]:
    """The input devices of this computer, without runs."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    made = FakePads(tmp_path)
    monkeypatch.setattr(pad_test, "DEVICES", made.devices)
    monkeypatch.setattr(pad_test, "SYSFS", made.sysfs)
    yield made
    made.close()


def test_without_a_gamepad_the_test_fails_with_advice(fake_pads: FakePads) -> None:
    fake_pads.plug("event3", pad_ids.MICROSOFT_MOUSE)
    done = CliRunner().invoke(app, ["test", "--seconds", "0.1"])
    assert done.exit_code == 1 and "cat /proc/bus/input/devices" in done.output


def test_events_are_shown_with_what_they_would_command(fake_pads: FakePads) -> None:
    fake_pads.plug("event5", pad_ids.XBOX_USB)
    now_ns = time.monotonic_ns()
    fake_pads.send("event5", axis(ABS_Y, -32768, now_ns) + key(BTN_TL, 0, now_ns))
    done = CliRunner().invoke(app, ["test", "--seconds", "0.3", "--json"])
    shown = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    assert done.exit_code == 0
    assert [(line["control"], line["value"], line["dead_man"], line["velocity"]) for line in shown] == [
        ("forward", -32768, "released", None),
        ("dead-man button", 0, "released", None),
    ]


def test_held_gamepad_shows_its_velocity(fake_pads: FakePads) -> None:
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
