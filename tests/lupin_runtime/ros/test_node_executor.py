"""The executor of a node: what it calls itself, what it leaves to rclpy, and what changes while it waits."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from tests.support.waiting import WAIT_S, wait_for_nothing, wait_until

if TYPE_CHECKING:
    from lupin_runtime.ros import LupinNode

pytestmark = [pytest.mark.graph, pytest.mark.usefixtures("graph_host")]


class Spun:
    """A node that a NodeExecutor spins in a thread."""

    def __init__(self) -> None:
        from lupin_runtime.ros import LupinNode
        from lupin_runtime.ros.node_executor import NodeExecutor

        self.node: LupinNode = LupinNode("spun")
        self.executor = NodeExecutor()
        self.executor.add_node(self.node)
        self.error: BaseException | None = None
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        try:
            while not self._stopping.is_set():
                self.executor.spin_once()
        except BaseException as error:
            self.error = error

    def close(self) -> None:
        self._stopping.set()
        self.executor.wake()
        self._thread.join(WAIT_S)
        assert not self._thread.is_alive()
        self.executor.shutdown()
        self.node.destroy_node()

    def wait_until(self, condition: Callable[[], object], what: str) -> None:
        """Wait until `condition()` is true; raise the error that ended the spinning."""

        def check() -> None:
            if self.error is not None:
                raise self.error

        wait_until(condition, what, interval_s=0.001, each=check)


@pytest.fixture
def spun() -> Iterator[Spun]:
    one = Spun()
    yield one
    one.close()


def test_executor_calls_timers_subscriptions_and_guards(spun: Spun) -> None:
    from std_msgs.msg import Bool

    ticks: list[int] = []
    received: list[bool] = []
    guarded: list[int] = []
    spun.node.create_timer(0.01, lambda: ticks.append(1))
    spun.node.subscription(graph.ESTOP_STATE, lambda message: received.append(message.data))
    guard = spun.node.create_guard_condition(lambda: guarded.append(1))
    publisher = spun.node.publisher(graph.ESTOP_STATE)
    wait_until(publisher.get_subscription_count, "the subscription")
    publisher.publish(Bool(data=True))
    guard.trigger()
    wait_until(lambda: len(ticks) >= 5 and received == [True] and guarded == [1], "all callbacks")


def test_entity_created_while_it_waits_is_served(spun: Spun) -> None:
    ticks: list[int] = []
    wait_for_nothing(0.1, "an event")
    spun.node.create_timer(0.01, lambda: ticks.append(1))
    wait_until(lambda: ticks, "the new timer")


def test_cancelled_and_destroyed_timers_are_not_called(spun: Spun) -> None:
    calls: dict[str, int] = {"once": 0, "destroyed": 0, "last": 0}

    def count(name: str, then: Callable[[], object]) -> Callable[[], None]:
        def tick() -> None:
            calls[name] += 1
            then()

        return tick

    once = spun.node.create_timer(0.05, count("once", lambda: (once.cancel(), spun.node.destroy_timer(destroyed))))
    destroyed = spun.node.create_timer(0.05, count("destroyed", lambda: None))
    spun.node.create_timer(0.05, count("last", lambda: None))
    wait_until(lambda: calls["last"] >= 3, "the timer that stays")
    assert calls["once"] == 1 and calls["destroyed"] <= 1
    once.reset()
    wait_until(lambda: calls["once"] == 2, "the timer that was reset")


def test_coroutine_of_a_service_awaits_a_call_of_its_own_node(spun: Spun) -> None:
    """Two services of one node, of which one waits for the other and for a timer: rclpy's part of the executor."""
    from rclpy.callback_groups import ReentrantCallbackGroup

    from lupin_runtime.arm import async_wait
    from lupin_runtime.ros.interfaces import interface

    trigger = interface(graph.ARM_INIT.type)
    group = ReentrantCallbackGroup()
    inner = spun.node.create_client(trigger, "inner", callback_group=group)
    ticks: list[int] = []

    async def on_outer(_: Any, response: Any) -> Any:
        await async_wait.sleep(spun.node, 0.05)
        answer = await async_wait.call(spun.node, inner, trigger.Request())
        response.success, response.message = answer.success, f"outer after {answer.message}"
        return response

    def on_inner(_: Any, response: Any) -> Any:
        response.success, response.message = True, "inner"
        return response

    spun.node.create_service(trigger, "inner", on_inner, callback_group=group)
    spun.node.create_service(trigger, "outer", on_outer, callback_group=group)
    spun.node.create_timer(0.01, lambda: ticks.append(1))
    outer = spun.node.create_client(trigger, "outer", callback_group=group)
    wait_until(outer.service_is_ready, "the service")
    for _ in range(3):
        count = len(ticks)
        future = outer.call_async(trigger.Request())
        wait_until(future.done, "the answer")
        assert future.result().message == "outer after inner"
        assert len(ticks) > count, "timers are called meanwhile"


