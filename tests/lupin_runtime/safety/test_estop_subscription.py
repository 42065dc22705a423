"""The e-stop subscription of nodes that move something, and a press that the e-stop's process missed, on a real graph."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from lupin_runtime import graph

if TYPE_CHECKING:
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


class FakeEstop:
    """Publishes the button's state and, instead of the e-stop's process, the e-stop's state."""

    def __init__(self, host: GraphHost) -> None:
        from lupin_runtime.ros import LupinNode

        self.node = LupinNode("estop")
        self._state, self._button = self.node.publisher(graph.ESTOP_STATE), self.node.publisher(graph.ESTOP_BUTTON)
        self.publishes_states = False
        self.node.create_timer(0.1, self._repeat)
        host.add(self.node)

    def _repeat(self) -> None:
        from std_msgs.msg import Bool

        if self.publishes_states:
            self._state.publish(Bool(data=False))

    def press(self, value: bool) -> None:
        from mirte_msgs.msg import IntensityDigital

        self._button.publish(IntensityDigital(value=value))

    def is_subscribed(self) -> bool:
        return bool(self._button.get_subscription_count())


def test_missed_press_engages_before_the_estop_publishes_it(graph_host: GraphHost) -> None:
    from lupin_runtime.ros import LupinNode
    from lupin_runtime.safety.estop_subscription import subscribe_estop
    from lupin_runtime.safety.node import EstopWitness

    received: list[bool] = []
    mover = LupinNode("mover")
    subscribe_estop(mover, received.append)
    graph_host.add(mover)
    graph_host.add(EstopWitness())
    estop = FakeEstop(graph_host)
    graph_host.until(estop.is_subscribed, what="the witness")
    estop.press(True)
    estop.press(False)
    graph_host.until(lambda: received and received[-1], what="the stop, without any e-stop process")
    estop.publishes_states = True
    count = len(received)
    graph_host.until(lambda: len(received) > count + 10, what="states of a process that missed the press")
    assert all(received[count:]), "the stop lasts until the e-stop has made up for the missed press"


def test_new_witness_replaces_the_statement_of_the_former_one(graph_host: GraphHost) -> None:
    from std_msgs.msg import Bool

    from lupin_runtime.ros import LupinNode
    from lupin_runtime.safety.estop_subscription import subscribe_estop
    from lupin_runtime.safety.node import EstopWitness

    received: list[bool] = []
    mover, former = LupinNode("mover"), LupinNode("former")
    subscribe_estop(mover, received.append)
    former.publisher(graph.ESTOP_MISSED_PRESS).publish(Bool(data=True))
    graph_host.add(mover)
    graph_host.add(former)
    graph_host.until(lambda: received == [True], what="the missed press")
    estop = FakeEstop(graph_host)
    estop.publishes_states = True
    graph_host.until(lambda: len(received) > 10, what="states")
    assert all(received)
    graph_host.add(EstopWitness())
    graph_host.until_expired(lambda: not received[-1], what="the release, on the same evidence as any other")
