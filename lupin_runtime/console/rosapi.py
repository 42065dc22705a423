"""Answers calls of rosapi's services, with which clients inspect the graph, interface types and parameters.

Names and fields are those of the package rosapi_msgs. The console answers such calls itself: the services do not exist on the
graph.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from rclpy.action import get_action_names_and_types
from rclpy.node import Node, NodeNameNonExistentError

from lupin_runtime.console.rosapi_parameters import Done, RosApiParameters, served_services
from lupin_runtime.console.type_definitions import full_text, type_definitions
from lupin_runtime.record.definitions import share_folders
from lupin_runtime.ros import type_names

PREFIX = "/rosapi/"

Response = dict[str, Any]
_NamesAndTypes = Iterable[tuple[str, list[str]]]


class InvalidCall(ValueError):
    """A call of a service that rosapi does not have, or with invalid arguments."""


@dataclass(frozen=True)
class _Service:
    """A service: its type, the request's fields, which are all strings, and the function that takes them in this order.

    The function returns the response's fields. With `asks_nodes` it takes `done` as its last argument instead, and calls it
    with them.
    """

    type_name: str
    fields: tuple[str, ...]
    function: Callable[..., Response | None]
    asks_nodes: bool = False


class RosApi:
    """All methods are called on the executor's thread."""

    def __init__(self, node: Node, distribution: str) -> None:
        self._node = node
        self._distribution = distribution
        self._parameters = parameters = RosApiParameters(node)
        details = functools.partial(functools.partial, _details)
        self._services = {
            f"{PREFIX}{name}": service
            for name, service in {
                "action_feedback_details": _Service("ActionFeedbackDetails", ("type",), details("action", "Feedback")),
                "action_goal_details": _Service("ActionGoalDetails", ("type",), details("action", "Goal")),
                "action_result_details": _Service("ActionResultDetails", ("type",), details("action", "Result")),
                "action_servers": _Service("GetActionServers", (), self._action_servers),
                "action_type": _Service("ActionType", ("action",), self._action_type),
                "delete_param": _Service("DeleteParam", ("name",), parameters.delete_param, asks_nodes=True),
                "get_param": _Service("GetParam", ("name", "default_value"), parameters.get_param, asks_nodes=True),
                "get_param_names": _Service("GetParamNames", (), self._parameter_names, asks_nodes=True),
                "get_ros_version": _Service("GetROSVersion", (), self._ros_version),
                "get_time": _Service("GetTime", (), self._time),
                "has_param": _Service("HasParam", ("name",), parameters.has_param, asks_nodes=True),
                "interfaces": _Service("Interfaces", (), _interfaces),
                "message_details": _Service("MessageDetails", ("type",), details("msg", None)),
                "node_details": _Service("NodeDetails", ("node",), self._node_details),
                "nodes": _Service("Nodes", (), self._nodes),
                "publishers": _Service("Publishers", ("topic",), self._publishers),
                "service_node": _Service("ServiceNode", ("service",), self._service_node),
                "service_providers": _Service("ServiceProviders", ("service",), self._service_providers),
                "service_request_details": _Service("ServiceRequestDetails", ("type",), details("srv", "Request")),
                "service_response_details": _Service("ServiceResponseDetails", ("type",), details("srv", "Response")),
                "service_type": _Service("ServiceType", ("service",), self._service_type),
                "services": _Service("Services", (), self._service_names),
                "services_for_type": _Service("ServicesForType", ("type",), self._services_for_type),
                "set_param": _Service("SetParam", ("name", "value"), parameters.set_param, asks_nodes=True),
                "subscribers": _Service("Subscribers", ("topic",), self._subscribers),
                "topic_type": _Service("TopicType", ("topic",), self._topic_type),
                "topics": _Service("Topics", (), self._topics),
                "topics_and_raw_types": _Service("TopicsAndRawTypes", (), self._topics_and_raw_types),
                "topics_for_type": _Service("TopicsForType", ("type",), self._topics_for_type),
            }.items()
        }

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the services, such as `/rosapi/topics`."""
        return tuple(self._services)

    def call(self, service: str, arguments: Any, done: Done) -> None:
        """Call a service; `done` is called once with the response's fields.

        It is called before this method returns or, if other nodes have to be asked for parameters, up to a few seconds later.
        `arguments` is a dict, a list in the order of the request's fields, or None. Raises InvalidCall.
        """
        row = self._services.get(service)
        if row is None:
            raise InvalidCall(f"Service {service} does not exist")
        texts = _read_arguments(row, arguments)
        if row.asks_nodes:
            row.function(*texts, done)
        else:
            done(row.function(*texts) or {})

    # -- topics -------------------------------------------------------------------------------------------------------
    def _visible_topics(self) -> dict[str, str]:
        return _visible(self._node.get_topic_names_and_types())

    def _topics(self) -> Response:
        topics = self._visible_topics()
        return {"topics": list(topics), "types": list(topics.values())}

    def _topics_and_raw_types(self) -> Response:
        response = self._topics()
        return {**response, "typedefs_full_text": [full_text(kind) for kind in response["types"]]}

    def _topics_for_type(self, kind: str) -> Response:
        return {"topics": [name for name, each in self._visible_topics().items() if each == kind]}

    def _topic_type(self, topic: str) -> Response:
        return {"type": self._visible_topics().get(topic, "")}

    def _publishers(self, topic: str) -> Response:
        return {"publishers": [node for node in self._visible_nodes() if topic in self._published(node)]}

    def _subscribers(self, topic: str) -> Response:
        return {"subscribers": [node for node in self._visible_nodes() if topic in self._subscribed(node)]}

    # -- services and actions -----------------------------------------------------------------------------------------
    def _visible_services(self) -> dict[str, str]:
        return _visible(served_services(self._node))

    def _service_names(self) -> Response:
        return {"services": list(self._visible_services())}

    def _services_for_type(self, kind: str) -> Response:
        return {"services": [name for name, each in self._visible_services().items() if each == kind]}

    def _service_type(self, service: str) -> Response:
        return {"type": self._visible_services().get(service, "")}

    def _service_node(self, service: str) -> Response:
        return {"node": next((node for node in self._visible_nodes() if service in self._served(node)), "")}

    def _service_providers(self, kind: str) -> Response:
        """Return the nodes that serve a type: despite its name, the request's field `service` contains a type."""
        return {"providers": [node for node in self._visible_nodes() if kind in self._served(node).values()]}

    def _action_servers(self) -> Response:
        topics = {name for name, _ in self._node.get_topic_names_and_types()}
        status = "/_action/status"
        actions = (name.removesuffix(status) for name in topics if name.endswith(status))
        return {"action_servers": sorted(name for name in actions if name and f"{name}/_action/feedback" in topics)}

    def _action_type(self, action: str) -> Response:
        kinds = dict(get_action_names_and_types(self._node)).get(action)
        return {"type": kinds[0] if kinds else ""}

    # -- nodes --------------------------------------------------------------------------------------------------------
    def _visible_nodes(self) -> list[str]:
        """Return the full names of the nodes, each once, even if several nodes share it."""
        found = self._node.get_node_names_and_namespaces()
        return sorted({f"{namespace.rstrip('/')}/{name}" for name, namespace in found if not name.startswith("_")})

    def _published(self, node: str) -> dict[str, str]:
        return _of_node(node, self._node.get_publisher_names_and_types_by_node)

    def _subscribed(self, node: str) -> dict[str, str]:
        return _of_node(node, self._node.get_subscriber_names_and_types_by_node)

    def _served(self, node: str) -> dict[str, str]:
        return _of_node(node, self._node.get_service_names_and_types_by_node)

    def _nodes(self) -> Response:
        return {"nodes": self._visible_nodes()}

    def _node_details(self, node: str) -> Response:
        """Return a node's topics and services; empty lists for an unknown node."""
        known = node in self._visible_nodes()
        return {
            "subscribing": list(self._subscribed(node)) if known else [],
            "publishing": list(self._published(node)) if known else [],
            "services": list(self._served(node)) if known else [],
        }

    def _parameter_names(self, done: Done) -> None:
        own = self._node.get_fully_qualified_name()
        self._parameters.get_param_names([node for node in self._visible_nodes() if node != own], done)

    # -- ROS itself ---------------------------------------------------------------------------------------------------
    def _time(self) -> Response:
        seconds, nanoseconds = self._node.get_clock().now().seconds_nanoseconds()
        return {"time": {"sec": seconds, "nanosec": nanoseconds}}

    def _ros_version(self) -> Response:
        return {"version": 2, "distro": self._distribution}


