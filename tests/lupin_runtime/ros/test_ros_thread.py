"""Work that other threads queue for a node's executor: it runs in order, and leaves time for the node's own events."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

import pytest

from tests.support.waiting import WAIT_S

if TYPE_CHECKING:
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


def test_timer_runs_between_queued_functions(graph_host: GraphHost) -> None:
    from lupin_runtime.ros import LupinNode
    from lupin_runtime.ros.ros_thread import RosThread

    node = LupinNode("worker")
    ros, done = RosThread(node), list[int]()
    ticks: list[int] = []  # how much work was done at each call of the timer
    node.create_timer(0.01, lambda: ticks.append(len(done)))

    def work(number: int) -> None:
        time.sleep(0.005)
        done.append(number)

    futures = [ros.run(lambda number=number: work(number)) for number in range(100)]  # type: ignore[misc]
    graph_host.add(node)
    graph_host.until(lambda: futures[-1].done(), what="all work to be done")
    assert done == list(range(100))
    between = [count for count in ticks if 0 < count < 100]
    assert len(between) > 10, "half a second of work leaves time for the timer"


def test_work_queued_by_many_threads_is_done(graph_host: GraphHost) -> None:
    from lupin_runtime.ros import LupinNode
    from lupin_runtime.ros.ros_thread import RosThread

    ros = RosThread(graph_host.add(LupinNode("worker")))

    def queue() -> None:
        for _ in range(500):
            ros.run(lambda: None)

    threads = [threading.Thread(target=queue) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert ros.run(lambda: "last").result(WAIT_S) == "last"


def test_exception_is_reported_to_the_caller(graph_host: GraphHost) -> None:
    from lupin_runtime.ros import LupinNode
    from lupin_runtime.ros.ros_thread import RosThread

    ros = RosThread(graph_host.add(LupinNode("worker")))
    with pytest.raises(ZeroDivisionError):
        ros.run(lambda: 1 / 0).result(WAIT_S)
    assert ros.run(lambda: 1).result(WAIT_S) == 1
