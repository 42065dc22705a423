"""`lupin voice` with a console on a real graph."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from tests.support.voice_client import journal, serve_console

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


@pytest.fixture
def console(graph_host: GraphHost, tmp_path: Path) -> Iterator[Console]:
    node = serve_console(graph_host, tmp_path)
    yield node
    node.before_shutdown()


@pytest.fixture
def velocities(graph_host: GraphHost, console: Console) -> list[float]:
    """What a robot receives that listens to velocities and goals."""
    from lupin_runtime.ros import LupinNode

    received: list[float] = []
    node = LupinNode("robot")
    node.subscription(graph.CMD_VEL_MANUAL, lambda message: received.append(message.linear.x))
    node.subscription(graph.GOAL_POSE, lambda _: None)
    graph_host.add(node)
    listened = (graph.CMD_VEL_MANUAL.name, graph.GOAL_POSE.name)
    graph_host.until(lambda: all(map(console.count_subscribers, listened)), what="the robot")
    return received


def speak(host: GraphHost, console: Console, tmp_path: Path, *words: str, typed: str = "") -> tuple[int, list[dict[str, Any]]]:
    """Run `lupin voice --json`, while the graph goes on; return its status and its replies."""
    command = [sys.executable, "-m", "lupin_cli.app", "voice", "--json", "--console", f"127.0.0.1:{console.port}", *words]
    environment = {**os.environ, "XDG_STATE_HOME": str(tmp_path)}
    with ThreadPoolExecutor(1) as pool:
        running = pool.submit(
            subprocess.run, command, input=typed, capture_output=True, text=True, timeout=60, check=False, env=environment
        )
        done = host.until(lambda: running.result() if running.done() else None, what="the command")
    return done.returncode, [json.loads(line) for line in done.stdout.splitlines()]


def test_sentences_go_through_the_envelope(graph_host: GraphHost, console: Console, tmp_path: Path) -> None:
    typed = "slower\nlist the locations\ngo to home\nno\nyes\n"
    status, replies = speak(graph_host, console, tmp_path, "--text", typed=typed)
    slower, listed, asked, refused, late = replies
    assert slower["response"]["value"] == 0.5 and listed["response"]["locations"][0]["name"] == {"untrusted": "home"}
    assert asked["read_back"] == "navigate to the location home" and not asked["done"]
    assert refused["message"].startswith("canceled") and "nothing waits" in late["message"].lower() and status == 1
    assert "voice cancel" in [row["what"] for row in journal(tmp_path)]


@pytest.mark.usefixtures("velocities")
def test_read_back_is_confirmed_by_the_next_line(graph_host: GraphHost, console: Console, tmp_path: Path) -> None:
    status, [asked, done] = speak(graph_host, console, tmp_path, "--text", typed="go to home\ny\n")
    assert not asked["done"] and status == 0 and done["response"] == {
        "ok": True, "action": "nav_goto_named", "name": {"untrusted": "home"}, "x": 0.0, "y": 0.0, "yaw": 0.0,
    }  # fmt: skip


def test_only_sentence_without_an_answer_is_not_done(graph_host: GraphHost, console: Console, tmp_path: Path) -> None:
    status, [asked] = speak(graph_host, console, tmp_path, "go to home")
    assert status == 1 and asked["read_back"] == "navigate to the location home"


def test_stop_word_engages_the_stop_of_the_console(graph_host: GraphHost, console: Console, tmp_path: Path) -> None:
    status, [reply] = speak(graph_host, console, tmp_path, "--text", "please do not stop")
    assert status == 0 and reply["call"]["tool"] == "engage_estop" and reply["response"]["ok"]
    status, [reply] = speak(graph_host, console, tmp_path, "drive forward at 0.1 m/s for 1 s")
    assert status == 1 and reply["response"]["blocked"]


def test_burst_is_carried_out_to_its_end(
    graph_host: GraphHost, console: Console, velocities: list[float], tmp_path: Path
) -> None:
    status, [reply] = speak(graph_host, console, tmp_path, "drive forward at 0.1 m/s for 0.3 s")
    assert status == 0 and reply["response"]["linear_x"] == 0.1 and reply["response"]["duration_s"] == 0.3
    graph_host.until(lambda: velocities[-1] == 0.0, what="the end")
    assert velocities.count(0.1) >= 4  # in 0.3 s at 20 Hz: it was not cut off by the end of the connection
