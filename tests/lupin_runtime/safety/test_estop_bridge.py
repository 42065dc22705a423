"""The bridge on a real graph, with the simulated vendor button and consoles."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime import graph
from lupin_runtime.safety.console_server_stop import BROWSER_HOLDS_STOP
from lupin_runtime.safety.estop import MISSED_PRESS_OR_SILENCE
from lupin_runtime.safety.expected_sources import BUTTON, CONSOLE, UNHEARD, WITNESS

if TYPE_CHECKING:
    from lupin_runtime.safety.node import EstopBridge
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


class Probe:
    def __init__(self, host: GraphHost) -> None:
        from mirte_msgs.msg import IntensityDigital
        from std_msgs.msg import Bool

        from lupin_runtime.ros import LupinNode

        self._button_type, self._bool = IntensityDigital, Bool
        self.node = LupinNode("probe")
        self.states: list[tuple[float, bool]] = []
        self.status: list[dict[str, Any]] = []
        self.node.subscription(graph.ESTOP_STATE, lambda message: self.states.append((time.monotonic(), message.data)))
        self.node.subscription(graph.ESTOP_STATUS, lambda message: self.status.append(json.loads(message.data)))
        self._button = self.node.publisher(graph.ESTOP_BUTTON)
        self._console = self.node.publisher(graph.HMI_ESTOP)
        self.console_says: bool | None = None
        self.node.create_timer(0.5, self._repeat)
        host.add(self.node)
        host.until(lambda: self._button.get_subscription_count() and self._console.get_subscription_count())
        host.until_expired(lambda: self.states, what="the first state")

    def _repeat(self) -> None:
        if self.console_says is not None:
            self._console.publish(self._bool(data=self.console_says))

    def press(self, value: bool) -> None:
        self._button.publish(self._button_type(value=value))

    def console(self, value: bool) -> None:
        self.console_says = value
        self._repeat()

    @property
    def engaged(self) -> bool:
        return self.states[-1][1]


def bridge(host: GraphHost, **parameters: Any) -> EstopBridge:
    from lupin_runtime.safety.node import EstopBridge

    # Most tests have no source that repeats itself, and listen for none.
    result: EstopBridge = host.add(EstopBridge({"listen_s": 0.0, "expected_sources": "", **parameters}))
    return result


def test_estop_state_is_repeated_and_starts_released(graph_host: GraphHost) -> None:
    bridge(graph_host)
    probe = Probe(graph_host)
    graph_host.until(lambda: len(probe.states) >= 8, what="repeats")
    assert {engaged for _, engaged in probe.states} == {False}


def test_button_engages_and_releases(graph_host: GraphHost) -> None:
    bridge(graph_host)
    probe = Probe(graph_host)
    probe.press(True)
    graph_host.until(lambda: probe.engaged, what="the engaged state")
    graph_host.until(lambda: probe.status[-1]["reasons"] == ["the button is pressed"], what="the reason")
    probe.press(False)
    graph_host.until(lambda: not probe.engaged, what="the released state")


def test_button_polarity_is_a_parameter(graph_host: GraphHost) -> None:
    bridge(graph_host, engaged_value=False)
    probe = Probe(graph_host)
    assert not probe.engaged
    probe.press(False)
    graph_host.until(lambda: probe.engaged, what="the engaged state")


def test_estop_edge_is_published_at_once(graph_host: GraphHost) -> None:
    node = bridge(graph_host)
    probe = Probe(graph_host)
    graph_host.within(node, lambda: [timer.cancel() for timer in node.timers])  # nothing is repeated
    count = len(probe.states)
    for _ in range(5):
        probe.press(True)
        graph_host.until(lambda: probe.engaged, what="the engaged state")
        probe.press(False)
        graph_host.until(lambda: not probe.engaged, what="the released state")
    assert len(probe.states) >= count + 10


def test_console_engages_and_its_loss_engages_again(graph_host: GraphHost) -> None:
    bridge(graph_host)
    probe = Probe(graph_host)
    probe.console(True)
    graph_host.until(lambda: probe.engaged, what="the console's stop")
    probe.console(False)
    graph_host.until_expired(lambda: not probe.engaged, what="the console's release")
    probe.console_says = None
    graph_host.until_expired(lambda: probe.engaged, what="the stop of a vanished console")
    graph_host.until(lambda: "no message from any console" in " ".join(probe.status[-1]["reasons"]), what="the reason")


def test_button_engages_regardless_of_the_console(graph_host: GraphHost) -> None:
    bridge(graph_host)
    probe = Probe(graph_host)
    probe.console(False)
    probe.press(True)
    graph_host.until(lambda: probe.engaged, what="the engaged state")
    count = len(probe.states)
    graph_host.until(lambda: len(probe.states) >= count + 5, what="repeats while the console says released")
    assert {engaged for _, engaged in probe.states[count:]} == {True}


def test_status_says_for_how_long_the_estop_has_been_released(graph_host: GraphHost) -> None:
    bridge(graph_host)
    probe = Probe(graph_host)
    probe.press(True)
    graph_host.until(lambda: probe.status and probe.status[-1]["engaged_s_ago"] == 0.0, what="the engaged state")
    probe.press(False)
    graph_host.until_expired(lambda: probe.status[-1]["engaged_s_ago"] > 0.8, what="the repeated status")
    assert probe.status[-1]["engaged"] is False and probe.status[-1]["presses"] == 1


def test_new_bridge_does_not_publish_released_too_early(graph_host: GraphHost) -> None:
    first = bridge(graph_host)
    probe = Probe(graph_host)
    probe.console(True)
    graph_host.until(lambda: probe.engaged, what="the console's stop")
    graph_host.remove(first)
    probe.states.clear()
    bridge(graph_host, listen_s=1.5)
    graph_host.until_expired(lambda: len(probe.states) >= 5, what="the states of its successor")
    assert {engaged for _, engaged in probe.states} == {True}


def test_stop_reaches_the_sink_through_bridge_and_bus(graph_host: GraphHost) -> None:
    """End to end: a press of the vendor's button sends zero to the base, and its release alone moves nothing."""
    from lupin_runtime.drive import Twist, decode, encode
    from lupin_runtime.drive.node import TwistMux

    bridge(graph_host)
    graph_host.add(TwistMux())
    probe = Probe(graph_host)
    sink: list[Twist] = []
    probe.node.subscription(graph.CMD_VEL_SINK_SIM, lambda data: sink.append(decode(data)), raw=True)  # type: ignore[arg-type]
    auto = probe.node.publisher(graph.CMD_VEL_AUTO)
    moving = Twist(0.2, 0.0, 0.0)

    def drive(until: Callable[..., Any]) -> Callable[..., Any]:
        def step() -> bool:
            auto.publish(encode(moving))
            time.sleep(0.02)
            result: bool = until()
            return result

        return step

    graph_host.until(drive(lambda: sink and sink[-1] == moving), what="motion")
    probe.press(True)
    graph_host.until(drive(lambda: sink[-1] == Twist(0.0, 0.0, 0.0)), what="zero at the sink")
    probe.press(False)
    graph_host.until(lambda: not probe.engaged, what="the e-stop to be released")
    count = len(sink)
    graph_host.until(drive(lambda: len(sink) >= count + 20), what="20 commands at the sink after the release")
    assert set(sink[count:]) == {Twist(0.0, 0.0, 0.0)}, "the goal that was running must not continue by itself"


