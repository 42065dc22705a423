"""Services and actions that clients advertise, used by another node on a real graph."""

from __future__ import annotations

from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from nav2_msgs.action import Spin
from rclpy.action import ActionServer
from rclpy.task import Future
from std_srvs.srv import SetBool

from lupin_runtime.console import providers
from lupin_runtime.console.goals import OrderedActionClient
from lupin_runtime.console.providers import ActionProvider, RequestFailed, ServiceProvider
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.ros_thread import RosThread
from tests.conftest import GraphHost
from tests.support.waiting import WAIT_S

pytestmark = pytest.mark.graph

SERVICE, SERVICE_TYPE = "/greenhouse/lamp", "std_srvs/srv/SetBool"
ACTION, ACTION_TYPE = "/greenhouse/turn", "nav2_msgs/Spin"  # the short form, which must reach the client verbatim


class Client:
    """A client with its services and actions; `received` has the messages that it got."""

    def __init__(self, node: LupinNode) -> None:
        self.received: SimpleQueue[dict[str, Any]] = SimpleQueue()
        self.services = ServiceProvider(node, self.received.put)
        self.actions = ActionProvider(node, self.received.put)

    def next(self) -> dict[str, Any]:
        return self.received.get(timeout=WAIT_S)


class Rig:
    """The bridge's node, and another node that calls services and sends goals."""

    def __init__(self, host: GraphHost) -> None:
        self.host = host
        bridge = LupinNode("bridge")
        self._ros = RosThread(bridge)
        self.bridge: LupinNode = host.add(bridge)
        self.peer: LupinNode = host.add(LupinNode("peer"))
        self._caller: Any = None
        self._action_client: OrderedActionClient | None = None

    def client(self) -> Client:
        client: Client = self.run(lambda: Client(self.bridge))
        return client

    def run(self, function: Callable[[], Any]) -> Any:
        """Run a function on the thread of the bridge's executor."""
        return self._ros.run(function).result(WAIT_S)

    def call(self, data: bool = True) -> Future:
        """Call the service as soon as it is available."""
        if self._caller is None:
            self._caller = self.host.within(self.peer, lambda: self.peer.create_client(SetBool, SERVICE))
        caller = self._caller
        self.host.until(caller.service_is_ready, what="the service")
        return self.host.within(self.peer, lambda: caller.call_async(SetBool.Request(data=data)))

    def replace_peer(self) -> None:
        """Remove the other node, and start a new one."""
        self.host.remove(self.peer)
        self.peer = self.host.add(LupinNode("other_peer"))
        self._caller = self._action_client = None

    def action_client(self) -> OrderedActionClient:
        if self._action_client is None:
            self._action_client = self.host.within(self.peer, lambda: OrderedActionClient(self.peer, Spin, ACTION))
        return self._action_client

    def send_goal(self, yaw: float = 1.0, on_feedback: Callable[[Any], None] | None = None) -> Any:
        """Send a goal as soon as the server is available, and return its handle."""
        client = self.action_client()
        self.host.until(client.server_is_ready, what="the action")
        goal = Spin.Goal(target_yaw=yaw)
        return self.done(self.host.within(self.peer, lambda: client.send_goal_async(goal, on_feedback)))

    def action_servers(self) -> int:
        return sum(isinstance(waitable, ActionServer) for waitable in self.bridge.waitables)

    def result(self, handle: Any) -> Future:
        return self.host.within(self.peer, handle.get_result_async)

    def done(self, future: Future) -> Any:
        self.host.until(future.done, what="the response")
        return future.result()

    def until_service_ends(self) -> None:
        def services() -> list[str]:
            return [name for name, _ in self.peer.get_service_names_and_types_by_node("bridge", "/")]

        self.host.until(lambda: SERVICE not in services(), what="the service's end")


@pytest.fixture
def rig(graph_host: GraphHost) -> Rig:
    """Two spinning nodes."""
    return Rig(graph_host)


@pytest.fixture
def client(rig: Rig) -> Client:
    """A client that offers the service and the action."""
    client = rig.client()
    rig.run(lambda: client.services.advertise(SERVICE, SERVICE_TYPE))
    rig.run(lambda: client.actions.advertise(ACTION, ACTION_TYPE))
    return client