def test_no_wake_is_lost_beside_services_and_coroutines(spun: Spun) -> None:
    """rclpy may see a trigger, which it takes thereby, and handle something else first."""
    from rclpy.callback_groups import ReentrantCallbackGroup

    from lupin_runtime.arm import async_wait
    from lupin_runtime.ros.interfaces import interface
    from lupin_runtime.ros.wake import Wake

    trigger = interface(graph.ARM_INIT.type)
    group = ReentrantCallbackGroup()
    spun.executor.all_due_s = math.inf  # else it would look for what was left to rclpy every 10 s
    woken: list[int] = []

    async def on_call(_: Any, response: Any) -> Any:
        await async_wait.sleep(spun.node, 0.002)
        return response

    spun.node.create_service(trigger, "service", on_call, callback_group=group)
    client = spun.node.create_client(trigger, "service", callback_group=group)
    wake = Wake(spun.node, lambda: woken.append(1))
    wait_until(client.service_is_ready, "the service")
    for _ in range(100):
        count = len(woken)
        future = client.call_async(trigger.Request())
        wake.trigger()
        spun.wait_until(lambda count=count: len(woken) > count, f"wake {count}")  # type: ignore[misc]
        spun.wait_until(future.done, f"answer {count}")


def test_wake_that_the_middleware_loses_is_made_up_for(spun: Spun) -> None:
    """Fast DDS may reset a guard condition that is triggered while it returns another event."""
    from lupin_runtime.ros.wake import Wake

    woken: list[int] = []
    wake = Wake(spun.node, lambda: woken.append(1))
    trigger = wake._guard.trigger

    def lose_one() -> None:
        wake._guard.trigger = trigger

    wake._guard.trigger = lose_one
    wake.trigger()
    assert wake._guard.trigger == trigger
    spun.node.create_timer(0.01, lambda: None)
    spun.wait_until(lambda: woken, "the function")


def test_coroutine_of_a_timer_is_run(spun: Spun) -> None:
    from rclpy.callback_groups import ReentrantCallbackGroup

    from lupin_runtime.arm import async_wait

    ended: list[int] = []

    async def tick() -> None:
        await async_wait.sleep(spun.node, 0.02)
        ended.append(1)

    spun.node.create_timer(0.05, tick, callback_group=ReentrantCallbackGroup())
    wait_until(lambda: len(ended) >= 2, "two coroutines")


def test_coroutine_of_a_guard_condition_is_run(spun: Spun) -> None:
    ended: list[int] = []

    async def end() -> None:
        ended.append(1)

    guard = spun.node.create_guard_condition(end)
    for count in (1, 2):
        guard.trigger()
        wait_until(lambda count=count: len(ended) == count, "the coroutine")  # type: ignore[misc]


def test_exception_of_a_callback_ends_the_spinning(spun: Spun) -> None:
    def fail() -> None:
        raise RuntimeError("a defect")

    spun.node.create_timer(0.01, fail)
    wait_until(lambda: spun.error is not None, "the error")
    assert str(spun.error) == "a defect"


def test_polled_subscription_is_left_to_its_owner(spun: Spun) -> None:
    from sensor_msgs.msg import JointState

    from lupin_runtime.ros.polled_subscription import take_newest_with

    joints = spun.node.polled_subscription(graph.JOINT_STATES, graph.BEST5)
    publisher = spun.node.publisher(graph.JOINT_STATES)
    wait_until(publisher.get_subscription_count, "the subscription")
    published_s = time.time()
    publisher.publish(JointState(name=["shoulder_pan_joint"], position=[1.0]))
    publisher.publish(JointState(name=["front_left_wheel"]))
    wait_for_nothing(0.3, "an event of the executor")
    taken = take_newest_with(joints, b"shoulder_pan_joint")
    assert taken is not None and 0.25 <= taken.age_s <= time.time() - published_s
    assert take_newest_with(joints, b"shoulder_pan_joint") is None


def test_timer_that_is_always_due_keeps_nobody_waiting(spun: Spun) -> None:
    from rclpy.executors import SingleThreadedExecutor
    from std_srvs.srv import Trigger

    from lupin_runtime.ros import LupinNode

    def serve(_: Any, response: Any) -> Any:
        response.success = True
        return response

    spun.node.create_service(Trigger, "/spun/serve", serve)
    spun.node.create_timer(0.001, lambda: time.sleep(0.003))
    asking = LupinNode("asking")
    client = asking.create_client(Trigger, "/spun/serve")
    executor = SingleThreadedExecutor()
    executor.add_node(asking)
    wait_until(client.service_is_ready, "the service", each=lambda: executor.spin_once(0.05))
    answer = client.call_async(Trigger.Request())
    wait_until(answer.done, "the answer", each=lambda: executor.spin_once(0.05))
    assert answer.result().success
    executor.shutdown(timeout_sec=2.0)
    asking.destroy_node()