def test_console_server_engages_and_its_exit_changes_nothing(graph_host: GraphHost) -> None:
    from std_msgs.msg import String

    bridge(graph_host)
    probe = Probe(graph_host)
    server = probe.node.publisher(graph.CONSOLE_STOP)
    graph_host.until(server.get_subscription_count, what="the bridge's subscription")
    statement = '{"server": "a", "engaged": %s, "driving": false, "presses": 0, "releases": 0}'
    server.publish(String(data=statement % "true"))
    graph_host.until(lambda: probe.engaged, what="the engaged state")
    graph_host.until(lambda: probe.status[-1]["reasons"] == [BROWSER_HOLDS_STOP], what="the reason")
    server.publish(String(data=statement % "false"))
    graph_host.until(lambda: not probe.engaged, what="the released state")
    count = len(probe.states)
    probe.node.destroy_publisher(server)
    graph_host.until(lambda: len(probe.states) > count + 10, what="two seconds of states")
    assert not probe.engaged


def test_press_and_release_without_a_bridge_engages_the_next_one(graph_host: GraphHost) -> None:
    from lupin_runtime.safety.node import EstopWitness

    graph_host.add(EstopWitness({"listen_s": 0.0}))  # it has listened
    first = bridge(graph_host)
    probe = Probe(graph_host)
    graph_host.remove(first)
    missed: list[bool] = []
    probe.node.subscription(graph.ESTOP_MISSED_PRESS, lambda message: missed.append(message.data))
    probe.press(True)
    probe.press(False)
    graph_host.until_expired(lambda: missed[-1:] == [True], what="the missed press")
    states = len(probe.states)
    bridge(graph_host, listen_s=1.0)
    graph_host.until(lambda: len(probe.states) > states and probe.engaged, what="the engaged state")
    graph_host.until(lambda: probe.status[-1]["reasons"] == [MISSED_PRESS_OR_SILENCE], what="the reason")
    graph_host.until_expired(lambda: missed[-2:] == [True, False] and not probe.engaged, what="the released state")
    after = [engaged for _, engaged in probe.states[states:]]
    assert after == sorted(after, reverse=True), "engaged, then released"


