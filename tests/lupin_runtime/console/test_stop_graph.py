"""Stops and zero velocities reach the robot although the disk is full or the console's executor is busy (real graph)."""

from __future__ import annotations

import errno
import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.console.command_era import OUTDATED
from lupin_runtime.console.command_journal import CommandJournal
from lupin_runtime.console.description import ConsoleDescription, read_description
from lupin_runtime.console.pairing import PairingCodes
from lupin_runtime.safety.console_server_stop import BROWSER_HOLDS_STOP
from tests.support.console_browser import Browser, stop_texts
from tests.support.rosbridge_client import RosbridgeClient

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from lupin_runtime.ros import LupinNode
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


class CommandRecorder:
    """Records what the console publishes for the robot: whether it is stopped, and forward velocities (m/s)."""

    def __init__(self, node: LupinNode) -> None:
        self.node = node
        self.stop_states: list[bool] = []
        self.speeds: list[float] = []
        node.subscription(graph.CONSOLE_STOP, lambda message: self.stop_states.append(json.loads(message.data)["engaged"]))
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
def robot(graph_host: GraphHost, console: Console) -> CommandRecorder:
    from lupin_runtime.ros import LupinNode

    robot = CommandRecorder(graph_host.add(LupinNode("robot")))
    graph_host.until(lambda: robot.stop_states and console.count_subscribers(graph.CMD_VEL_MANUAL.name))
    return robot


@pytest.fixture
def client(console: Console) -> Iterator[RosbridgeClient]:
    made = RosbridgeClient(console.rosbridge_port)
    yield made
    made.close()


@pytest.fixture
def busy_executor(console: Console) -> Iterator[threading.Event]:
    """Keeps the console's executor busy until the event is set or the test is over, as other clients' requests do."""
    finish_work, started = threading.Event(), threading.Event()

    def work() -> None:
        started.set()
        finish_work.wait()

    console._server._bridge._ros.run(work)
    assert started.wait(60)
    yield finish_work
    finish_work.set()


def test_client_can_stop_robot_although_disk_is_full(
    graph_host: GraphHost, robot: CommandRecorder, client: RosbridgeClient
) -> None:
    client.send("publish", topic="/lupin/hmi/estop", msg={"data": True})
    graph_host.until(lambda: robot.stop_states[-1], what="the stop")
    client.send("publish", topic="/lupin/hmi/estop", msg={"data": False})
    graph_host.until(lambda: not robot.stop_states[-1], what="the stop to be cleared")


def test_browser_can_stop_robot_although_disk_is_full(graph_host: GraphHost, robot: CommandRecorder, console: Console) -> None:
    browser = Browser(console.port)
    assert stop_texts(browser.post("/_api/stop", engaged=True)) == ["this computer stopped the robot"]
    graph_host.until(lambda: robot.stop_states[-1], what="the stop")
    assert stop_texts(browser.post("/_api/stop", engaged=False)) == []


def test_robot_is_stopped_if_driving_client_is_lost(
    graph_host: GraphHost, robot: CommandRecorder, client: RosbridgeClient
) -> None:
    """The disk is full, as in every test that uses `console`."""
    client.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.2}})
    graph_host.until(lambda: robot.speeds == [0.2], what="motion")
    client.socket.socket.close()
    graph_host.until(lambda: robot.speeds[-1] == 0.0 and robot.stop_states[-1], what="zero and the stop")


