"""Driving from a terminal, on a real graph."""

from __future__ import annotations

import io
import json
import os
import pty
import termios
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli.run.teleop_session import MAX_BYTES, TeleopSession, _read_keys, drive
from lupin_cli.safe_console import SafeConsole
from lupin_runtime import graph
from lupin_runtime.drive import ZERO, Twist, decode
from lupin_runtime.teleop import connected_pads
from lupin_runtime.teleop.events import ABS_Y, BTN_EAST, BTN_TL
from lupin_runtime.teleop.velocity import NORMAL, TURBO
from tests.support import pad_ids
from tests.support.fake_pads import FakePads
from tests.support.pad_events import axis, key
from tests.support.waiting import wait_for_nothing

if TYPE_CHECKING:
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

FORWARD, FAST = Twist(NORMAL.linear_mps, 0.0, 0.0), Twist(TURBO.linear_mps, 0.0, 0.0)
LOCKED = {
    "winner": None,
    "locks": ["e-stop engaged"],
    "inputs": {"joy": {"age_s": None, "why": "no message received", "rejected": 0}},
}


class Rig:
    """A node for the session, and what arrives of what it sends."""

    def __init__(self, host: GraphHost) -> None:
        from lupin_runtime.ros import LupinNode

        self.host = host
        self.node = host.add(LupinNode("session"))
        self.by_keys: list[Twist | None] = []
        self.by_pads: list[Twist | None] = []
        probe = LupinNode("probe")
        probe.subscription(graph.CMD_VEL_MANUAL, lambda data: self.by_keys.append(decode(data)), raw=True)
        probe.subscription(graph.CMD_VEL_JOY, lambda data: self.by_pads.append(decode(data)), raw=True)
        self.rates: list[dict[str, float]] = []
        probe.subscription(graph.ARM_JOG, lambda message: self.rates.append(dict(zip(message.name, message.velocity))))
        self._status = probe.publisher(graph.DRIVE_STATUS)
        self._arm_status = probe.publisher(graph.ARM_STATUS)
        host.add(probe)

    def handle_waiting(self) -> None:
        """Do what a RosSession does; here the host spins the node."""

    def publish_status(self, status: dict[str, Any]) -> None:
        from std_msgs.msg import String

        self._status.publish(String(data=json.dumps(status)))

    def publish_arm_status(self, text: str) -> None:
        from std_msgs.msg import String

        self._arm_status.publish(String(data=text))


@pytest.fixture
def rig(graph_host: GraphHost) -> Rig:
    return Rig(graph_host)