def test_new_bridge_engages_if_the_button_fell_silent_before(graph_host: GraphHost) -> None:
    from lupin_runtime.safety.node import EstopWitness

    graph_host.add(EstopWitness({"listen_s": 0.0}))  # it has listened
    first = bridge(graph_host)
    probe = Probe(graph_host)
    missed: list[bool] = []
    probe.node.subscription(graph.ESTOP_MISSED_PRESS, lambda message: missed.append(message.data))
    graph_host.until(lambda: probe.node.count_subscribers(graph.ESTOP_BUTTON.name) == 2, what="both subscriptions")
    probe.press(False)  # the last message of the button
    graph_host.until_expired(lambda: probe.engaged, what="the engaged state")
    graph_host.until_expired(lambda: missed[-1:] == [True], what="the witness's report")
    assert probe.status[-1]["reasons"] == ["the button has been silent for more than 2 s"]
    graph_host.remove(first)
    probe.states.clear()
    bridge(graph_host, listen_s=1.0)
    graph_host.until_expired(lambda: len(probe.states) >= 10, what="the states of its successor")
    assert {engaged for _, engaged in probe.states} == {True}
    assert probe.status[-1]["reasons"] == [MISSED_PRESS_OR_SILENCE]
    timer = probe.node.create_timer(0.1, lambda: probe.press(False))
    graph_host.until(lambda: not probe.engaged, what="the release, once the button is back")
    graph_host.within(probe.node, lambda: probe.node.destroy_timer(timer))


