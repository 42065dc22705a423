"""The alarms of the arm's status are the run's, as long as the status is repeated."""

from __future__ import annotations

import pytest

from lupin_runtime import graph

pytestmark = pytest.mark.graph


@pytest.mark.usefixtures("private_graph")
def test_arms_alarms_are_the_runs_until_it_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    from std_msgs.msg import String

    from lupin_runtime.stack import graph_monitor

    monitor = graph_monitor.GraphMonitor(rated=())
    try:
        publisher = monitor.node.publisher(graph.ARM_STATUS)

        def alarms() -> list[str]:
            return list(monitor.alarms)

        def publish(text: str) -> None:
            publisher.publish(String(data=text))
            for _ in range(20):
                monitor.spin(0.05)

        publish('{"alarms": ["the elbow does not follow"]}')
        assert alarms() == ["the elbow does not follow"]
        for text in ("{", "[]", '{"alarms": 3}'):
            publish(text)
        assert alarms() == []
        publish('{"alarms": ["the elbow does not follow"]}')
        monkeypatch.setattr(graph_monitor, "SILENT_AFTER_S", -1.0)
        assert alarms() == []
    finally:
        monitor.close()
