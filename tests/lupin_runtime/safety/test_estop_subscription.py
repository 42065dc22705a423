"""How nodes that move something hear the e-stop, and a press that its process missed, on a real graph."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from lupin_runtime import graph

if TYPE_CHECKING:
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


class Talker:
    """Publishes the button, and what the e-stop's process publishes."""

    def __init__(self, host: GraphHost) -> None:
        from lupin_runtime.ros import LupinNode

        self.node = LupinNode("talker")
        self._state, self._button = self.node.publisher(graph.ESTOP_STATE), self.node.publisher(graph.ESTOP_BUTTON)
        self.states = False
        self.node.create_timer(0.1, self._repeat)
        host.add(self.node)

    def _repeat(self) -> None:
        from std_msgs.msg import Bool

        if self.states:
            self._state.publish(Bool(data=False))

    def press(self, value: bool) -> None:
        from mirte_msgs.msg import IntensityDigital

        self._button.publish(IntensityDigital(value=value))

    def heard(self) -> bool:
        return bool(self._button.get_subscription_count())


def test_missed_press_is_heard_before_another_process_states_it(graph_host: GraphHost) -> None:
    from lupin_runtime.ros import LupinNode
    from lupin_runtime.safety.estop_subscription import subscribe_estop
    from lupin_runtime.safety.node import EstopWitness

    heard: list[bool] = []
    mover = LupinNode("mover")
    subscribe_estop(mover, heard.append)
    graph_host.add(mover)
    graph_host.add(EstopWitness())
    talker = Talker(graph_host)
    graph_host.until(talker.heard, what="the witness")
    talker.press(True)
    talker.press(False)
    graph_host.until(lambda: heard and heard[-1], what="the stop, without any e-stop process")
    talker.states = True
    count = len(heard)
    graph_host.until(lambda: len(heard) > count + 10, what="states of a process that knows of no press")
    assert all(heard[count:]), "the stop stands until the press is made good"


def test_witness_that_is_replaced_ends_what_the_former_stated(graph_host: GraphHost) -> None:
    from std_msgs.msg import Bool

    from lupin_runtime.ros import LupinNode
    from lupin_runtime.safety.estop_subscription import subscribe_estop
    from lupin_runtime.safety.node import EstopWitness

    heard: list[bool] = []
    mover, former = LupinNode("mover"), LupinNode("former")
    subscribe_estop(mover, heard.append)
    former.publisher(graph.ESTOP_MISSED_PRESS).publish(Bool(data=True))
    graph_host.add(mover)
    graph_host.add(former)
    graph_host.until(lambda: heard == [True], what="the missed press")
    talker = Talker(graph_host)
    talker.states = True
    graph_host.until(lambda: len(heard) > 10, what="states")
    assert all(heard)
    graph_host.add(EstopWitness())
    graph_host.until(lambda: not heard[-1], what="the release by the evidence of any other")
