"""Goals that clients send to an action server on a real graph."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from nav2_msgs.action import NavigateToPose, Spin
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future

from lupin_runtime.console import goals
from lupin_runtime.console.goals import ActionClientPool, GoalSender, OrderedActionClient
from lupin_runtime.console.providers import RequestFailed
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.ros_thread import RosThread
from tests.conftest import GraphHost
from tests.support.lost_answers import lose_goal_answers
from tests.support.waiting import WAIT_S

pytestmark = pytest.mark.graph

ACTION, ACTION_TYPE = "/turn", "nav2_msgs/action/Spin"
NO_TIME = {"sec": 0, "nanosec": 0}


class Turner(LupinNode):
    """An action server whose goals run until the test ends them. `accepting` is its answer to the next goals.

    With `hold` it answers only after `release`.
    """

    def __init__(self, hold: bool = False) -> None:
        super().__init__("turner")
        self.goals: list[Any] = []  # the handles of accepted goals
        self.asked = 0
        self.cancel_requests = 0
        self.accepting = GoalResponse.ACCEPT
        self.cancel_answer = CancelResponse.ACCEPT
        self._released = Future()
        if not hold:
            self.release()
        self._ends: dict[bytes, Future] = {}
        self.server = ActionServer(
            self,
            Spin,
            ACTION,
            execute_callback=self._execute,
            callback_group=ReentrantCallbackGroup(),
            goal_callback=self._judge,
            handle_accepted_callback=self._accept,
            cancel_callback=self._cancel,
        )

    def release(self) -> None:
        self._released.set_result(None)

    async def _judge(self, _goal: Any) -> GoalResponse:
        self.asked += 1
        await self._released
        return self.accepting

    def _accept(self, handle: Any) -> None:
        self._ends[bytes(handle.goal_id.uuid)] = Future()
        self.goals.append(handle)
        handle.execute()

    async def _execute(self, handle: Any) -> Any:
        return await self._ends[bytes(handle.goal_id.uuid)]

    def _cancel(self, _handle: Any) -> CancelResponse:
        self.cancel_requests += 1
        return self.cancel_answer

    def end(self, handle: Any, transition: Callable[[], None], **result: Any) -> None:
        transition()
        self._ends[bytes(handle.goal_id.uuid)].set_result(Spin.Result(**result))


class Client:
    """A client that sends goals; `received` has the messages that it got."""

    def __init__(self, node: LupinNode, pool: ActionClientPool) -> None:
        self.received: SimpleQueue[dict[str, Any]] = SimpleQueue()
        self.goals = GoalSender(node, self.received.put, clients=pool)

    def next(self) -> dict[str, Any]:
        return self.received.get(timeout=WAIT_S)

    def assert_silent(self) -> None:
        with pytest.raises(Empty):
            self.received.get_nowait()


class Rig:
    """The bridge's node with its clients, and the action server's node."""

    def __init__(self, host: GraphHost) -> None:
        self.host = host
        bridge = LupinNode("bridge")
        self._ros = RosThread(bridge)
        self._pool = ActionClientPool(bridge)
        self.bridge: LupinNode = host.add(bridge)
        self.turner: Turner = host.add(Turner())

    def client(self) -> Client:
        client: Client = self.run(lambda: Client(self.bridge, self._pool))
        return client

    def run(self, function: Callable[[], Any]) -> Any:
        """Run a function on the thread of the bridge's executor."""
        return self._ros.run(function).result(WAIT_S)

    def send(self, client: Client, identifier: str | None = "goal", args: Any = None, feedback: bool = False) -> None:
        self.run(lambda: client.goals.send_goal(identifier, ACTION, ACTION_TYPE, args, feedback))

    def accepted(self, number: int) -> Any:
        """Return the handle of the server's nth goal, counted from 1."""
        self.host.until(lambda: len(self.turner.goals) >= number, what=f"goal {number}")
        return self.turner.goals[number - 1]

    def end(self, handle: Any, transition: Callable[[], None], **result: Any) -> None:
        self.host.within(self.turner, lambda: self.turner.end(handle, transition, **result))

    def action_clients(self) -> int:
        clients: int = self.run(lambda: sum(isinstance(each, OrderedActionClient) for each in self.bridge.waitables))
        return clients

    @contextmanager
    def busy_bridge(self) -> Iterator[None]:
        """Block the bridge's executor, so that messages pile up."""
        started, over = threading.Event(), threading.Event()

        def wait() -> bool:
            started.set()
            return over.wait(WAIT_S)

        busy = self._ros.run(wait)
        assert started.wait(WAIT_S)
        try:
            yield
        finally:
            over.set()
            assert busy.result(WAIT_S)

    def end_server(self) -> None:
        """Remove the server's node, and wait until the bridge's node has noticed."""
        self.host.remove(self.turner)
        self.host.until(lambda: not self.bridge.count_publishers(f"{ACTION}/_action/status"), what="the server's end")

    def start_server(self, server: Turner) -> None:
        self.turner = self.host.add(server)


