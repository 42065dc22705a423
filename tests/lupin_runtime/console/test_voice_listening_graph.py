"""Stops that the console hears in a page's sound, on a real graph with the listener's process."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import psutil
import pytest

from lupin_runtime import graph
from lupin_runtime.console import voice_listener, voice_offline
from lupin_runtime.voice.speech import SpeechUnavailable
from tests.support.console_browser import Browser, stop_texts
from tests.support.fake_listener import COMMAND, SILENCE, SPOKEN_DRIVE, sound_of
from tests.support.voice_client import VoiceClient, journal, serve_console
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from lupin_runtime.ros import LupinNode
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

ZERO = (0.0, 0.0)


class Robot:
    """Records velocities."""

    def __init__(self, host: GraphHost, console: Console) -> None:
        from lupin_runtime.ros import LupinNode

        node: LupinNode = LupinNode("robot")
        self.velocities: list[tuple[float, float]] = []
        node.subscription(graph.CMD_VEL_MANUAL, lambda m: self.velocities.append((m.linear.x, m.angular.z)))
        host.add(node)
        host.until(lambda: console.count_subscribers(graph.CMD_VEL_MANUAL.name), what="the connection")

    @property
    def is_driven(self) -> bool:
        return bool(self.velocities) and self.velocities[-1] != ZERO

    def rests(self) -> bool:
        return self.velocities[-3:] == [ZERO] * 3


def fail_to_speak() -> NoReturn:
    raise SpeechUnavailable("no espeak-ng")


@pytest.fixture
def console(graph_host: GraphHost, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Console]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(voice_listener, "COMMAND", COMMAND)
    monkeypatch.setattr(voice_listener, "missing_packages", lambda: "")
    monkeypatch.setattr(voice_offline, "Speaker", fail_to_speak)
    node = serve_console(graph_host, tmp_path)
    yield node
    node.before_shutdown()


def connect(console: Console, folder: Path, role: str = "operator") -> VoiceClient:
    browser = Browser(console.port, proxied=True)
    browser.post("/_api/pair", code=json.loads((folder / "console.json").read_text())["codes"][role])
    return VoiceClient(browser)


def listen(voice: VoiceClient, mode: str = "stops") -> psutil.Process:
    """Have the console listen, and return the listener's process."""
    voice.client.received.clear()  # of an earlier listener, which was ready, too
    voice.send(listen={"mode": mode})
    voice.wait_for_state(lambda state: state["listener"]["state"] == "ready")
    [process] = [each for each in psutil.Process().children() if "tests.support.fake_listener" in " ".join(each.cmdline())]
    return process


def begin_burst(host: GraphHost, voice: VoiceClient, robot: Robot) -> None:
    voice.turn()
    assert voice.call("drive", linear_x=0.2, duration_s=2.0)["ok"]
    host.until(lambda: robot.is_driven, what="motion")


def test_stop_in_the_sound_of_a_page_stops_the_robot(graph_host: GraphHost, console: Console, tmp_path: Path) -> None:
    robot, voice, watcher = Robot(graph_host, console), connect(console, tmp_path), Browser(console.port)
    process = listen(voice)
    begin_burst(graph_host, voice, robot)
    reasons: list[str] = []
    while not reasons:
        voice.client.socket.send(sound_of("stop"))
        reasons = stop_texts(watcher.get("/_api/session"))
    graph_host.until(robot.rests, what="the end of the burst")
    assert "voice agent" in reasons[0]
    assert any(line["what"].startswith("voice stop heard 'stop'") for line in journal(tmp_path))
    voice.close()
    wait_until(lambda: not process.is_running(), "the end of the listener")


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_listener_that_fails_changes_nothing_else(
    graph_host: GraphHost, console: Console, tmp_path: Path, how: signal.Signals
) -> None:
    robot, voice = Robot(graph_host, console), connect(console, tmp_path)
    process = listen(voice)
    begin_burst(graph_host, voice, robot)
    os.kill(process.pid, how)
    if how is signal.SIGKILL:
        voice.wait_for_state(lambda state: state["listener"]["state"] == "failed")
    else:
        voice.client.socket.send(SILENCE)
        assert voice.call("stop")["ok"]
    graph_host.until(robot.rests, what="the end of the burst")
    voice.turn()
    assert voice.call("query_state", fields=["estop"])["ok"]
    if how is signal.SIGKILL:
        listen(voice)
    voice.close()
    wait_until(lambda: not process.is_running(), "the end of the listener")


def speak(voice: VoiceClient, identifier: str, text: str) -> None:
    """Say a sentence in a turn."""
    voice.send(turn={"id": identifier, "by": "speech", "ended": False})
    for _ in range(8):
        voice.client.socket.send(sound_of(text))
    voice.send(turn={"id": identifier, "by": "speech", "ended": True})


def test_spoken_sentence_is_carried_out_without_a_model(graph_host: GraphHost, console: Console, tmp_path: Path) -> None:
    robot, voice = Robot(graph_host, console), connect(console, tmp_path)
    listen(voice, "commands")
    speak(voice, "1", SPOKEN_DRIVE)
    reply = voice.client.wait(lambda message: "reply" in message)["reply"]
    assert reply["done"] and reply["call"]["tool"] == "drive"
    graph_host.until(robot.rests, what="the end of the burst")
    assert (0.2, 0.0) in robot.velocities
    voice.close()


def test_microphone_of_a_viewer_is_not_heard(console: Console, tmp_path: Path) -> None:
    voice, watcher = connect(console, tmp_path, "viewer"), Browser(console.port)
    voice.send(listen={"mode": "stops"})
    assert "is a viewer" in voice.client.wait(lambda message: "error" in message)["error"]
    for _ in range(40):
        voice.client.socket.send(sound_of("stop"))
    assert voice.call("query_state", fields=["estop"])["estop"]["active"] is False
    assert stop_texts(watcher.get("/_api/session")) == []
    assert not any("fake_listener" in " ".join(each.cmdline()) for each in psutil.Process().children())
    voice.close()
