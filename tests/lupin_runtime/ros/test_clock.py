"""The clock of a simulated process: nodes follow `/clock` and its jumps."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from itertools import pairwise

import pytest

from lupin_runtime import graph
from tests.support.waiting import wait_until

pytestmark = pytest.mark.graph


@pytest.fixture
def context(private_graph: int) -> Iterator[None]:  # noqa: ARG001 -- the fixture must have run
    import rclpy

    rclpy.init(args=[])
    yield
    rclpy.try_shutdown()


@pytest.mark.usefixtures("context")
def test_clock_is_read_from_serialized_bytes() -> None:
    from rclpy.serialization import serialize_message
    from rosgraph_msgs.msg import Clock

    from lupin_runtime.ros import stamp_from_ns
    from lupin_runtime.ros.clock import clock_ns

    for time_ns in (0, 1, 999_999_999, 1_000_000_000, 1_795_261_540_013_877_655):
        assert clock_ns(bytes(serialize_message(Clock(clock=stamp_from_ns(time_ns))))) == time_ns


@pytest.mark.usefixtures("context")
def test_attached_nodes_follow_clock_and_a_jump_back() -> None:
    from rclpy.clock import JumpThreshold
    from rclpy.duration import Duration
    from rosgraph_msgs.msg import Clock

    from lupin_runtime.ros import LupinNode, stamp_from_ns
    from lupin_runtime.ros.clock import ClockFollower

    source, first, second = LupinNode("source"), LupinNode("first"), LupinNode("second")
    publisher = source.publisher(graph.CLOCK)
    follower = ClockFollower()
    follower.attach(first)
    follower.attach(second)
    jumps: list[int] = []
    threshold = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=False)
    handle = first.get_clock().create_jump_callback(threshold, post_callback=lambda jump: jumps.append(jump.delta.nanoseconds))
    follower.start()
    try:
        assert first.now_ns() == 0
        wait_until(publisher.get_subscription_count, "a subscription to the clock")
        for time_ns in (5_000_000_000, 7_250_000_000, 1_000_000_000):

            def follow_clock(expected: int = time_ns) -> bool:
                publisher.publish(Clock(clock=stamp_from_ns(expected)))
                return first.now_ns() == second.now_ns() == first.elapsed_clock_ns() == expected

            wait_until(follow_clock, "the time", interval_s=0.01)
        assert jumps[-1] < -6_000_000_000
    finally:
        handle.unregister()
        follower.stop()
        for node in (source, first, second):
            node.destroy_node()
    assert not any(thread.name == "clock" for thread in threading.enumerate())


@pytest.mark.usefixtures("context")
def test_wall_clock_step_does_not_delay_timers() -> None:
    """With rclpy's default clock, drive bus and e-stop would be silent for five minutes after a step back by five minutes."""
    from rclpy.clock import ClockType

    from lupin_runtime.ros import LupinNode

    node = LupinNode("node")
    try:
        assert node.create_timer(1.0, lambda: None).clock.clock_type == ClockType.STEADY_TIME
        assert node.create_timer(1.0, lambda: None, clock=None).clock.clock_type == ClockType.STEADY_TIME
        assert node.create_timer(1.0, lambda: None, clock=node.get_clock()).clock.clock_type == ClockType.ROS_TIME
    finally:
        node.destroy_node()


@pytest.mark.usefixtures("context")
def test_timers_run_on_simulated_time_under_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.task import Future
    from rosgraph_msgs.msg import Clock

    from lupin_runtime.ros import LupinNode, stamp_from_ns
    from lupin_runtime.ros.clock import ClockFollower

    monkeypatch.setattr(LupinNode, "simulated_time", True)
    source, node = LupinNode("source"), LupinNode("node")
    publisher = source.publisher(graph.CLOCK)
    follower = ClockFollower()
    follower.attach(node)
    follower.start()
    fired: list[int] = []
    node.create_timer(1.0, lambda: fired.append(node.now_ns()))
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    end = Future()
    thread = threading.Thread(target=executor.spin_until_future_complete, args=(end,), daemon=True)
    thread.start()
    now_ns = 0

    def hurry() -> bool:
        nonlocal now_ns
        now_ns += 100_000_000
        publisher.publish(Clock(clock=stamp_from_ns(now_ns)))
        return len(fired) >= 5

    try:
        wait_until(hurry, "the timer", interval_s=0.01)
    finally:
        end.set_result(None)
        thread.join()
        executor.shutdown()
        follower.stop()
        node.destroy_node()
        source.destroy_node()
    gaps = [b - a for a, b in pairwise(fired)]
    # On a busy machine a tick may be late, and the next gap is shorter then; on any other clock there would be no ticks.
    assert fired[-1] - fired[0] >= 3_500_000_000 and sorted(gaps)[len(gaps) // 2] <= 1_200_000_000
