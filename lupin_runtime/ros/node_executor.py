"""An executor for one node that keeps its wait set, at a third of the processor time of rclpy's.

For every event, rclpy collects the node's entities anew, builds a wait set, a task and three coroutines, and then wakes itself
once more: 0.6 ms on an x86 core. The robot's own processes handle 150 events per second while nothing moves.
"""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.waitable import NumberOfEntities

# A publisher or subscription has up to two waitables whose only event is a QoS that does not match, which rclpy logs. Waiting
# for them would take half of the time, so they are looked at now and then.
_QOS_EVENTS_PERIOD_S = 10.0


class NodeExecutor(SingleThreadedExecutor):
    """Calls the plain callbacks of timers, subscriptions and guard conditions itself, in the order of rclpy's executor.

    All else is rclpy's: services, clients, actions, coroutines, and every event while a coroutine waits for something.
    """

    def __init__(self) -> None:
        self._has_changed = True  # entities were created or destroyed
        self._entities: _Entities | None = None
        self.all_due_s = 0.0  # when rclpy looks at all that is not called here
        self._leaves_own = False  # while rclpy looks only at what is not called here
        super().__init__()

    def wake(self) -> None:
        """Collect the entities again; nodes call it when they create or destroy one."""
        self._has_changed = True
        super().wake()

    def add_node(self, node: Node) -> bool:
        """Add a node."""
        self._has_changed = True
        return bool(super().add_node(node))

    def can_execute(self, entity: Any) -> bool:
        """Return whether rclpy may handle an entity.

        It handles one at a time, timers and subscriptions first: one that is always ready would keep it from the services.
        """
        is_own = self._leaves_own and self._entities is not None and entity in self._entities.own
        return not is_own and bool(super().can_execute(entity))

    def _leave_to_rclpy(self) -> None:
        self._leaves_own = True
        try:
            super().spin_once(0.0)
        finally:
            self._leaves_own = False

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait for events and handle them; at most one of those that are rclpy's."""
        guard = self._guard
        if self._is_shutdown or guard is None:
            return
        if any(not task.done() for task, *_ in list(self._tasks)):
            super().spin_once(timeout_sec)
            return
        # rclpy's look at the entities holds them as long as it is kept; what it has not handled is found again.
        self._cb_iter = None
        if time.monotonic() >= self.all_due_s:
            self.all_due_s = time.monotonic() + _QOS_EVENTS_PERIOD_S
            self._leave_to_rclpy()
            return
        if self._has_changed or self._entities is None:
            self._has_changed = False  # first: what changes from here on is collected the next time
            self._entities = _Entities(self, guard)
        try:
            callbacks, has_other = self._entities.wait(-1 if timeout_sec is None else max(0, int(timeout_sec * 1e9)))
        except InvalidHandle:  # an entity was destroyed meanwhile
            self._has_changed = True
            return
        if self._is_shutdown:
            return
        if not self._context.ok():
            raise ExternalShutdownException
        for callback in callbacks:
            callback()
        if has_other:
            self._leave_to_rclpy()