def test_stop_of_a_lost_console_survives_its_bridge(graph_host: GraphHost) -> None:
    from std_msgs.msg import String

    from lupin_runtime.safety.node import EstopWitness

    graph_host.add(EstopWitness({"listen_s": 0.0}))  # it has listened
    first = bridge(graph_host)
    probe = Probe(graph_host)
    missed: list[bool] = []
    probe.node.subscription(graph.ESTOP_MISSED_PRESS, lambda message: missed.append(message.data))
    console, other = probe.node.publisher(graph.CONSOLE_STOP), probe.node.publisher(graph.CONSOLE_STOP)
    graph_host.until(lambda: console.get_subscription_count() == other.get_subscription_count() == 2, what="subscriptions")
    statement = '{"server": "%s", "engaged": %s, "driving": false, "presses": 0, "releases": %s}'
    console.publish(String(data=statement % ("a", "true", 0)))
    graph_host.until(lambda: probe.engaged, what="the console's stop")
    probe.node.destroy_publisher(console)
    graph_host.remove(first)
    graph_host.until_expired(lambda: missed[-1:] == [True], what="the witness's report")
    probe.states.clear()
    bridge(graph_host, listen_s=1.0)
    graph_host.until_expired(lambda: len(probe.states) >= 15, what="three seconds of states")
    assert {engaged for _, engaged in probe.states} == {True}
    graph_host.until(lambda: other.get_subscription_count() == 2, what="the new bridge's subscription")
    for releases in (4, 5):
        other.publish(String(data=statement % ("b", "false", releases)))
    graph_host.until(lambda: not probe.engaged, what="the release on another console")
    assert not missed[-1]


def test_witness_shortens_the_wait_of_a_new_bridge(graph_host: GraphHost) -> None:
    from std_msgs.msg import Bool

    from lupin_runtime.ros import LupinNode

    witness = LupinNode("witness")
    witness.publisher(graph.ESTOP_MISSED_PRESS).publish(Bool(data=False))
    graph_host.add(witness)
    bridge(graph_host, listen_s=600.0)
    assert not Probe(graph_host).engaged


def test_new_witness_reports_a_press_before_it_has_listened(graph_host: GraphHost) -> None:
    from lupin_runtime.safety.node import EstopWitness

    witness = graph_host.add(EstopWitness({"listen_s": 600.0}))
    bridge(graph_host)
    probe = Probe(graph_host)
    missed: list[bool] = []
    probe.node.subscription(graph.ESTOP_MISSED_PRESS, lambda message: missed.append(message.data))
    graph_host.until(lambda: probe.node.count_subscribers(graph.ESTOP_BUTTON.name) == 2, what="both subscriptions")
    probe.press(False)
    graph_host.until_expired(lambda: missed, what="the witness's report of the silent button")
    assert missed == [True]
    # It has not heard every source yet: that this one is heard again says nothing of the others.
    probe.press(False)
    graph_host.until(lambda: not witness._was_silent, what="the end of the silence")
    assert graph_host.within(witness, lambda: witness._published)
    graph_host.within(witness, lambda: setattr(witness, "_false_from_ns", 0))
    graph_host.until(lambda: missed[-1] is False, what="the witness's release")


STATEMENT = '{"server": "a", "engaged": %s, "driving": false, "presses": 0, "releases": 0}'
DISCOVERY_S = 3.0  # longer than the bridge listens


def add_source(probe: Probe, source: str, holds: bool) -> None:
    """Publish as a source of the e-stop from now on, which the bridge has yet to discover."""
    from mirte_msgs.msg import IntensityDigital
    from std_msgs.msg import Bool, String

    row, message = {
        BUTTON: (graph.ESTOP_BUTTON, IntensityDigital(value=holds)),
        CONSOLE: (graph.CONSOLE_STOP, String(data=STATEMENT % str(holds).lower())),
        WITNESS: (graph.ESTOP_MISSED_PRESS, Bool(data=holds)),
    }[source]
    publisher = probe.node.publisher(row)
    probe.node.create_timer(0.1, lambda: publisher.publish(message))


