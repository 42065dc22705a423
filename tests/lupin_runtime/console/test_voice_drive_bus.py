"""A burst of the voice agent on the drive bus: it reaches the base, and the base stops although the console hangs."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from lupin_runtime import graph
from tests.support.console_browser import Browser
from tests.support.voice_client import VoiceClient, serve_console

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

REST_S = 0.6  # longer than the bus waits for motion on its input to be over


@pytest.fixture
def console(graph_host: GraphHost, tmp_path: Path) -> Iterator[Console]:
    node = serve_console(graph_host, tmp_path)
    yield node
    node.before_shutdown()


@pytest.fixture
def voice(console: Console) -> Iterator[VoiceClient]:
    browser = Browser(console.port)
    browser.get("/")
    client = VoiceClient(browser)
    yield client
    client.close()


@pytest.fixture
def base(graph_host: GraphHost, console: Console) -> list[float]:
    """The forward velocities that the base gets from the drive bus, which a released e-stop has unlocked."""
    from std_msgs.msg import Bool

    from lupin_runtime.drive.node import TwistMux
    from lupin_runtime.ros import LupinNode

    received: list[float] = []
    node = LupinNode("base")
    node.subscription(graph.CMD_VEL_SINK_SIM, lambda message: received.append(message.linear.x))
    estop = node.publisher(graph.ESTOP_STATE)
    node.create_timer(0.1, lambda: estop.publish(Bool(data=False)))
    graph_host.add(node)
    graph_host.add(TwistMux({}))
    graph_host.until(lambda: received and console.count_subscribers(graph.CMD_VEL_MANUAL.name), what="the bus")
    return received


def drive_until_moving(host: GraphHost, voice: VoiceClient, base: list[float]) -> None:
    """Drive until the bus lets a burst pass: once it is unlocked and its input was at rest."""

    def moves() -> bool:
        voice.turn()
        assert voice.call("drive", linear_x=0.2, duration_s=2.0)["ok"]
        for _ in range(20):
            threading.Event().wait(0.02)
            if base[-1] > 0.0:
                return True
        voice.call("stop")
        threading.Event().wait(REST_S)
        return False

    host.until(moves, what="motion at the base")


def test_burst_reaches_the_base_and_ends(graph_host: GraphHost, voice: VoiceClient, base: list[float]) -> None:
    with graph_host.clock.real():  # the bus waits until its input has rested for a time
        drive_until_moving(graph_host, voice, base)
        graph_host.until(lambda: base[-1] == 0.0, what="zero at the base")
    assert max(base) == pytest.approx(0.2)


def test_base_stops_although_the_console_hangs_in_a_burst(
    graph_host: GraphHost, voice: VoiceClient, base: list[float], console: Console
) -> None:
    go_on = threading.Event()
    with graph_host.clock.real():
        drive_until_moving(graph_host, voice, base)
        console._server._loop.call_soon_threadsafe(go_on.wait, 20.0)
        try:
            graph_host.until(lambda: base[-1] == 0.0, what="zero at the base")
        finally:
            go_on.set()