def answer(rig: Rig, client: Client, number: int, values: Any, result: bool = True) -> None:
    rig.run(lambda: client.services.respond(SERVICE, f"service_request:{SERVICE}:{number}", values, result))


def finish(rig: Rig, client: Client, number: int, values: Any, status: int | None, result: bool = True) -> None:
    rig.run(lambda: client.actions.result(ACTION, f"action_goal:{ACTION}:{number}", values, status, result))


# -- services ---------------------------------------------------------------------------------------------------------
def test_parallel_requests_may_be_answered_out_of_order(rig: Rig, client: Client) -> None:
    first = rig.call(True)
    assert client.next() == {
        "op": "call_service",
        "id": f"service_request:{SERVICE}:1",
        "service": SERVICE,
        "args": {"data": True},
    }
    second = rig.call(False)
    assert client.next() == {
        "op": "call_service",
        "id": f"service_request:{SERVICE}:2",
        "service": SERVICE,
        "args": {"data": False},
    }
    answer(rig, client, 2, {"success": True, "message": "second"})
    assert rig.done(second) == SetBool.Response(success=True, message="second")
    assert not first.done()
    answer(rig, client, 1, {"message": "first"})
    assert rig.done(first) == SetBool.Response(success=False, message="first")


def test_unadvertised_service_answers_empty_and_leaves_the_graph(rig: Rig, client: Client) -> None:
    requests = [rig.call(), rig.call()]
    client.next(), client.next()
    rig.run(lambda: client.services.unadvertise(SERVICE))
    assert [rig.done(request) for request in requests] == [SetBool.Response()] * 2
    rig.until_service_ends()
    with pytest.raises(RequestFailed, match=f"Service {SERVICE} has not been advertised via rosbridge\\.$"):
        answer(rig, client, 1, {})


def test_next_client_can_offer_service_of_disconnected_one(rig: Rig, client: Client) -> None:
    left = rig.call()
    assert client.next()["id"] == f"service_request:{SERVICE}:1"
    rig.run(client.services.close)
    other = rig.client()
    rig.run(lambda: other.services.advertise(SERVICE, "std_srvs/SetBool"))
    assert rig.done(left) == SetBool.Response()
    request = rig.call()
    assert other.next()["id"] == f"service_request:{SERVICE}:1"
    answer(rig, other, 1, {"success": True})
    assert rig.done(request).success
    with pytest.raises(RequestFailed, match="the client has disconnected"):
        rig.run(lambda: client.services.advertise(SERVICE, SERVICE_TYPE))


def test_service_advertised_again_counts_requests_from_one(rig: Rig, client: Client) -> None:
    first = rig.call()
    assert client.next()["id"] == f"service_request:{SERVICE}:1"
    rig.run(lambda: client.services.advertise(SERVICE, SERVICE_TYPE))
    assert rig.done(first) == SetBool.Response()
    second = rig.call()
    assert client.next()["id"] == f"service_request:{SERVICE}:1"
    answer(rig, client, 1, {"success": True})
    assert rig.done(second).success


