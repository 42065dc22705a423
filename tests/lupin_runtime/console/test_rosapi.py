"""rosapi's services on a graph of two nodes: their answers, and that none of them blocks the executor."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from lupin_runtime.console.rosapi import RosApi
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

NOT_INSTALLED = ("ActionGoalDetails", "ActionResultDetails", "ActionFeedbackDetails")  # newer than Lupin's rosapi_msgs
VALUES = [True, 7, -2.5, "fast", [True, False], [1, 2], [0.5, 1.5], ["a", "b"]]


class Rig:
    """A node with rosapi, and a peer `/far/peer` with topics, services, an action and parameters."""

    def __init__(self, host: GraphHost) -> None:
        from rcl_interfaces.msg import ParameterDescriptor
        from rclpy.action import ActionServer
        from sensor_msgs.msg import CameraInfo
        from std_msgs.msg import String
        from std_srvs.srv import SetBool
        from tf2_msgs.action import LookupTransform

        from lupin_runtime.console.rosapi import RosApi
        from lupin_runtime.ros import LupinNode

        self.host = host
        self.console = LupinNode("console")
        self.api: RosApi = RosApi(self.console, "jazzy")
        self.peer = LupinNode("peer", namespace="/far", start_parameter_services=True)
        self.peer.declare_parameter("speed", 0.5)
        self.peer.declare_parameter("anything", 1, ParameterDescriptor(dynamic_typing=True))
        self.peer.create_publisher(String, "/chatter", 1)
        self.peer.create_publisher(String, "/chatter", 1)
        self.peer.create_publisher(String, "/_secret/chatter", 1)
        self.console.create_subscription(CameraInfo, "/camera", lambda _: None, 1)
        self.peer.create_service(SetBool, "/switch", lambda _, response: response)
        self.action = ActionServer(self.peer, LookupTransform, "/look", lambda _: LookupTransform.Result())
        host.add(self.console)
        host.add(self.peer)
        host.until(lambda: self.call("service_node", service="/switch")["node"], what="the peer's services")
        host.until(lambda: self.call("action_type", action="/look")["type"], what="the peer's action")
        host.until(lambda: "/far/peer" in self.call("publishers", topic="/chatter")["publishers"], what="the publisher")

    def call(self, name: str, /, **arguments: str) -> dict[str, Any]:
        """Call a service, and wait for its response."""
        responses: list[dict[str, Any]] = []
        self.host.within(self.console, lambda: self.api.call(f"/rosapi/{name}", arguments, responses.append))
        self.host.until(lambda: responses, what=f"the response of {name}")
        assert len(responses) == 1
        return responses[0]


@pytest.fixture
def rig(graph_host: GraphHost) -> Iterator[Rig]:
    rig = Rig(graph_host)
    yield rig
    # No call leaves a ROS client behind.
    graph_host.until(lambda: not list(rig.console.clients), what="the end of all clients")


def test_responses_match_the_types_of_rosapi_msgs(rig: Rig) -> None:
    import rosapi_msgs.srv
    from builtin_interfaces.msg import Time

    from lupin_runtime.console import values

    assert len(rig.api.names) == 29
    for name in rig.api.names:
        row = rig.api._services[name]
        response = rig.call(name.removeprefix("/rosapi/"))
        if row.type_name in NOT_INSTALLED:
            assert (row.fields, list(response)) == (("type",), ["typedefs"])
            continue
        service = getattr(rosapi_msgs.srv, row.type_name)
        fields = service.Response.get_fields_and_field_types()
        assert set(response) == set(fields), name
        values.fill(service.Response, response, Time)
        assert row.fields == tuple(service.Request.get_fields_and_field_types()), name
        assert set(service.Request.get_fields_and_field_types().values()) <= {"string"}, name


def test_topics_are_listed_with_their_types(rig: Rig) -> None:
    topics = rig.call("topics")
    kinds = dict(zip(topics["topics"], topics["types"]))
    assert kinds["/chatter"] == "std_msgs/msg/String" and kinds["/camera"] == "sensor_msgs/msg/CameraInfo"
    assert not any("/_" in name for name in kinds)
    raw = rig.call("topics_and_raw_types")
    texts = dict(zip(raw["topics"], raw["typedefs_full_text"]))
    assert texts["/chatter"].strip().endswith("string data") and "MSG: sensor_msgs/RegionOfInterest" in texts["/camera"]
    assert rig.call("topics_for_type", type="std_msgs/msg/String") == {"topics": ["/chatter"]}
    assert rig.call("topics_for_type", type="std_msgs/String") == {"topics": []}
    assert rig.call("topic_type", topic="/chatter") == {"type": "std_msgs/msg/String"}
    assert rig.call("topic_type", topic="/_secret/chatter") == rig.call("topic_type", topic="no topic") == {"type": ""}


def test_publishers_and_subscribers_are_listed_as_nodes(rig: Rig) -> None:
    assert rig.call("publishers", topic="/chatter") == {"publishers": ["/far/peer"]}
    assert rig.call("publishers", topic="/camera") == {"publishers": []}
    assert rig.call("subscribers", topic="/camera") == {"subscribers": ["/console"]}
    assert rig.call("subscribers", topic="not/a topic") == {"subscribers": []}


def test_services_are_listed_with_their_types(rig: Rig) -> None:
    names = rig.call("services")["services"]
    assert "/switch" in names and not any("/_" in name for name in names)
    assert rig.call("services_for_type", type="std_srvs/srv/SetBool") == {"services": ["/switch"]}
    assert rig.call("service_type", service="/switch") == {"type": "std_srvs/srv/SetBool"}
    assert rig.call("service_type", service="/look/_action/cancel_goal") == {"type": ""}
    assert rig.call("service_node", service="/switch") == {"node": "/far/peer"}
    assert rig.call("service_node", service="/nothing") == {"node": ""}
    assert rig.call("service_providers", service="std_srvs/srv/SetBool") == {"providers": ["/far/peer"]}
    assert rig.call("service_providers", service="/switch") == {"providers": []}


def test_actions_are_found_by_their_topics(rig: Rig) -> None:
    assert rig.call("action_servers") == {"action_servers": ["/look"]}
    assert rig.call("action_type", action="/look") == {"type": "tf2_msgs/action/LookupTransform"}
    assert rig.call("action_type", action="/switch") == {"type": ""}


def test_node_details_omit_hidden_names(rig: Rig) -> None:
    # Nodes of an earlier test may still be on the graph for a moment.
    rig.host.until(lambda: rig.call("nodes") == {"nodes": ["/console", "/far/peer"]}, what="the two nodes")
    details = rig.call("node_details", node="/far/peer")
    assert "/chatter" in details["publishing"] and "/switch" in details["services"]
    assert not any("/_" in name for names in details.values() for name in names)
    assert rig.call("node_details", node="/console")["subscribing"] == ["/camera"]
    for unknown in ("/far", "peer", "", "/", "a b"):
        assert rig.call("node_details", node=unknown) == {"subscribing": [], "publishing": [], "services": []}


def test_details_describe_types_and_their_parts(rig: Rig) -> None:
    def types(name: str, type_name: str) -> list[str]:
        return [each["type"] for each in rig.call(name, type=type_name)["typedefs"]]

    assert types("message_details", "std_msgs/Header") == ["std_msgs/Header", "builtin_interfaces/Time"]
    assert types("service_request_details", "std_srvs/srv/SetBool") == ["std_srvs/SetBool_Request"]
    assert types("service_response_details", "std_srvs/SetBool") == ["std_srvs/SetBool_Response"]
    look = "tf2_msgs/action/LookupTransform"
    assert types("action_goal_details", look)[0] == "tf2_msgs/LookupTransform_Goal"
    assert types("action_result_details", look)[0] == "tf2_msgs/LookupTransform_Result"
    assert types("action_feedback_details", look)[0] == "tf2_msgs/LookupTransform_Feedback"
    for name in (each.removeprefix("/rosapi/") for each in rig.api.names if each.endswith("_details") and "node" not in each):
        for unknown in ("", "nosuch_msgs/msg/Thing", "std_msgs/Nothing", "a/b/c/d", "..", "rclpy/ActionClient", "rclpy/Node"):
            assert types(name, unknown) == []


def test_interfaces_include_lupins_own(rig: Rig) -> None:
    found = rig.call("interfaces")["interfaces"]
    assert found == sorted(set(found))
    assert {"std_msgs/msg/String", "lupin_msgs/msg/TwinState", "std_srvs/srv/SetBool"} <= set(found)
    assert "tf2_msgs/action/LookupTransform" in found


def test_ros_time_and_version_are_returned(rig: Rig) -> None:
    stamp = rig.call("get_time")["time"]
    assert abs(stamp["sec"] + stamp["nanosec"] / 1e9 - time.time()) < 10.0
    assert rig.call("get_ros_version") == {"version": 2, "distro": "jazzy"}


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"topick": "/x"}, "does not have a field topick"),
        ({"topic": 3}, "requires a string for field topic"),
        ({"topic": None}, "requires a string for field topic"),
        ({3: "/x"}, "does not have a field 3"),
        ([["/x"]], "requires a string for field topic"),
        ("/x", "Expected a JSON object"),
        (3, "Expected a JSON object"),
    ],
)
def test_bad_arguments_raise_a_value_error(rig: Rig, arguments: Any, reason: str) -> None:
    responses: list[dict[str, Any]] = []
    with pytest.raises(ValueError, match=reason):
        rig.api.call("/rosapi/topic_type", arguments, responses.append)
    with pytest.raises(ValueError, match="Service /rosapi/nothing does not exist"):
        rig.api.call("/rosapi/nothing", {}, responses.append)
    assert not responses


def test_arguments_may_be_a_list_or_absent(rig: Rig) -> None:
    responses: list[dict[str, Any]] = []

    def ask() -> None:
        for arguments in (["/chatter"], ["/chatter", 3], None, []):
            rig.api.call("/rosapi/topic_type", arguments, responses.append)

    rig.host.within(rig.console, ask)
    assert [response["type"] for response in responses] == ["std_msgs/msg/String"] * 2 + [""] * 2


@pytest.mark.parametrize("value", VALUES, ids=str)
def test_parameter_of_another_node_is_set_and_read(rig: Rig, value: Any) -> None:
    done = {"successful": True, "reason": ""}
    assert rig.call("set_param", name="/far/peer:anything", value=json.dumps(value)) == done
    found = rig.call("get_param", name="far/peer:anything", default_value="")
    assert found == {"value": json.dumps(value), **done}
    stored = rig.peer.get_parameter("anything").value
    assert (stored if isinstance(value, str) or not isinstance(value, list) else list(stored)) == value


def test_deleted_parameter_is_not_found(rig: Rig) -> None:
    name = "/far/peer:anything"
    assert rig.call("has_param", name=name) == {"exists": True}
    for _ in range(2):
        assert rig.call("delete_param", name=name) == {"successful": True, "reason": ""}
        assert rig.call("has_param", name=name) == {"exists": False}
    found = rig.call("get_param", name=name, default_value="[1,2]")
    assert found == {"value": "[1, 2]", "successful": False, "reason": "Parameter anything not found"}


def test_refused_value_returns_the_nodes_reason(rig: Rig) -> None:
    refused = rig.call("set_param", name="/far/peer:speed", value='"fast"')
    assert not refused["successful"] and "DOUBLE" in refused["reason"]
    too_large = rig.call("set_param", name="/far/peer:speed", value=str(2**64))
    assert not too_large["successful"] and "out of range" in too_large["reason"]
    no_json = rig.call("set_param", name="/far/peer:speed", value="fast")
    assert not no_json["successful"] and "JSON" in no_json["reason"]
    assert rig.peer.get_parameter("speed").value == 0.5


@pytest.mark.parametrize("name", ["", ":", "speed", "/far/peer:", ":speed", "/:speed", "/far/peer:speed:x"])
def test_malformed_parameter_name_is_reported(rig: Rig, name: str) -> None:
    answer = rig.call("get_param", name=name, default_value="3")
    assert (answer["value"], answer["successful"]) == ("3", False) and "/node:parameter" in answer["reason"]
    assert not rig.call("set_param", name=name, value="3")["successful"]
    assert not rig.call("delete_param", name=name)["successful"]
    assert rig.call("has_param", name=name) == {"exists": False}


def test_unknown_node_is_reported_at_once(rig: Rig) -> None:

    for node in ("/nobody", "nobody", "/console", "/a b"):
        answer = rig.call("get_param", name=f"{node}:speed", default_value="")
        service = f"/{node.lstrip('/')}/get_parameters"
        assert answer == {"value": '""', "successful": False, "reason": f"Service {service} is not available"}


def test_unknown_parameters_are_not_found(rig: Rig) -> None:
    assert rig.call("has_param", name="/far/peer:nothing") == {"exists": False}
    assert rig.call("get_param", name="/far/peer:nothing")["reason"] == "Parameter nothing not found"
    assert rig.call("delete_param", name="/far/peer:nothing") == {"successful": True, "reason": ""}
    assert not rig.call("set_param", name="/far/peer:nothing", value="3")["successful"]


def test_parameter_names_of_all_nodes_are_listed(rig: Rig) -> None:
    names = rig.call("get_param_names")["names"]
    assert {"/far/peer:speed", "/far/peer:anything"} <= set(names)
    assert all(name.startswith("/far/peer:") for name in names)


def test_call_to_hanging_node_times_out(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    from lupin_runtime.console import rosapi_parameters
    from lupin_runtime.ros import LupinNode

    monkeypatch.setattr(rosapi_parameters, "TIMEOUT_S", 1.0)
    monkeypatch.setattr(rosapi_parameters, "MAX_CALLS", 3)
    hanging = LupinNode("hanging", start_parameter_services=True)  # never spun
    try:
        rig.host.until(lambda: "/hanging/list_parameters" in rig.call("services")["services"])
        responses: list[dict[str, Any]] = []

        def ask() -> None:
            for service in ("get_param", "get_param", "has_param", "set_param"):
                arguments = ["/hanging:x", "3"] if service != "has_param" else ["/hanging:x"]
                rig.api.call(f"/rosapi/{service}", arguments, responses.append)

        rig.host.within(rig.console, ask)
        assert len(list(rig.console.clients)) == 1 and [each["successful"] for each in responses] == [False]
        assert "call /hanging/set_parameters again later" in responses[0]["reason"]
        rig.call("topics")
        assert len(responses) == 1  # the calls to the hanging node are still waiting
        rig.host.until(lambda: len(responses) == 4, what="the answers")
        timed_out = {"value": "3", "successful": False, "reason": "Timeout occurred"}
        assert responses[1:] == [timed_out, timed_out, {"exists": False}]
        assert "/far/peer:speed" in rig.call("get_param_names")["names"]
        assert rig.call("get_param", name="/far/peer:speed")["value"] == "0.5"
    finally:
        hanging.destroy_node()
