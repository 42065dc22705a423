"""Stops and zero velocities on a real graph: neither a full disk nor a busy executor keeps one from the robot."""

from __future__ import annotations

import errno
import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.console.command_journal import CommandJournal
from lupin_runtime.console.description import ConsoleDescription, read_description
from lupin_runtime.console.pairing import PairingCodes
from lupin_runtime.safety.console_server_stop import HOLDS
from tests.support.console_browser import Browser
from tests.support.rosbridge_client import RosbridgeClient

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from lupin_runtime.ros import LupinNode
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


class Robot:
    """What the robot hears from the console."""

    def __init__(self, node: LupinNode) -> None:
        self.node = node
        self.stops: list[bool] = []
        self.speeds: list[float] = []
        node.subscription(graph.CONSOLE_STOP, lambda message: self.stops.append(json.loads(message.data)["engaged"]))
        node.subscription(graph.CMD_VEL_MANUAL, lambda message: self.speeds.append(message.linear.x))


@pytest.fixture
def console(graph_host: GraphHost, tmp_path: Path) -> Iterator[Console]:
    """A console whose command journal is on a full disk."""
    from lupin_runtime.console.node import JOURNAL, Console

    (tmp_path / JOURNAL).symlink_to("/dev/full")
    files = {"folder": str(tmp_path), "sessions_file": str(tmp_path / "sessions.json")}
    node = graph_host.add(Console({"port": 0, "rosbridge_port": 0, **files}))
    yield node
    node.before_shutdown()


@pytest.fixture
def robot(graph_host: GraphHost, console: Console) -> Robot:
    from lupin_runtime.ros import LupinNode

    robot = Robot(graph_host.add(LupinNode("robot")))
    graph_host.until(lambda: robot.stops and console.count_subscribers(graph.CMD_VEL_MANUAL.name))
    return robot


@pytest.fixture
def client(console: Console) -> Iterator[RosbridgeClient]:
    made = RosbridgeClient(console.rosbridge_port)
    yield made
    made.close()


@pytest.fixture
def busy_executor(console: Console) -> Iterator[None]:
    """Keeps the console's executor busy until the test is over, as other clients' requests do."""
    release, started = threading.Event(), threading.Event()

    def work() -> None:
        started.set()
        release.wait(60.0)

    console._server._bridge._ros.run(work)
    assert started.wait(20.0)
    yield
    release.set()


def test_full_disk_does_not_keep_a_client_from_stopping(graph_host: GraphHost, robot: Robot, client: RosbridgeClient) -> None:
    client.send("publish", topic="/lupin/hmi/estop", msg={"data": True})
    graph_host.until(lambda: robot.stops[-1], what="the stop")
    client.send("publish", topic="/lupin/hmi/estop", msg={"data": False})
    graph_host.until(lambda: not robot.stops[-1], what="the release")


def test_full_disk_does_not_keep_a_browser_from_stopping(graph_host: GraphHost, robot: Robot, console: Console) -> None:
    browser = Browser(console.port)
    assert browser.post("/_api/stop", engaged=True)["stop"] == ["this computer stopped the robot"]
    graph_host.until(lambda: robot.stops[-1], what="the stop")
    assert browser.post("/_api/stop", engaged=False)["stop"] == []


def test_lost_driver_is_stopped_although_the_disk_is_full(graph_host: GraphHost, robot: Robot, client: RosbridgeClient) -> None:
    client.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.2}})
    graph_host.until(lambda: robot.speeds == [0.2], what="motion")
    client.socket.socket.close()
    graph_host.until(lambda: robot.speeds[-1] == 0.0 and robot.stops[-1], what="zero and the stop")


def test_stop_is_published_before_the_journal_is_written(
    graph_host: GraphHost, robot: Robot, client: RosbridgeClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    released = threading.Event()
    monkeypatch.setattr(CommandJournal, "_write", lambda *_: released.wait(20.0))  # a disk that hangs
    client.send("publish", topic="/lupin/hmi/estop", msg={"data": True})
    try:
        graph_host.until(lambda: robot.stops[-1], timeout_s=2.0, what="the stop")
    finally:
        released.set()


@pytest.mark.usefixtures("busy_executor")
def test_stop_overtakes_other_requests(graph_host: GraphHost, robot: Robot, client: RosbridgeClient) -> None:
    client.send("publish", topic="/lupin/hmi/estop", msg={"data": True})
    graph_host.until(lambda: robot.stops[-1], timeout_s=2.0, what="the stop")


@pytest.mark.usefixtures("busy_executor")
def test_zero_of_a_lost_driver_overtakes_and_nothing_follows_it(
    graph_host: GraphHost, robot: Robot, client: RosbridgeClient
) -> None:
    for _ in range(20):
        client.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.2}})
    client.socket.socket.close()
    graph_host.until(lambda: robot.speeds and robot.speeds[-1] == 0.0, timeout_s=2.0, what="zero")
    assert robot.speeds[:-1] == [0.2] * (len(robot.speeds) - 1)