def test_stop_is_published_before_the_journal_is_written(
    graph_host: GraphHost, robot: CommandRecorder, client: RosbridgeClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    finish_write = threading.Event()
    monkeypatch.setattr(CommandJournal, "_write", lambda *_: finish_write.wait())  # a disk that hangs
    client.send("publish", topic="/lupin/hmi/estop", msg={"data": True})
    try:
        graph_host.until(lambda: robot.stop_states[-1], what="the stop")
    finally:
        finish_write.set()


@pytest.mark.usefixtures("busy_executor")
def test_stop_overtakes_other_requests(graph_host: GraphHost, robot: CommandRecorder, client: RosbridgeClient) -> None:
    client.send("publish", topic="/lupin/hmi/estop", msg={"data": True})
    graph_host.until(lambda: robot.stop_states[-1], what="the stop")


@pytest.mark.usefixtures("busy_executor")
def test_zero_velocity_is_last_after_driving_client_is_lost(
    graph_host: GraphHost, robot: CommandRecorder, client: RosbridgeClient
) -> None:
    for _ in range(20):
        client.send("publish", topic="/cmd_vel_manual", msg={"linear": {"x": 0.2}})
    client.socket.socket.close()
    graph_host.until(lambda: robot.speeds and robot.speeds[-1] == 0.0, what="zero")
    assert robot.speeds[:-1] == [0.2] * (len(robot.speeds) - 1)


def press_and_release(graph_host: GraphHost, robot: CommandRecorder, client: RosbridgeClient) -> None:
    for engaged in (True, False):
        client.send("publish", topic="/lupin/hmi/estop", msg={"data": engaged})
        graph_host.until(lambda e=engaged: robot.stop_states[-1] is e, what=f"the stop to be {engaged}")  # type: ignore[misc]


def answer(client: RosbridgeClient, identifier: str) -> dict[str, Any]:
    return client.wait(lambda message: message.get("id") == identifier)


def send_goal_pose(client: RosbridgeClient, x: float) -> None:
    client.send("publish", topic="/goal_pose", type="geometry_msgs/PoseStamped", msg={"pose": {"position": {"x": x}}})


def test_commands_from_before_a_stop_are_not_carried_out(
    graph_host: GraphHost, robot: CommandRecorder, client: RosbridgeClient, busy_executor: threading.Event
) -> None:
    called: list[str] = []
    poses: list[float] = []

    def serve(row: graph.Service) -> None:
        def respond(_: Any, response: Any) -> Any:
            called.append(row.name)
            response.success = True
            return response

        robot.node.service(row, respond)

    serve(graph.MISSION_RESUME)
    serve(graph.MISSION_PAUSE)
    robot.node.subscription(graph.GOAL_POSE, lambda message: poses.append(message.pose.position.x))
    client.send("set_level", level="error")
    send_goal_pose(client, 1.0)
    for row in (graph.MISSION_RESUME, graph.MISSION_PAUSE):
        client.send("call_service", service=row.name, id=row.name)
    client.send("send_action_goal", action="/navigate_to_pose", action_type="nav2_msgs/NavigateToPose", id="goal")
    press_and_release(graph_host, robot, client)
    busy_executor.set()
    client.refusal(OUTDATED)
    goal, resume, pause = (answer(client, each) for each in ("goal", graph.MISSION_RESUME.name, graph.MISSION_PAUSE.name))
    assert (goal["values"], goal["result"]) == (resume["values"], resume["result"]) == (OUTDATED, False)
    assert pause["result"] and called == [graph.MISSION_PAUSE.name]
    send_goal_pose(client, 2.0)
    graph_host.until(lambda: poses, what="the goal from after the release")
    assert poses == [2.0]


def test_goal_that_waits_for_its_server_is_outdated_by_a_stop(
    graph_host: GraphHost, robot: CommandRecorder, client: RosbridgeClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    from lupin_runtime.console import goals

    monkeypatch.setattr(goals, "SERVER_TIMEOUT_S", 60.0)
    client.send("send_action_goal", action="/navigate_to_pose", action_type="nav2_msgs/NavigateToPose", id="goal")
    press_and_release(graph_host, robot, client)
    assert answer(client, "goal")["values"] == OUTDATED


def test_command_of_former_holder_is_not_carried_out(
    console: Console, client: RosbridgeClient, busy_executor: threading.Event
) -> None:
    client.send("set_level", level="error")
    send_goal_pose(client, 1.0)
    browser = Browser(console.port)
    holder = None
    while holder is None:
        holder = browser.get("/_api/session")["control"]["holder"]
    browser.post("/_api/lease", action="take_over", **{"from": holder})
    busy_executor.set()
    client.refusal(OUTDATED)


def test_command_from_before_a_press_of_the_button_is_outdated(
    graph_host: GraphHost, robot: CommandRecorder, console: Console
) -> None:
    refusal = console._server._bridge._refusal(graph.GOAL_POSE.name)
    estop = robot.node.publisher(graph.ESTOP_STATUS)
    estop.publish(estop_status("the button is pressed"))
    graph_host.until(lambda: refusal() == OUTDATED, what="the press")


def test_lost_client_is_removed_although_removal_has_errors(
    graph_host: GraphHost,
    robot: CommandRecorder,
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
    client.send("subscribe", topic="/subscribed", type="std_msgs/String")
    graph_host.until(lambda: robot.node.count_subscribers("/subscribed"))
    client.close()
    graph_host.until(lambda: not robot.node.count_subscribers("/subscribed"), what="the end of the subscription")
    graph_host.until(lambda: "no space left" in capfd.readouterr().err, what="the error in the log")


def test_stop_is_repeated_although_periodic_tasks_fail(
    graph_host: GraphHost, robot: CommandRecorder, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    from lupin_runtime.console.events import EventChannel
    from lupin_runtime.stack.runs import Run

    def fail(*_: Any) -> None:
        raise OSError(errno.EIO, "the disk is broken")

    for owner, name in ((EventChannel, "push"), (Run, "state"), (PairingCodes, "tick")):
        monkeypatch.setattr(owner, name, fail)
    count = len(robot.stop_states)
    graph_host.until(lambda: len(robot.stop_states) >= count + 4, what="repeats of the stop")
    logged = capfd.readouterr().err
    for task in ("pushing control and stop", "reading the run's state", "replacing the pairing codes"):
        assert logged.count(f"{task} failed") == 1, "each is logged once"


def test_next_pairing_code_is_shown_after_disk_has_space(
    graph_host: GraphHost, robot: CommandRecorder, console: Console, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def shown() -> str:
        described = read_description(tmp_path)
        assert described is not None
        return described.codes["operator"]

    first = shown()
    with monkeypatch.context() as patch:
        patch.setattr(ConsoleDescription, "write", lambda *_: Path("/dev/full").write_text("x"))
        Browser(console.port, proxied=True).post("/_api/pair", code=first)
        count = len(robot.stop_states)
        graph_host.until(lambda: len(robot.stop_states) >= count + 3, what="repeats of the stop")
        assert shown() == first
    graph_host.until(lambda: shown() != first, what="the next pairing code")


# -- other reasons for the stop ---------------------------------------------------------------------------------------
def estop_status(*reasons: str) -> Any:
    from std_msgs.msg import String

    return String(data=json.dumps({"engaged": bool(reasons), "reasons": reasons, "warnings": ["the button is silent"]}))


def test_other_stop_reasons_are_reported(graph_host: GraphHost, robot: CommandRecorder, console: Console) -> None:
    browser = Browser(console.port)
    estop = robot.node.publisher(graph.ESTOP_STATUS)
    events = browser.socket("/_api/events")
    estop.publish(estop_status("the button is pressed"))
    events.wait(
        lambda event: event["event"] == "stop" and [each["text"] for each in event["value"]] == ["the button is pressed"]
    )
    assert stop_texts(browser.get("/_api/session")) == ["the button is pressed"]
    own = "this computer stopped the robot"
    assert stop_texts(browser.post("/_api/stop", engaged=True)) == [own, "the button is pressed"]
    estop.publish(estop_status("the button is pressed", BROWSER_HOLDS_STOP))
    graph_host.until(lambda: BROWSER_HOLDS_STOP in console._server._bridge._estop.reasons)
    assert stop_texts(browser.get("/_api/session")) == [own, "the button is pressed"], "each reason once"
    assert stop_texts(browser.post("/_api/stop", engaged=False)) == ["the button is pressed"]
    estop.publish(estop_status())
    graph_host.until(lambda: stop_texts(browser.get("/_api/session")) == [], what="the end of the stop")
    events.close()


def test_stop_of_another_console_is_reported(graph_host: GraphHost, robot: CommandRecorder, console: Console) -> None:
    browser = Browser(console.port)
    robot.node.publisher(graph.ESTOP_STATUS).publish(estop_status(BROWSER_HOLDS_STOP))
    graph_host.until(
        lambda: stop_texts(browser.get("/_api/session")) == [BROWSER_HOLDS_STOP], what="the stop of another console"
    )


def test_stop_reasons_end_with_the_estop_publisher(graph_host: GraphHost, robot: CommandRecorder, console: Console) -> None:
    browser = Browser(console.port)
    estop = robot.node.publisher(graph.ESTOP_STATUS)
    reasons = ["the button is pressed", BROWSER_HOLDS_STOP]
    estop.publish(estop_status(*reasons))
    graph_host.until(lambda: stop_texts(browser.get("/_api/session")) == reasons, what="the stop")
    robot.node.destroy_publisher(estop)
    graph_host.until(
        lambda: stop_texts(browser.get("/_api/session")) == [], what="the reasons to end with the e-stop's publisher"
    )
