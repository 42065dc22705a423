"""The node of the gamepads on a real graph, with the drive bus behind it."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.drive import Twist, decode
from lupin_runtime.teleop.events import ABS_Y, BTN_TL, Event
from lupin_runtime.teleop.velocity import NORMAL
from tests.support import pad_ids
from tests.support.fake_pads import FakePads
from tests.support.pad_events import axis, key
from tests.support.waiting import wait_for_nothing

if TYPE_CHECKING:
    from lupin_runtime.teleop.node import PadTeleop
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

FORWARD = Twist(NORMAL.linear_mps, 0.0, 0.0)
ZERO = Twist(0.0, 0.0, 0.0)


class Rig:
    """The node, a pad of a pipe, and what arrives of both."""

    def __init__(self, host: GraphHost, fake: FakePads) -> None:
        from lupin_runtime.ros import LupinNode
        from lupin_runtime.teleop.node import PadTeleop

        self.host, self.fake = host, fake
        self.velocities: list[Twist | None] = []
        self.joy: list[Any] = []
        probe = LupinNode("probe")
        probe.subscription(graph.CMD_VEL_JOY, lambda data: self.velocities.append(decode(data)), raw=True)
        probe.subscription(graph.JOY, self.joy.append)
        self.status = probe.publisher(graph.DRIVE_STATUS)
        host.add(probe)
        folders = {"devices": fake.devices, "sysfs": fake.sysfs, "maps": fake.maps}
        self.node: PadTeleop = host.add(PadTeleop({name: str(folder) for name, folder in folders.items()}))

    def send(self, *events: Event) -> None:
        self.fake.send("event5", events)

    def now_ns(self) -> int:
        return self.node.monotonic_ns()

    def plug(self) -> None:
        """Connect the pad, and wait until its presses count."""
        self.fake.plug("event5", pad_ids.XBOX_USB)
        self.host.until_expired(lambda: self.joy, "the pad on the graph")
        self.drive()

    def drive(self) -> None:
        """Press the dead-man button, again and again until it counts, and push the stick."""
        start = len(self.velocities)

        def step() -> bool:
            for value in (0, 1):
                self.send(*axis(ABS_Y, -32768, self.now_ns()), *key(BTN_TL, value, self.now_ns()))
                wait_for_nothing(0.1, "the node to read it")
            return FORWARD in self.velocities[start:]

        self.host.until_expired(step, "the velocity of a held pad")

    def published_later(self) -> list[Twist | None]:
        """Return what is published from now on."""
        count = len(self.velocities)
        with self.host.clock.real():
            wait_for_nothing(0.5, "velocities of a pad that is not held")
        return self.velocities[count:]


@pytest.fixture
def rig(graph_host: GraphHost, fake_pads: FakePads) -> Rig:
    return Rig(graph_host, fake_pads)


def test_held_pad_drives_until_it_is_released(rig: Rig) -> None:
    rig.plug()
    rig.send(*key(BTN_TL, 0, rig.now_ns()))
    rig.host.until(lambda: rig.velocities[-1] == ZERO, what="the zero of the release")
    assert rig.published_later() == []


def test_unplugged_pad_is_silent_until_it_is_back(rig: Rig) -> None:
    rig.plug()
    rig.fake.unplug("event5")
    rig.host.until(lambda: rig.velocities[-1] == ZERO, what="the zero of the lost pad")
    assert rig.published_later() == []
    rig.joy.clear()
    rig.plug()


def test_garbage_of_a_pad_moves_nothing(rig: Rig) -> None:
    rig.fake.plug("event5", pad_ids.XBOX_USB)
    rig.host.until_expired(lambda: rig.joy, "the pad on the graph")
    for number in itertools.islice(itertools.cycle(range(256)), 40):
        rig.fake.send_bytes("event5", bytes([number]) * 997)
        wait_for_nothing(0.01, "the node to read it")
    assert [twist for twist in rig.velocities if twist != ZERO] == []
    assert rig.published_later() == []


def test_joy_tells_the_controls_of_the_pad(rig: Rig) -> None:
    rig.plug()
    rig.host.until(lambda: list(rig.joy[-1].buttons) == [1, 0], what="the held button")
    assert list(rig.joy[-1].axes) == [0.0, 1.0, 0.0]


@pytest.mark.parametrize("text", ["{", "[]", '{"locks": [3]}', '{"locks": ["e-stop engaged"]}'])
def test_status_of_the_drive_bus_ends_no_drive(rig: Rig, text: str) -> None:
    from std_msgs.msg import String

    rig.status.publish(String(data=text))
    rig.plug()
