"""A run's mission is not requested before the e-stop's process was heard: its release may be just now."""

from __future__ import annotations

import json

import pytest

from lupin_runtime import graph
from tests.support.waiting import wait_until

pytestmark = pytest.mark.graph


@pytest.mark.usefixtures("private_graph")
def test_estop_that_was_not_heard_counts_as_waiting() -> None:
    from std_msgs.msg import String

    from lupin_runtime.stack.graph_monitor import GraphMonitor

    monitor = GraphMonitor(rated=())
    try:
        assert monitor.estop_waits
        publisher = monitor.node.publisher(graph.ESTOP_STATUS)
        for unheard, waits in (([], False), (["console"], True), ([], False)):
            publisher.publish(String(data=json.dumps({"unheard": unheard})))

            def is_heard(waits: bool = waits) -> bool:
                monitor.spin(0.05)
                return monitor.estop_waits == waits

            wait_until(is_heard, f"a status with {unheard} unheard")
    finally:
        monitor.close()