@pytest.fixture
def rig(graph_host: GraphHost) -> Rig:
    """Two spinning nodes."""
    return Rig(graph_host)


@pytest.fixture
def client(rig: Rig) -> Client:
    return rig.client()


def outcome(
    status: int, error_msg: str = "", error_code: int = 0, identifier: str | None = "goal", elapsed: dict[str, int] = NO_TIME
) -> dict[str, Any]:
    values = {"total_elapsed_time": elapsed, "error_code": error_code, "error_msg": error_msg}
    message = {"op": "action_result", "action": ACTION, "values": values, "status": status, "result": True}
    return message if identifier is None else {**message, "id": identifier}


def failure(text: str, action: str = ACTION) -> dict[str, Any]:
    return {"op": "action_result", "action": action, "values": text, "status": 0, "result": False, "id": "goal"}


# -- results ----------------------------------------------------------------------------------------------------------
def test_all_feedback_comes_in_order_before_the_result(rig: Rig, client: Client) -> None:
    rig.send(client, feedback=True)
    handle = rig.accepted(1)

    def report(*traveled: float) -> None:
        for angle in traveled:
            handle.publish_feedback(Spin.Feedback(angular_distance_traveled=angle))

    # The first feedback shows that the subscription to it works.
    rig.host.until(
        lambda: rig.host.within(rig.turner, lambda: report(0.0)) or not client.received.empty(), what="the first feedback"
    )

    with rig.busy_bridge():  # so that all these messages are waiting at the same time
        rig.host.within(rig.turner, lambda: report(1.0, 2.0, 3.0, 4.0))
        rig.end(handle, handle.succeed, error_msg="done")
        for _ in range(3):  # turns in which the server sends the result
            rig.host.within(rig.turner, lambda: None)
    messages = [client.next()]
    while messages[-1]["op"] == "action_feedback":
        messages.append(client.next())
    assert messages[0] == {
        "op": "action_feedback",
        "action": ACTION,
        "values": {"angular_distance_traveled": 0.0},
        "id": "goal",
    }
    assert [message["values"]["angular_distance_traveled"] for message in messages[-5:-1]] == [1.0, 2.0, 3.0, 4.0]
    assert messages[-1] == outcome(GoalStatus.STATUS_SUCCEEDED, "done")
    client.assert_silent()


def test_goal_without_feedback_gets_only_its_result(rig: Rig, client: Client) -> None:
    rig.send(client, identifier=None, args=[0.5, {"sec": 3}])
    handle = rig.accepted(1)
    assert (handle.request.target_yaw, handle.request.time_allowance.sec) == (0.5, 3)
    rig.host.within(rig.turner, lambda: handle.publish_feedback(Spin.Feedback(angular_distance_traveled=1.0)))
    rig.end(handle, handle.abort, error_code=7)
    assert client.next() == outcome(GoalStatus.STATUS_ABORTED, error_code=7, identifier=None)
    client.assert_silent()