def _read_arguments(row: _Service, arguments: Any) -> list[str]:
    """The request's values in the order of its fields; one that is not given is empty. Raises InvalidCall."""
    request = f"rosapi_msgs/{row.type_name}_Request"
    given = {} if arguments is None else arguments
    if isinstance(given, list):
        given = dict(zip(row.fields, given))
    if not isinstance(given, dict):
        raise InvalidCall(f"Expected a JSON object for type {request} but received a {type(given)}")
    for field, value in given.items():
        if field not in row.fields:
            raise InvalidCall(f"Message type {request} does not have a field {field!s:.200}")
        if not isinstance(value, str):
            raise InvalidCall(f"{request} message requires a string for field {field}, but got a {type(value)}")
    return [given.get(field, "") for field in row.fields]


def _visible(names_and_types: _NamesAndTypes) -> dict[str, str]:
    """Return the names that have no hidden part, sorted, each with the first of its types."""
    return {
        name: kinds[0]
        for name, kinds in sorted(names_and_types)
        if kinds and not any(part.startswith("_") for part in name.split("/"))
    }


def _of_node(node: str, query: Callable[[str, str], _NamesAndTypes]) -> dict[str, str]:
    """Query a node's names and types; empty for a node that has just left the graph."""
    namespace, _, name = node.rpartition("/")
    try:
        return _visible(query(name, namespace or "/"))
    except NodeNameNonExistentError:
        return {}


def _details(kind: str, part: str | None, type_name: str) -> Response:
    """Return the definitions of a message type, or of a part of a service or action type; empty for an unknown type."""
    try:
        found = type_names.find(type_name, kind)
    except type_names.UnknownType:
        return {"typedefs": []}
    message_class = getattr(found, part, None) if part else found
    # A module named `action` may also contain other classes, as rclpy's does.
    return {"typedefs": type_definitions(message_class) if hasattr(message_class, "SLOT_TYPES") else []}


def _interfaces() -> Response:
    return {"interfaces": list(_installed_interfaces())}


@functools.cache
def _installed_interfaces() -> tuple[str, ...]:
    """Return the full names of all types that have a definition on this machine.

    They are read from the definition files instead of ament's index, which does not list wheels with Lupin's interfaces.
    """
    found = (
        f"{path.parent.parent.name}/{kind}/{path.stem}"
        for share in share_folders()
        for kind in ("msg", "srv", "action")
        for path in share.glob(f"*/{kind}/*")
        if path.suffix in (f".{kind}", ".idl")
    )
    return tuple(sorted(set(found)))
