"""The fixture `graph_host`, which runs nodes for tests: its threads end with it."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


def test_no_executor_thread_outlives_the_graph_host(graph_host: GraphHost) -> None:
    from lupin_runtime.ros import LupinNode

    graph_host.add(LupinNode("harness_a"))
    graph_host.add(LupinNode("harness_b"))
    running = {thread.name: thread for thread in threading.enumerate()}
    assert {"harness_a", "harness_b"} <= running.keys()
    graph_host.close()
    assert not running["harness_a"].is_alive() and not running["harness_b"].is_alive()


def test_callback_exception_fails_the_hosting_test(graph_host: GraphHost) -> None:
    from lupin_runtime.ros import LupinNode

    def fail() -> None:
        raise ArithmeticError("in a callback")

    graph_host.add(LupinNode("harness_c")).create_timer(0.01, fail)
    with pytest.raises(ArithmeticError, match="in a callback"):
        graph_host.until(lambda: False)
    graph_host._errors.clear()