def test_parallel_goals_may_end_out_of_order(rig: Rig, client: Client) -> None:
    other = rig.client()
    rig.send(client, "first", {"target_yaw": 1.0})
    rig.send(client, "second", {"target_yaw": 2.0})
    rig.accepted(2)
    rig.send(other, "first", {"target_yaw": 3.0})
    rig.accepted(3)
    assert rig.action_clients() == 1
    handles = {handle.request.target_yaw: handle for handle in rig.turner.goals}
    rig.end(handles[2.0], handles[2.0].succeed, error_msg="b")
    assert client.next() == outcome(GoalStatus.STATUS_SUCCEEDED, "b", identifier="second")
    rig.end(handles[1.0], handles[1.0].succeed, error_msg="a")
    assert client.next() == outcome(GoalStatus.STATUS_SUCCEEDED, "a", identifier="first")
    assert rig.action_clients() == 1
    rig.end(handles[3.0], handles[3.0].succeed, error_msg="c")
    assert other.next() == outcome(GoalStatus.STATUS_SUCCEEDED, "c", identifier="first")
    rig.host.until(lambda: rig.action_clients() == 0, what="the action client's end")


# -- failures ---------------------------------------------------------------------------------------------------------
def test_rejected_goal_gets_the_protocols_text(rig: Rig, client: Client) -> None:
    rig.turner.accepting = GoalResponse.REJECT
    rig.send(client)
    assert client.next() == failure("Action goal was rejected")
    rig.host.until(lambda: rig.action_clients() == 0, what="the action client's end")


def test_goal_without_a_server_gets_the_protocols_text(rig: Rig, client: Client) -> None:
    rig.run(lambda: client.goals.send_goal("goal", "/nobody", ACTION_TYPE, {}, False))
    assert client.next() == failure("No action server available", "/nobody")
    rig.host.until(lambda: rig.action_clients() == 0, what="the action client's end")


def test_number_of_unfinished_goals_is_limited(rig: Rig, client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goals, "MAX_GOALS", 2)
    for _ in range(2):
        rig.send(client)
    with pytest.raises(RequestFailed, match="a client may have 2 goals"):
        rig.send(client)
    assert client.next()["values"].startswith("a client may have 2 goals")


def test_goal_waits_for_a_server_that_starts(rig: Rig, client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goals, "SERVER_TIMEOUT_S", WAIT_S)
    rig.end_server()
    rig.send(client)
    rig.start_server(Turner())
    handle = rig.accepted(1)
    rig.end(handle, handle.succeed)
    assert client.next() == outcome(GoalStatus.STATUS_SUCCEEDED)


@pytest.mark.parametrize(
    ("action", "action_type", "args", "text"),
    [
        ("/turn", "nav2_msgs/NoSuchType", {}, "Unable to import action class NoSuchType from package nav2_msgs"),
        ("/turn", "no type", {}, "no type is not a valid type string"),
        ("/turn round", "nav2_msgs/Spin", {}, "Invalid topic name: "),
        ("/" + "t" * 300, "nav2_msgs/Spin", {}, "t{300}"),
        ("/turn", "nav2_msgs/Spin", {"target_yaw": "far"}, "requires a float for field target_yaw"),
        ("/turn", "nav2_msgs/Spin", {"speed": 1}, "does not have a field speed"),
        ("/turn", "nav2_msgs/Spin", "far", "Expected a JSON object"),
    ],
)
def test_invalid_goal_is_answered_and_reported(
    rig: Rig, client: Client, action: str, action_type: str, args: Any, text: str
) -> None:
    with pytest.raises(RequestFailed, match=text) as error:
        rig.run(lambda: client.goals.send_goal("goal", action, action_type, args, False))
    assert client.next() == failure(str(error.value), action)
    assert rig.action_clients() == 0


# -- canceling --------------------------------------------------------------------------------------------------------
def test_canceled_goal_has_a_result_with_status_5(rig: Rig, client: Client) -> None:
    rig.send(client, "other")
    rig.accepted(1)
    rig.send(client)
    handle = rig.accepted(2)
    rig.run(lambda: client.goals.cancel("unknown"))
    rig.run(lambda: client.goals.cancel("goal"))
    rig.host.until(lambda: handle.is_cancel_requested, what="the cancel request")
    rig.end(handle, handle.canceled, error_msg="stopped")
    assert client.next() == outcome(5, "stopped")
    assert rig.turner.cancel_requests == 1
    client.assert_silent()


