"""`lupin voice` with a console on a real graph."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli.run import voice_connection
from lupin_cli.run.console_pairing import Consent, reach_console
from lupin_cli.run.known_consoles import ConsoleAddress
from lupin_cli.run.voice_session import Options, run_session
from lupin_runtime import graph
from lupin_runtime.console import origin, request_rules
from lupin_runtime.console.sessions import Sessions
from lupin_runtime.voice.english import ENGLISH
from tests.support.voice_client import journal, serve_console

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


@pytest.fixture
def console(graph_host: GraphHost, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Console]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))  # of the certificates, and of what was paired
    node = serve_console(graph_host, tmp_path, tls=True)
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


def test_letters_answer_in_every_language(graph_host: GraphHost, console: Console, tmp_path: Path) -> None:
    typed = "ga naar home\nn\nj\n"
    status, [asked, refused, late] = speak(graph_host, console, tmp_path, "--text", "--language", "nl", typed=typed)
    assert asked["read_back"] and refused["message"].startswith("canceled") and not late["done"] and status == 1


def test_what_may_be_meant_is_done_after_a_yes(graph_host: GraphHost, console: Console, tmp_path: Path) -> None:
    status, [asked, done] = speak(graph_host, console, tmp_path, "--text", typed="slower?\ny\n")
    assert not asked["done"] and asked["read_back"] == "set the speed cap to 0.5"
    assert status == 0 and done["response"]["value"] == 0.5


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


# -- the console of another computer -----------------------------------------------------------------------------------
@pytest.fixture
def other_computer(monkeypatch: pytest.MonkeyPatch) -> None:
    """The console takes this computer for another one."""
    monkeypatch.setattr(origin, "is_loopback", lambda _: False)
    monkeypatch.setattr(request_rules, "is_loopback", lambda _: False)


def during(host: GraphHost, function: Callable[[], Any], what: str) -> Any:
    """Call a function in another thread, while the graph goes on; return its result."""
    with ThreadPoolExecutor(1) as pool:
        running = pool.submit(function)
        host.until(running.done, what=what)
    return running.result()


def pair(host: GraphHost, console: Console, tmp_path: Path, role: str = "operator") -> voice_connection.Console:
    """Pair with the code of a role, and return the console."""
    code = json.loads((tmp_path / "console.json").read_text())["codes"][role]
    consent = Consent(code, ask_trust=lambda _: True)
    found = during(host, lambda: reach_console(ConsoleAddress("127.0.0.1", console.port), consent), "the pairing")
    assert isinstance(found, voice_connection.Console)
    return found


def say(host: GraphHost, console: voice_connection.Console, sentence: str) -> bool:
    """Do one sentence; return whether it was done."""
    options = Options(sentence, True, None, ENGLISH, False, False, console)
    return bool(during(host, lambda: run_session(options), "the session"))


@pytest.mark.usefixtures("other_computer")
def test_another_computer_commands_after_pairing(
    graph_host: GraphHost, console: Console, velocities: list[float], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paired = pair(graph_host, console, tmp_path)
    assert say(graph_host, paired, "drive forward at 0.1 m/s for 0.3 s")
    graph_host.until(lambda: velocities[-1] == 0.0, what="the end")
    assert velocities.count(0.1) >= 4
    rows = journal(tmp_path)
    assert any(row["what"].startswith("voice drive") and "computer-1" in str(row) for row in rows)
    token = paired.cookie.partition("=")[2]
    assert token and token not in json.dumps(rows) + capsys.readouterr().err


@pytest.mark.usefixtures("other_computer")
def test_viewer_on_another_computer_only_stops(graph_host: GraphHost, console: Console, tmp_path: Path) -> None:
    paired = pair(graph_host, console, tmp_path, "viewer")
    assert not say(graph_host, paired, "drive forward at 0.1 m/s for 0.3 s")
    assert say(graph_host, paired, "stop")


@pytest.mark.usefixtures("other_computer")
def test_burst_ends_when_the_link_is_lost(
    graph_host: GraphHost, console: Console, velocities: list[float], tmp_path: Path
) -> None:
    paired = pair(graph_host, console, tmp_path)

    async def drive_and_vanish() -> None:
        async with voice_connection.connect(paired) as connection:
            await connection.announce_turn("1", "text")
            call = asyncio.ensure_future(connection.call("drive", {"linear_x": 0.1, "duration_s": 2.0}))
            while 0.1 not in velocities:
                await asyncio.sleep(0.01)
            link = connection._socket._response.connection
            assert link is not None and link.transport is not None
            link.transport.abort()
            with pytest.raises(voice_connection.ConnectionLost, match=r"lupin voice --console 127\.0\.0\.1"):
                await connection.wait_until_lost()
            await asyncio.gather(call, return_exceptions=True)

    during(graph_host, lambda: asyncio.run(drive_and_vanish()), "the session")
    graph_host.until(lambda: velocities[-1] == 0.0, what="the end")
    assert velocities.count(0.1) < 40  # of the 2 s at 20 Hz that were asked for


@pytest.mark.usefixtures("other_computer")
def test_revoked_computer_is_told_so(graph_host: GraphHost, console: Console, tmp_path: Path) -> None:
    paired = pair(graph_host, console, tmp_path)

    async def wait() -> None:
        async with voice_connection.connect(paired) as connection:
            Sessions(tmp_path / "sessions.json").revoke("computer-1")
            await connection.wait_until_lost()

    with pytest.raises(voice_connection.ConnectionLost, match="this browser is no longer paired; connect again with: lupin"):
        during(graph_host, lambda: asyncio.run(wait()), "the end")
    with pytest.raises(voice_connection.ConnectionLost, match="does not know this computer any more"):
        say(graph_host, paired, "stop")
