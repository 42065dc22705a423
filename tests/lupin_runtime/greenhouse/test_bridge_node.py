"""The bridge's one service on a real graph."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph

if TYPE_CHECKING:
    from lupin_msgs.srv import GetTagReading_Response

    from lupin_runtime.greenhouse.node import GreenhouseBridge
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


@pytest.fixture
def ask(graph_host: GraphHost) -> Callable[..., Any]:
    """Start a bridge and return a function that reads a tag through it."""
    from lupin_msgs.srv import GetTagReading

    from lupin_runtime.greenhouse.node import GreenhouseBridge
    from lupin_runtime.ros import LupinNode

    client_node = LupinNode("asker")
    client = client_node.client(graph.GET_TAG_READING)
    graph_host.add(client_node)

    def start(**parameters: Any) -> Callable[..., Any]:
        bridge = graph_host.add(GreenhouseBridge(parameters))
        graph_host.until(client.service_is_ready, what="the bridge's service")

        def read(tag_id: str) -> tuple[GreenhouseBridge, GetTagReading_Response]:
            future = client.call_async(GetTagReading.Request(tag_id=tag_id))
            graph_host.until(future.done, what="an answer")
            return bridge, future.result()

        return read

    return start


def test_reading_carries_ros_time_and_time_of_day(ask: Callable[..., Any]) -> None:
    from lupin_runtime.ros import stamp_ns

    read = ask(debug_time_of_day=12.0, debug_seed=3)
    bridge, response = read("12")
    assert (response.status, response.error_message) == (response.STATUS_OK, "")
    reading = response.reading
    assert reading.tag_id == "12" and reading.sim_time_of_day_seconds == 43200.0
    assert 0 <= bridge.now_ns() - stamp_ns(reading.stamp) < 5e9
    assert {r.name for r in reading.readings} == {"temperature", "humidity", "co2"}
    assert all(r.value > 5.0 for r in reading.readings)


def test_unknown_tag_gets_status_unknown(ask: Callable[..., Any]) -> None:
    _, response = ask()("8")
    assert response.status == response.STATUS_UNKNOWN_TAG
    assert "no tag '8'" in response.error_message and list(response.reading.readings) == []


def test_node_has_the_name_and_service_of_the_contract(ask: Callable[..., Any]) -> None:
    bridge, _ = ask()("1")
    assert bridge.get_name() == "greenhouse_bridge"
    assert graph.GET_TAG_READING.name == f"/{bridge.get_name()}/get_tag_reading"


@pytest.mark.usefixtures("graph_host")
def test_corrupt_layout_stops_the_node_from_starting(tmp_path: Path) -> None:
    from lupin_runtime.greenhouse.node import GreenhouseBridge

    path = tmp_path / "layout.json"
    path.write_text('{"tags": {\n "1": {]}}')
    with pytest.raises(ValueError, match=r"layout\.json:2: not JSON"):
        GreenhouseBridge({"tag_file": str(path)})