def test_error_while_a_client_is_removed_leaves_nothing_behind(
    graph_host: GraphHost,
    robot: Robot,
    client: RosbridgeClient,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    from lupin_runtime.console.goals import GoalSender
    from lupin_runtime.console.providers import ServiceProvider

    def fail(_: Any) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(GoalSender, "close", fail)
    monkeypatch.setattr(ServiceProvider, "close", fail)
    client.send("subscribe", topic="/left", type="std_msgs/String")
    graph_host.until(lambda: robot.node.count_subscribers("/left"))
    client.close()
    graph_host.until(lambda: not robot.node.count_subscribers("/left"), what="the end of the subscription")
    graph_host.until(lambda: "no space left" in capfd.readouterr().err, what="the error in the log")


def test_stop_is_repeated_although_other_steps_fail(
    graph_host: GraphHost, robot: Robot, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    from lupin_runtime.console.events import EventChannel
    from lupin_runtime.stack.runs import Run

    def fail(*_: Any) -> None:
        raise OSError(errno.EIO, "the disk is broken")

    for owner, name in ((EventChannel, "push"), (Run, "state"), (PairingCodes, "tick")):
        monkeypatch.setattr(owner, name, fail)
    count = len(robot.stops)
    graph_host.until(lambda: len(robot.stops) >= count + 4, what="repeats of the stop")
    logged = capfd.readouterr().err
    for step in ("pushing control and stop", "reading the run's state", "replacing the pairing codes"):
        assert logged.count(f"{step} failed") == 1, "each is logged once"


def test_next_code_is_shown_once_the_disk_has_space(
    graph_host: GraphHost, robot: Robot, console: Console, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def shown() -> str:
        described = read_description(tmp_path)
        assert described is not None
        return described.codes["operator"]

    first = shown()
    with monkeypatch.context() as patch:
        patch.setattr(ConsoleDescription, "write", lambda *_: Path("/dev/full").write_text("x"))
        Browser(console.port, proxied=True).post("/_api/pair", code=first)
        count = len(robot.stops)
        graph_host.until(lambda: len(robot.stops) >= count + 3, what="repeats of the stop")
        assert shown() == first
    graph_host.until(lambda: shown() != first, what="the next code")


# -- what else holds the robot ------------------------------------------------------------------------------------------
def estop_status(*reasons: str) -> Any:
    from std_msgs.msg import String

    return String(data=json.dumps({"engaged": bool(reasons), "reasons": reasons, "warnings": ["the button is silent"]}))


def test_other_reasons_for_the_stop_are_told(graph_host: GraphHost, robot: Robot, console: Console) -> None:
    browser = Browser(console.port)
    estop = robot.node.publisher(graph.ESTOP_STATUS)
    events = browser.socket("/_api/events")
    estop.publish(estop_status("the button is pressed"))
    events.wait(lambda event: event["event"] == "stop" and event["value"] == ["the button is pressed"])
    assert browser.get("/_api/session")["stop"] == ["the button is pressed"]
    own = "this computer stopped the robot"
    assert browser.post("/_api/stop", engaged=True)["stop"] == [own, "the button is pressed"]
    estop.publish(estop_status("the button is pressed", HOLDS))
    graph_host.until(lambda: HOLDS in console._server._bridge._estop.reasons)
    assert browser.get("/_api/session")["stop"] == [own, "the button is pressed"], "each reason once"
    assert browser.post("/_api/stop", engaged=False)["stop"] == ["the button is pressed"]
    estop.publish(estop_status())
    graph_host.until(lambda: browser.get("/_api/session")["stop"] == [], what="the end of the stop")
    events.close()


def test_stop_of_another_console_and_lost_estop(graph_host: GraphHost, robot: Robot, console: Console) -> None:
    browser = Browser(console.port)
    estop = robot.node.publisher(graph.ESTOP_STATUS)
    for text in ("", "[]", '{"engaged": true}', '{"engaged": true, "reasons": 3}', "[" * 5000):
        estop.publish(type(estop_status())(data=text))
    estop.publish(estop_status(HOLDS))
    graph_host.until(lambda: browser.get("/_api/session")["stop"] == [HOLDS], what="the stop of another console")
    robot.node.destroy_publisher(estop)
    graph_host.until(lambda: browser.get("/_api/session")["stop"] == [], what="nothing known of an e-stop that is gone")
