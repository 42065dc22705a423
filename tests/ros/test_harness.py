"""The tests' own host of nodes: what it started has ended when it says so."""

from __future__ import annotations

import threading

import pytest

pytestmark = pytest.mark.graph


def test_no_executor_thread_outlives_the_host(graph_host) -> None:
    from lupin_runtime.ros import LupinNode

    graph_host.add(LupinNode("harness_a"))
    graph_host.add(LupinNode("harness_b"))
    running = {thread.name: thread for thread in threading.enumerate()}
    assert {"harness_a", "harness_b"} <= running.keys()
    graph_host.close()
    assert not running["harness_a"].is_alive() and not running["harness_b"].is_alive()


def test_an_exception_in_a_callback_fails_the_test_that_hosts_it(graph_host) -> None:
    from lupin_runtime.ros import LupinNode

    def fail() -> None:
        raise ArithmeticError("in a callback")

    graph_host.add(LupinNode("harness_c")).create_timer(0.01, fail)
    with pytest.raises(ArithmeticError, match="in a callback"):
        graph_host.until(lambda: False, timeout_s=20.0)
    graph_host._errors.clear()