@pytest.fixture
def fake_pads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[FakePads]:
    """The input devices of this computer."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    made = FakePads(tmp_path)
    monkeypatch.setattr(connected_pads, "DEVICES", made.devices)
    monkeypatch.setattr(connected_pads, "SYSFS", made.sysfs)
    yield made
    made.close()


def shown(session: TeleopSession) -> str:
    console = SafeConsole(file=io.StringIO(), width=120)
    console.print(session.view())
    return str(console.file.getvalue())  # type: ignore[attr-defined]


def test_key_drives_and_its_end_is_followed_by_silence(rig: Rig) -> None:
    session = TeleopSession(rig.node, reads_pads=False)

    def press() -> bool:
        session.step(["w"], time.monotonic_ns())
        return FORWARD in rig.by_keys

    rig.host.until(press, what="the velocity of the key")
    assert "sends forward 0.20 m/s" in shown(session)

    def release() -> bool:
        session.step([], time.monotonic_ns())
        return rig.by_keys[-1] == ZERO

    rig.host.until(release, what="the zero after the key")
    count = len(rig.by_keys)
    for _ in range(20):
        session.step([], time.monotonic_ns())
        time.sleep(0.02)
    assert len(rig.by_keys) == count
    assert rig.by_pads == []


def test_gamepad_drives_if_the_run_does_not_read_it(rig: Rig, fake_pads: FakePads) -> None:
    fake_pads.plug("event5", pad_ids.XBOX_USB)
    session = TeleopSession(rig.node, reads_pads=True)

    def hold() -> bool:
        for value in (0, 1):
            now_ns = time.monotonic_ns()
            fake_pads.send("event5", axis(ABS_Y, -32768, now_ns) + key(BTN_TL, value, now_ns))
            session.step([], now_ns)
        return FORWARD in rig.by_pads

    rig.host.until(hold, what="the velocity of the gamepad")
    assert "sends forward 0.20 m/s" in shown(session)
    session.close()
    rig.host.until(lambda: rig.by_pads[-1] == ZERO, what="the zero at the end")


def test_gamepad_moves_the_arm_if_the_run_does_not_read_it(rig: Rig, fake_pads: FakePads) -> None:
    fake_pads.plug("event5", pad_ids.XBOX_USB)
    session = TeleopSession(rig.node, reads_pads=True)

    def press() -> bool:
        for code, value in ((BTN_TL, 0), (BTN_EAST, 0), (BTN_EAST, 1)):
            now_ns = time.monotonic_ns()
            fake_pads.send("event5", key(code, value, now_ns))
            session.step([], now_ns)
        return any(rates["shoulder_pan_joint"] > 0.0 for rates in rig.rates)

    rig.host.until(press, what="the rates of the gamepad")
    assert not any(rig.rates[0].values())
    assert "sends arm: pan +1.50 rad/s" in shown(session)
    session.close()
    rig.host.until(lambda: not any(rig.rates[-1].values()), what="the rest at the end")
    assert rig.by_pads == []


@pytest.mark.parametrize(
    ("status", "expected"),
    [
        ({}, "at rest"),
        ({"moving": True}, "moves"),
        ({"holder": "playing wave"}, "is reserved: playing wave"),
        ({"holder": "jogging", "jogged_by": "the gamepad of bench"}, "obeys the gamepad of bench"),
        ({"jog_refusal": "the arm is reserved: playing wave"}, "is not moved by gamepad: the arm is reserved: playing wave"),
        ({"limp": True}, "is limp"),
        ({"alarms": ["the arm's elbow does not follow", 7]}, "the arm's elbow does not follow"),
    ],
)
def test_view_shows_what_the_arm_does(rig: Rig, status: dict[str, Any], expected: str) -> None:
    session = TeleopSession(rig.node, reads_pads=False)
    assert "arm        is silent" in shown(session)
    rig.publish_arm_status("{")
    rig.publish_arm_status(json.dumps(status))
    rig.host.until(lambda: session.arm_status, what="the arm's status")
    assert expected in shown(session)


def test_view_shows_why_the_drive_bus_is_locked(rig: Rig) -> None:
    session = TeleopSession(rig.node, reads_pads=False)
    assert "is silent; see what runs with: lupin status" in shown(session)
    rig.publish_status(LOCKED)
    rig.host.until(lambda: session.status, what="the status")
    assert "locked: e-stop engaged" in shown(session)
    assert "no message received" in shown(session)


@pytest.mark.parametrize(
    ("typed", "is_late", "expected"),
    [
        (b"ww", False, ["w", "w"]),
        (b"", False, []),
        (b"", True, []),
        (b"w" * 8, True, []),
        (b"w" * (MAX_BYTES + 5), True, []),  # also what a second reading has
        (b"w" * (MAX_BYTES + 5) + b"x", True, None),
        (b"x", True, None),
    ],
)
def test_keys_typed_while_it_was_held_up_only_end_it(
    monkeypatch: pytest.MonkeyPatch, typed: bytes, is_late: bool, expected: list[str] | None
) -> None:
    reader, writer = os.pipe()
    os.write(writer, typed)
    with os.fdopen(reader) as terminal:
        monkeypatch.setattr("sys.stdin", terminal)
        assert _read_keys(is_late) == expected
    os.close(writer)


def test_keys_of_a_terminal_drive_until_x(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    master, slave = pty.openpty()
    before = termios.tcgetattr(slave)
    over = threading.Event()

    def type_keys() -> None:
        while FAST not in rig.by_keys and not over.wait(0.05):
            os.write(master, b"W")
        os.write(master, b"x")

    typist = threading.Thread(target=type_keys)
    with os.fdopen(slave) as terminal:
        monkeypatch.setattr("sys.stdin", terminal)
        typist.start()
        try:
            drive(rig, reads_pads=False)  # type: ignore[arg-type]
        finally:
            over.set()
            typist.join()
        assert termios.tcgetattr(slave) == before
    os.close(master)
    rig.host.until(lambda: rig.by_keys[-1] == ZERO, what="the zero at the end")
    count = len(rig.by_keys)
    wait_for_nothing(0.2, "a velocity after the end")
    assert len(rig.by_keys) == count
