"""The voice agent navigates with this repository's navigation: goals from a pose, and their cancellation."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.support.console_browser import Browser
from tests.support.voice_client import VoiceClient, serve_console

if TYPE_CHECKING:
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


@pytest.fixture
def voice(graph_host: GraphHost, tmp_path: Path, pilot: Any) -> Iterator[VoiceClient]:
    from lupin_runtime import graph

    console = serve_console(graph_host, tmp_path)
    browser = Browser(console.port)
    browser.get("/")
    client = VoiceClient(browser)
    client.turn()
    pilot.host.until(lambda: console.count_subscribers(graph.GOAL_POSE.name), what="the navigation")
    yield client
    client.close()
    console.before_shutdown()


def test_robot_is_sent_forward_and_cancelled_by_voice(pilot: Any, voice: VoiceClient) -> None:
    def is_known() -> bool:
        voice.turn()
        return "confirm" in voice.call("nav_forward", forward_m=2.6)

    pilot.host.until(is_known, what="the pose")
    done = voice.confirm("nav_forward", forward_m=2.6)
    assert done["ok"] and done["goal"]["x"] == pytest.approx(done["from"]["x"] + 2.6, abs=0.01)
    pilot.host.until(pilot.driving, what="motion to the goal")
    cancelled = voice.call("nav_cancel")
    assert cancelled == {"ok": True, "action": "nav_cancel", "response": "goals that are being canceled: 1"}
    pilot.host.until(lambda: pilot.at_rest() and pilot.ends_with_zero(), what="rest")
    assert voice.call("nav_cancel")["response"] == "goals that are being canceled: 0"