@pytest.mark.parametrize("source", [BUTTON, CONSOLE, WITNESS])
def test_held_source_discovered_late_is_never_released(graph_host: GraphHost, source: str) -> None:
    bridge(graph_host, listen_s=1.0, expected_sources=source)
    probe = Probe(graph_host)
    heard_s = time.monotonic() + DISCOVERY_S
    graph_host.until_expired(lambda: time.monotonic() > heard_s, what="the end of the discovery")
    assert [status["unheard"] for status in probe.status] == [[source]]
    assert probe.status[-1]["reasons"] == [UNHEARD[source]] and probe.status[-1]["presses"] == 0
    graph_host.within(probe.node, lambda: add_source(probe, source, holds=True))
    graph_host.until(lambda: probe.status[-1]["unheard"] == [], what="the source")
    count = len(probe.states)
    graph_host.until(lambda: len(probe.states) >= count + 5, what="repeats")
    assert probe.status[-1]["engaged"] and probe.status[-1]["presses"] == 1
    assert {engaged for _, engaged in probe.states} == {True}, "released was never published"


def test_source_discovered_late_releases_without_a_press(graph_host: GraphHost) -> None:
    bridge(graph_host, listen_s=1.0, expected_sources="button console")
    probe = Probe(graph_host)
    assert probe.engaged
    graph_host.within(probe.node, lambda: add_source(probe, BUTTON, holds=False))
    graph_host.until(lambda: probe.status and probe.status[-1]["unheard"] == [CONSOLE], what="the button")
    count = len(probe.states)
    graph_host.until(lambda: len(probe.states) >= count + 5, what="repeats")
    assert {engaged for _, engaged in probe.states} == {True}
    graph_host.within(probe.node, lambda: add_source(probe, CONSOLE, holds=False))
    graph_host.until_expired(lambda: not probe.engaged, what="the release")
    graph_host.until(lambda: not probe.status[-1]["engaged"], what="the status")
    assert probe.status[-1]["presses"] == 0 and probe.status[-1]["engaged_s_ago"] is None


def test_restarted_bridge_that_hears_its_sources_does_not_engage(graph_host: GraphHost) -> None:
    from lupin_runtime.safety.node import LISTEN_S, SHORT_LISTEN_S

    first = bridge(graph_host)
    probe = Probe(graph_host)
    for source in (BUTTON, WITNESS):
        graph_host.within(probe.node, partial(add_source, probe, source, holds=False))
    graph_host.remove(first)
    graph_host.until(lambda: not probe.node.count_publishers(graph.ESTOP_STATE.name), what="the end of the first bridge")
    probe.states.clear()
    started_s = time.monotonic()
    bridge(graph_host, listen_s=LISTEN_S, expected_sources="button witness")
    graph_host.until_expired(lambda: len(probe.states) >= 5, what="the states of its successor")
    assert {engaged for _, engaged in probe.states} == {False}
    assert probe.states[0][0] - started_s >= SHORT_LISTEN_S


def test_bridge_expects_the_button_by_default(graph_host: GraphHost) -> None:
    from lupin_runtime.safety.node import EstopBridge

    graph_host.add(EstopBridge({"listen_s": 0.0}))
    probe = Probe(graph_host)
    assert probe.engaged
    graph_host.until(lambda: probe.status and probe.status[-1]["reasons"] == [UNHEARD[BUTTON]], what="the reason")


def test_press_counts_that_a_bridge_without_the_button_missed(graph_host: GraphHost) -> None:
    """The bridge is engaged already, but no mission may start and no arm may move as if nobody had pressed."""
    from lupin_runtime.safety.node import EstopWitness

    # The bridge listens on another topic, as if it had not discovered the button.
    bridge(graph_host, expected_sources="button", button_topic="/undiscovered")
    graph_host.add(EstopWitness({"listen_s": 0.0, "button_silence_engages": False}))
    probe = Probe(graph_host)
    graph_host.until(lambda: probe.status, what="the status")
    assert probe.status[-1]["reasons"] == [UNHEARD[BUTTON]] and probe.status[-1]["presses"] == 0
    probe.press(True)
    probe.press(False)
    graph_host.until_expired(lambda: probe.status[-1]["presses"] == 1, what="the count of the press")
    graph_host.until_expired(lambda: probe.status[-1]["reasons"] == [UNHEARD[BUTTON]], what="the end of the missed press")
    assert {engaged for _, engaged in probe.states} == {True}