def test_goal_without_id_cannot_be_canceled(rig: Rig, client: Client) -> None:
    rig.send(client, identifier=None)
    handle = rig.accepted(1)
    rig.run(lambda: client.goals.cancel(None))
    rig.end(handle, handle.succeed)
    assert client.next() == outcome(GoalStatus.STATUS_SUCCEEDED, identifier=None)
    assert rig.turner.cancel_requests == 0


def test_cancel_before_acceptance_reaches_the_server(rig: Rig, client: Client) -> None:
    rig.end_server()
    rig.start_server(Turner(hold=True))
    rig.send(client)
    rig.host.until(lambda: rig.turner.asked, what="the goal")
    rig.run(lambda: client.goals.cancel("goal"))
    rig.host.within(rig.turner, rig.turner.release)
    handle = rig.accepted(1)
    rig.host.until(lambda: handle.is_cancel_requested, what="the cancel request")
    rig.end(handle, handle.canceled)
    assert client.next() == outcome(GoalStatus.STATUS_CANCELED)


def test_goal_whose_acceptance_is_lost_is_canceled(rig: Rig, client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    lose_goal_answers(monkeypatch, OrderedActionClient)
    rig.send(client)
    handle = rig.accepted(1)
    rig.run(lambda: client.goals.cancel("goal"))
    rig.host.until(lambda: handle.is_cancel_requested, what="the cancel request")
    rig.end(handle, handle.canceled, error_msg="stopped")
    assert client.next() == outcome(GoalStatus.STATUS_CANCELED, "stopped")
    rig.host.until(lambda: rig.action_clients() == 0, what="the action client's end")


def test_cancel_that_overtakes_its_goal_is_repeated(rig: Rig, client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    lose_goal_answers(monkeypatch, OrderedActionClient)
    rig.end_server()
    rig.start_server(Turner(hold=True))
    rig.send(client)
    rig.host.until(lambda: rig.turner.asked, what="the goal")
    rig.run(client.goals.close)
    rig.host.within(rig.turner, rig.turner.release)
    handle = rig.accepted(1)
    rig.host.until(lambda: handle.is_cancel_requested, what="the repeated cancel request")
    rig.end(handle, handle.canceled)
    rig.host.until(lambda: rig.action_clients() == 0, what="the action client's end")


def test_unanswered_cancel_of_a_disconnected_client_ends(rig: Rig, client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goals, "CANCEL_TIMEOUT_S", 1.5)
    rig.end_server()
    rig.start_server(Turner(hold=True))
    rig.send(client)
    rig.host.until(lambda: rig.turner.asked, what="the goal")
    rig.run(client.goals.close)
    rig.host.until(lambda: rig.action_clients() == 0, what="the action client's end")
    rig.host.within(rig.turner, rig.turner.release)


def test_goal_canceled_before_its_server_starts_is_not_sent(rig: Rig, client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goals, "SERVER_TIMEOUT_S", WAIT_S)
    rig.end_server()
    rig.send(client)
    rig.run(lambda: client.goals.cancel("goal"))
    assert client.next() == outcome(GoalStatus.STATUS_CANCELED)
    rig.start_server(Turner())
    rig.send(client, args={"target_yaw": 2.0})
    assert rig.accepted(1).request.target_yaw == 2.0


def test_goal_continues_after_refused_cancel(rig: Rig, client: Client) -> None:
    rig.turner.cancel_answer = CancelResponse.REJECT
    rig.send(client)
    handle = rig.accepted(1)
    rig.run(lambda: client.goals.cancel("goal"))
    rig.host.until(lambda: rig.turner.cancel_requests, what="the cancel request")
    rig.end(handle, handle.succeed)
    assert client.next() == outcome(GoalStatus.STATUS_SUCCEEDED)


# -- disconnected clients ---------------------------------------------------------------------------------------------
def test_goals_of_disconnected_client_are_canceled(rig: Rig, client: Client) -> None:
    other = rig.client()
    for sender, identifier in ((client, "goal"), (client, None), (other, "goal")):
        rig.send(sender, identifier)
    rig.accepted(3)
    rig.run(client.goals.close)
    rig.host.until(lambda: rig.turner.cancel_requests == 2, what="the cancel requests")
    rig.host.until(lambda: sum(handle.is_cancel_requested for handle in rig.turner.goals) == 2, what="two canceled goals")
    for handle in rig.turner.goals:
        rig.end(handle, handle.canceled if handle.is_cancel_requested else handle.succeed)
    assert other.next() == outcome(GoalStatus.STATUS_SUCCEEDED)
    rig.host.until(lambda: rig.action_clients() == 0, what="the action client's end")
    client.assert_silent()
    with pytest.raises(RequestFailed, match="the client has disconnected"):
        rig.send(client)


def test_goal_accepted_after_disconnect_is_canceled(rig: Rig, client: Client) -> None:
    rig.end_server()
    rig.start_server(Turner(hold=True))
    rig.send(client)
    rig.host.until(lambda: rig.turner.asked, what="the goal")
    rig.run(client.goals.close)
    rig.host.within(rig.turner, rig.turner.release)
    handle = rig.accepted(1)
    rig.host.until(lambda: handle.is_cancel_requested, what="the cancel request")
    rig.host.until(lambda: rig.action_clients() == 0, what="the action client's end")
    client.assert_silent()


def test_unsent_goal_of_disconnected_client_is_never_sent(rig: Rig, client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goals, "SERVER_TIMEOUT_S", WAIT_S)
    rig.end_server()
    rig.send(client)
    rig.run(client.goals.close)
    assert rig.action_clients() == 0
    rig.start_server(Turner())
    other = rig.client()
    rig.send(other, args={"target_yaw": 2.0})
    assert rig.accepted(1).request.target_yaw == 2.0
    client.assert_silent()


def test_goals_in_quick_succession_leave_nothing_behind(rig: Rig, client: Client) -> None:
    for number in range(1, 21):
        rig.send(client)
        handle = rig.accepted(number)
        rig.end(handle, handle.succeed)
        assert client.next() == outcome(GoalStatus.STATUS_SUCCEEDED)
        rig.host.until(lambda: rig.action_clients() == 0, what="the action client's end")


def test_goal_for_navigation_is_stamped(rig: Rig, client: Client) -> None:
    received: list[Any] = []

    def accept(goal: Any) -> GoalResponse:
        received.append(goal)
        return GoalResponse.REJECT

    def serve() -> ActionServer:
        return ActionServer(rig.turner, NavigateToPose, "navigate_to_pose", lambda _: None, goal_callback=accept)

    rig.host.within(rig.turner, serve)
    pose = {"header": {"frame_id": "map", "stamp": "now"}, "pose": {"position": {"x": 1.5}}}
    rig.run(lambda: client.goals.send_goal("goal", "navigate_to_pose", "nav2_msgs/NavigateToPose", {"pose": pose}, True))
    assert client.next() == failure("Action goal was rejected", "navigate_to_pose")
    assert received[0].pose.header.stamp.sec > 0
    assert (received[0].pose.header.frame_id, received[0].pose.pose.position.x) == ("map", 1.5)


def test_goal_ends_when_its_server_is_gone(rig: Rig) -> None:
    client = rig.client()
    rig.send(client)
    rig.accepted(1)
    rig.host.remove(rig.turner)
    answer = client.next()
    assert (answer["op"], answer["result"], answer["values"]) == ("action_result", False, "The action server has gone")
    client.assert_silent()


def test_goal_ends_when_its_server_was_replaced(rig: Rig) -> None:
    client = rig.client()
    rig.send(client)
    rig.accepted(1)
    rig.host.add(Turner())
    rig.host.remove(rig.turner)
    answer = client.next()  # the new server may also answer that it does not know the goal
    assert (answer["op"], answer["result"]) == ("action_result", False)
    client.assert_silent()