def test_unanswered_request_gets_empty_response(rig: Rig, client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(providers, "ANSWER_TIMEOUT_S", 0.1)
    assert rig.done(rig.call()) == SetBool.Response()
    identifier = client.next()["id"]
    with pytest.raises(RequestFailed, match=f"Received service response for unrecognized id: {identifier}"):
        answer(rig, client, 1, {"success": True})


def test_client_failure_gives_empty_response(rig: Rig, client: Client) -> None:
    request = rig.call()
    client.next()
    answer(rig, client, 1, "no such lamp", result=False)
    assert rig.done(request) == SetBool.Response()


@pytest.mark.parametrize("values", [{"success": 1}, {"unknown": 1}, "text", None])
def test_mismatching_response_values_give_empty_response(rig: Rig, client: Client, values: Any) -> None:
    request = rig.call()
    client.next()
    with pytest.raises(RequestFailed):
        answer(rig, client, 1, values)
    assert rig.done(request) == SetBool.Response()


def test_service_survives_a_caller_that_vanishes(rig: Rig, client: Client) -> None:
    rig.call()
    client.next()
    rig.replace_peer()
    answer(rig, client, 1, {"success": True})
    request = rig.call()
    client.next()
    answer(rig, client, 2, {"success": True})
    assert rig.done(request).success


@pytest.mark.parametrize(
    ("service", "type_name", "text"),
    [
        ("/lamp", "std_srvs", "std_srvs is not a valid type string"),
        ("/lamp", "no_such_package/SetBool", "Unable to import no_such_package.srv from package no_such_package"),
        ("/lamp", "std_srvs/NoSuchType", "Unable to import srv class NoSuchType from package std_srvs"),
        ("/a lamp", "std_srvs/SetBool", "Invalid service name: .* '/a lamp'$"),
        ("/" + "l" * 300, "std_srvs/SetBool", "should not exceed"),
    ],
)
def test_service_with_invalid_name_or_type_is_refused(rig: Rig, service: str, type_name: str, text: str) -> None:
    client = rig.client()
    with pytest.raises(RequestFailed, match=text):
        rig.run(lambda: client.services.advertise(service, type_name))
    with pytest.raises(RequestFailed, match=f"^Service {service} has not been advertised via rosbridge, can't unadvertise.$"):
        rig.run(lambda: client.services.unadvertise(service))


def test_number_of_advertisements_is_limited(rig: Rig, client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(providers, "MAX_ADVERTISED", 1)
    rig.run(lambda: client.services.advertise(SERVICE, SERVICE_TYPE))  # again
    for advertise in (
        lambda: client.services.advertise("/another", SERVICE_TYPE),
        lambda: client.actions.advertise("/another", ACTION_TYPE),
    ):
        with pytest.raises(RequestFailed, match="/another: a client may advertise 1 of these"):
            rig.run(advertise)


def test_services_come_and_go_under_load(rig: Rig) -> None:
    client = rig.client()
    for _ in range(20):
        rig.run(lambda: client.services.advertise(SERVICE, SERVICE_TYPE))
        request = rig.call()
        client.next()
        rig.run(lambda: client.services.unadvertise(SERVICE))
        assert rig.done(request) == SetBool.Response()
        rig.until_service_ends()


# -- actions ----------------------------------------------------------------------------------------------------------
def test_feedback_reaches_the_graph_before_the_result(rig: Rig, client: Client) -> None:
    received: list[Any] = []
    handle = rig.send_goal(0.5, lambda message: received.append(message.feedback.angular_distance_traveled))
    result = rig.result(handle)
    result.add_done_callback(lambda _: received.append("result"))
    goal = client.next()
    assert goal == {
        "op": "send_action_goal",
        "id": f"action_goal:{ACTION}:1",
        "action": ACTION,
        "action_type": ACTION_TYPE,
        "args": {"target_yaw": 0.5, "time_allowance": {"sec": 0, "nanosec": 0}},
        "feedback": True,
    }

    def feedback(traveled: float) -> None:
        client.actions.feedback(ACTION, goal["id"], {"angular_distance_traveled": traveled})

    def answer_at_once() -> None:
        for traveled in (1.0, 2.0, 3.0):
            feedback(traveled)
        client.actions.result(ACTION, goal["id"], {"error_msg": "done"}, GoalStatus.STATUS_SUCCEEDED, True)

    # The first feedback also shows that the subscription to it works.
    rig.host.until(lambda: rig.run(lambda: feedback(0.0)) or received, what="feedback")
    rig.run(answer_at_once)
    response = rig.done(result)
    assert (response.status, response.result) == (GoalStatus.STATUS_SUCCEEDED, Spin.Result(error_msg="done"))
    rig.host.until(lambda: "result" in received, what="the result")
    assert received[-4:] == [1.0, 2.0, 3.0, "result"]


def test_parallel_goals_may_end_out_of_order(rig: Rig, client: Client) -> None:
    results = [rig.result(rig.send_goal(yaw)) for yaw in (0.5, 1.5)]
    goals = [client.next(), client.next()]
    assert [goal["args"]["target_yaw"] for goal in goals] == [0.5, 1.5]
    assert [goal["id"] for goal in goals] == [f"action_goal:{ACTION}:1", f"action_goal:{ACTION}:2"]
    finish(rig, client, 2, {"error_code": 2}, GoalStatus.STATUS_ABORTED)
    response = rig.done(results[1])
    assert (response.status, response.result.error_code) == (GoalStatus.STATUS_ABORTED, 2)
    assert not results[0].done()
    finish(rig, client, 1, {"error_code": 1}, None)  # like clients of older versions, which send no status
    response = rig.done(results[0])
    assert (response.status, response.result.error_code) == (GoalStatus.STATUS_SUCCEEDED, 1)


def test_canceled_goal_ends_with_the_clients_result(rig: Rig, client: Client) -> None:
    handle = rig.send_goal()
    result = rig.result(handle)
    goal = client.next()
    cancel_response = rig.done(rig.host.within(rig.peer, handle.cancel_goal_async))
    assert len(cancel_response.goals_canceling) == 1
    assert client.next() == {"op": "cancel_action_goal", "id": goal["id"], "action": ACTION}
    assert not result.done()
    finish(rig, client, 1, {"error_msg": "stopped"}, GoalStatus.STATUS_CANCELED)
    response = rig.done(result)
    assert (response.status, response.result.error_msg) == (GoalStatus.STATUS_CANCELED, "stopped")


def test_canceled_status_without_a_cancel_request_aborts(rig: Rig, client: Client) -> None:
    result = rig.result(rig.send_goal())
    client.next()
    with pytest.raises(RequestFailed, match="nobody canceled it"):
        finish(rig, client, 1, {"error_msg": "stopped"}, GoalStatus.STATUS_CANCELED)
    response = rig.done(result)
    assert (response.status, response.result.error_msg) == (GoalStatus.STATUS_ABORTED, "stopped")


def test_failed_goal_is_aborted_with_an_empty_result(rig: Rig, client: Client) -> None:
    result = rig.result(rig.send_goal())
    client.next()
    finish(rig, client, 1, "the motor is hot", GoalStatus.STATUS_SUCCEEDED, result=False)
    response = rig.done(result)
    assert (response.status, response.result) == (GoalStatus.STATUS_ABORTED, Spin.Result())


def test_mismatching_values_fail_feedback_and_abort_result(rig: Rig, client: Client) -> None:
    result = rig.result(rig.send_goal())
    identifier = client.next()["id"]
    with pytest.raises(RequestFailed, match="requires a float for field angular_distance_traveled"):
        rig.run(lambda: client.actions.feedback(ACTION, identifier, {"angular_distance_traveled": "far"}))
    assert not result.done()
    with pytest.raises(RequestFailed, match="requires a string for field error_msg"):
        finish(rig, client, 1, {"error_msg": 1}, GoalStatus.STATUS_SUCCEEDED)
    response = rig.done(result)
    assert (response.status, response.result) == (GoalStatus.STATUS_ABORTED, Spin.Result())


def test_unadvertised_action_aborts_goals_and_rejects_new_ones(
    rig: Rig, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(providers, "DESTROY_DELAY_S", 60.0)
    results = [rig.result(rig.send_goal()) for _ in range(2)]
    client.next(), client.next()
    rig.run(lambda: client.actions.unadvertise(ACTION))
    assert not rig.send_goal().accepted
    for result in results:
        response = rig.done(result)
        assert (response.status, response.result) == (GoalStatus.STATUS_ABORTED, Spin.Result())
    with pytest.raises(Empty):
        client.received.get_nowait()


def test_idle_action_of_disconnected_client_is_removed_at_once(rig: Rig, client: Client) -> None:
    rig.host.until(rig.action_client().server_is_ready, what="the action")
    rig.run(client.actions.close)
    other = rig.client()
    rig.run(lambda: other.actions.advertise(ACTION, ACTION_TYPE))
    handle = rig.send_goal()
    assert handle.accepted
    assert other.next()["id"] == f"action_goal:{ACTION}:1"
    with pytest.raises(Empty):
        client.received.get_nowait()
    with pytest.raises(RequestFailed, match="the client has disconnected"):
        rig.run(lambda: client.actions.advertise(ACTION, ACTION_TYPE))


def test_goal_at_disconnected_client_is_aborted(rig: Rig, client: Client) -> None:
    result = rig.result(rig.send_goal())
    client.next()
    rig.run(client.actions.close)
    assert rig.done(result).status == GoalStatus.STATUS_ABORTED


def test_action_survives_a_caller_that_vanishes(rig: Rig, client: Client) -> None:
    rig.result(rig.send_goal())
    client.next()
    rig.replace_peer()
    finish(rig, client, 1, {}, GoalStatus.STATUS_SUCCEEDED)
    result = rig.result(rig.send_goal())
    client.next()
    finish(rig, client, 2, {}, GoalStatus.STATUS_SUCCEEDED)
    assert rig.done(result).status == GoalStatus.STATUS_SUCCEEDED


def test_action_advertised_again_counts_goals_from_one(rig: Rig, client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(providers, "DESTROY_DELAY_S", 0.1)
    result = rig.result(rig.send_goal())
    assert client.next()["id"] == f"action_goal:{ACTION}:1"
    rig.run(lambda: client.actions.advertise(ACTION, ACTION_TYPE))
    assert rig.done(result).status == GoalStatus.STATUS_ABORTED
    # Until the old server is destroyed, it rejects goals that the new one accepts.
    rig.host.until(lambda: rig.run(rig.action_servers) == 1, what="the old server's end")
    result = rig.result(rig.send_goal())
    assert client.next()["id"] == f"action_goal:{ACTION}:1"
    finish(rig, client, 1, {}, GoalStatus.STATUS_SUCCEEDED)
    assert rig.done(result).status == GoalStatus.STATUS_SUCCEEDED


def test_action_messages_with_unknown_ids_are_refused(rig: Rig, client: Client) -> None:
    with pytest.raises(RequestFailed, match=r"^Received action feedback for unrecognized id: goal$"):
        rig.run(lambda: client.actions.feedback(ACTION, "goal", {}))
    with pytest.raises(RequestFailed, match=r"^Received action result for unrecognized id: goal$"):
        rig.run(lambda: client.actions.result(ACTION, "goal", {}, 4, True))
    with pytest.raises(RequestFailed, match=r"^Received action abort request for unrecognized id: goal$"):
        rig.run(lambda: client.actions.result(ACTION, "goal", {}, 4, False))
    with pytest.raises(RequestFailed, match=r"^Action /other has not been advertised via rosbridge\.$"):
        rig.run(lambda: client.actions.feedback("/other", "goal", {}))


@pytest.mark.parametrize(
    ("action", "type_name", "text"),
    [
        ("/turn", "nav2_msgs/NoSuchType", "Unable to import action class NoSuchType from package nav2_msgs"),
        ("/turn//twice", "nav2_msgs/Spin", "must not contain repeated '/'"),
        ("turn/", "nav2_msgs/Spin", "Invalid topic name: .* 'turn/'$"),
    ],
)
def test_action_with_invalid_name_or_type_is_refused(rig: Rig, action: str, type_name: str, text: str) -> None:
    client = rig.client()
    with pytest.raises(RequestFailed, match=text):
        rig.run(lambda: client.actions.advertise(action, type_name))
    with pytest.raises(RequestFailed, match=f"^Action {action} has not been advertised via rosbridge, can't unadvertise.$"):
        rig.run(lambda: client.actions.unadvertise(action))


def test_actions_come_and_go_under_load(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(providers, "DESTROY_DELAY_S", 0.0)
    client = rig.client()
    for _ in range(20):
        rig.run(lambda: client.actions.advertise(ACTION, ACTION_TYPE))
        result = rig.result(rig.send_goal())
        client.next()
        finish(rig, client, 1, {}, GoalStatus.STATUS_SUCCEEDED)
        assert rig.done(result).status == GoalStatus.STATUS_SUCCEEDED
        rig.run(lambda: client.actions.unadvertise(ACTION))
        rig.host.until(lambda: not rig.action_client().server_is_ready(), what="the action's end")