class _Entities:
    """What an executor waits for, and how each is handled."""

    def __init__(self, executor: NodeExecutor, own_guard: Any) -> None:
        """`own_guard` wakes the executor when something changes."""
        nodes = executor.get_nodes()
        timers = [each for node in nodes for each in node.timers if _is_free(each)]
        subscriptions = [each for node in nodes for each in node.subscriptions if _is_free(each)]
        guards = [each for node in nodes for each in node.guards if _is_free(each)]
        clients = [each for node in nodes for each in node.clients if _is_free(each)]
        services = [each for node in nodes for each in node.services if _is_free(each)]
        counts = NumberOfEntities(len(subscriptions), len(guards) + 1, len(timers), len(clients), len(services))
        self._waitables = []
        for waitable in (each for node in nodes for each in node.waitables if _is_free(each)):
            added = waitable.get_num_entities()
            if sum(getattr(added, kind) for kind in added.__slots__) > added.num_events:
                self._waitables.append(waitable)
                counts += added
        context = executor.context.handle
        with context:
            self._wait_set = wait_set = rclpy_implementation.WaitSet(
                counts.num_subscriptions,
                counts.num_guard_conditions,
                counts.num_timers,
                counts.num_clients,
                counts.num_services,
                counts.num_events,
                context,
            )
        self._added = [
            (add, entity.handle)
            for add, entities in (
                (wait_set.add_subscription, subscriptions),
                (wait_set.add_guard_condition, (*guards, own_guard)),
                (wait_set.add_timer, timers),
                (wait_set.add_client, clients),
                (wait_set.add_service, services),
            )
            for entity in entities
        ]
        # By kind, in rclpy's order, and by the pointers of the entities: how each is handled; None by rclpy.
        self._calls: tuple[tuple[str, dict[int, Callable[[], object] | None]], ...] = (
            ("timer", {each.handle.pointer: _timer_call(each) for each in timers}),
            ("subscription", {each.handle.pointer: _subscription_call(each) for each in subscriptions}),
            ("guard_condition", {each.handle.pointer: _guard_call(executor, each) for each in guards}),
            ("client", {each.handle.pointer: None for each in clients}),
            ("service", {each.handle.pointer: None for each in services}),
        )
        self._guards = guards
        called = {pointer for _, calls in self._calls for pointer, call in calls.items() if call is not None}
        self.own = {
            each
            for each in (*timers, *subscriptions, *guards)
            if each.handle.pointer in called and not inspect.iscoroutinefunction(each.callback)
        }
        self._held = (*(handle for _, handle in self._added), *self._waitables, context)

    def wait(self, timeout_ns: int) -> tuple[list[Callable[[], object]], bool]:
        """Wait; return how to handle what is ready, and whether something is left to rclpy. Raises InvalidHandle.

        Nothing is destroyed meanwhile. Afterwards, a callback may destroy what another one would handle.
        """
        entered = 0
        try:
            for each in self._held:
                each.__enter__()
                entered += 1
            return self._wait(timeout_ns)
        finally:
            for each in self._held[:entered]:
                each.__exit__(None, None, None)

    def _wait(self, timeout_ns: int) -> tuple[list[Callable[[], object]], bool]:
        wait_set = self._wait_set
        wait_set.clear_entities()
        for add, handle in self._added:
            add(handle)
        for waitable in self._waitables:
            waitable.add_to_wait_set(wait_set)
        for guard in self._guards:
            if guard._executor_triggered:  # rclpy saw it and has not handled it, or a Wake set it
                guard.trigger()
        wait_set.wait(timeout_ns)
        callbacks: list[Callable[[], object]] = []
        has_other = any(waitable.is_ready(wait_set) for waitable in self._waitables)
        for kind, calls in self._calls:
            for pointer in wait_set.get_ready_entities(kind) if calls else ():
                call = calls.get(pointer, _own_guard_call)
                if call is None:
                    has_other = True
                else:
                    callbacks.append(call)
        return callbacks, has_other


def _own_guard_call() -> None:
    """Do nothing: the executor has been woken."""


def _timer_call(timer: Any) -> Callable[[], object] | None:
    def call() -> None:
        try:
            with timer.handle:
                if not timer.handle.is_timer_ready():
                    return  # cancelled meanwhile
                timer.handle.call_timer()
        except InvalidHandle:
            return  # destroyed meanwhile
        timer.callback()

    return None if inspect.iscoroutinefunction(timer.callback) else call


def _subscription_call(subscription: Any) -> Callable[[], object] | None:
    def call() -> None:
        try:
            with subscription.handle:
                taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        except InvalidHandle:
            return  # destroyed meanwhile
        if taken is not None:
            subscription.callback(taken[0])

    # Without this attribute, rclpy passes messages only.
    kind = getattr(subscription, "_callback_type", None)
    is_plain = kind is None or kind.name == "MessageOnly"
    return call if is_plain and not inspect.iscoroutinefunction(subscription.callback) else None


def _guard_call(executor: NodeExecutor, guard: Any) -> Callable[[], object]:
    def leave_to_rclpy() -> None:
        guard._executor_triggered = True  # waiting has reset it
        executor.all_due_s = 0.0

    def call() -> None:
        guard._executor_triggered = False
        guard.callback()

    return leave_to_rclpy if inspect.iscoroutinefunction(guard.callback) else call


def _is_free(entity: Any) -> bool:
    """Whether an executor may wait for it: PolledGroup's entities are their owner's."""
    return bool(entity.callback_group.can_execute(entity))
