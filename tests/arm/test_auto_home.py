from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime import graph
from lupin_runtime.arm.controllers import complaints, next_step

STATES = ("unconfigured", "inactive", "active", "finalized")
LISTED = st.dictionaries(st.sampled_from(graph.CONTROLLERS), st.sampled_from(STATES))


def obey(states: dict[str, str], targets) -> dict[str, str]:
    """What the manager lists after a step was taken."""
    step = next_step(states, targets)
    after = dict(states)
    after.update(dict.fromkeys(step.load, "unconfigured"))
    after.update(dict.fromkeys(step.configure, "inactive"))
    after.update(dict.fromkeys(step.activate, "active"))
    return after


@given(LISTED)
def test_three_steps_bring_every_controller_up_unless_it_is_finalized(states):
    for _ in range(3):
        states = obey(states, graph.CONTROLLERS)
    wrong = complaints(states, graph.CONTROLLERS)
    assert all("finalized" in text for text in wrong)
    assert len(wrong) == sum(state == "finalized" for state in states.values())


@given(LISTED)
def test_a_missing_controller_is_a_complaint(states):
    missing = [name for name in graph.CONTROLLERS if name not in states]
    assert {f"{name} is not loaded" for name in missing} <= set(complaints(states, graph.CONTROLLERS))


def test_what_is_active_is_left_alone():
    assert not next_step(dict.fromkeys(graph.CONTROLLERS, "active"), graph.CONTROLLERS)


class Manager:
    """A controller manager with the states that a test gives it, and a preset server."""

    def __init__(self, host, states: dict[str, str], stubborn: str = "") -> None:
        from sensor_msgs.msg import JointState

        from lupin_runtime.ros import LupinNode

        self.states, self.stubborn, self.presets, self.refusals = states, stubborn, [], 0
        self.node = LupinNode("controller_manager")
        self.node.service(graph.LIST_CONTROLLERS, self._list)
        self.node.service(graph.LOAD_CONTROLLER, self._change("unconfigured"))
        self.node.service(graph.CONFIGURE_CONTROLLER, self._change("inactive"))
        self.node.service(graph.SWITCH_CONTROLLER, self._switch)
        self.node.service(graph.ARM_PRESET, self._preset)
        publisher = self.node.publisher(graph.JOINT_STATES)
        state = JointState(name=list(graph.ARM_JOINTS), position=[0.0] * 4)
        self.node.create_timer(0.05, lambda: publisher.publish(state))
        host.add(self.node)

    def _list(self, _, response):
        from controller_manager_msgs.msg import ControllerState

        response.controller = [ControllerState(name=name, state=state) for name, state in self.states.items()]
        return response

    def _change(self, state: str):
        def serve(request, response):
            self.states[request.name] = state
            response.ok = True
            return response

        return serve

    def _switch(self, request, response):
        assert request.strictness == request.BEST_EFFORT and request.activate_asap
        for name in request.activate_controllers:
            if name != self.stubborn:
                self.states[name] = "active"
        response.ok = True
        return response

    def _preset(self, request, response):
        self.presets.append(request.name)
        response.success = len(self.presets) > self.refusals
        response.message = "sent" if response.success else "no arm controller listens"
        return response


@pytest.fixture
def home(graph_host):
    from lupin_runtime.arm.auto_home import AutoHome, Limits
    from lupin_runtime.ros import LupinNode

    limits = Limits(5.0, 0.5, 0.1, 5.0, 5.0, 5.0, 0.1, 5.0)
    node = LupinNode("auto_home")
    home = AutoHome(node, limits, say=lambda _: None)
    yield home
    home.close()
    node.destroy_node()


@pytest.mark.graph
def test_the_arm_is_sent_home_after_all_five_controllers_were_healed(graph_host, home):
    states = {"joint_state_broadcaster": "active", "pid_wheels_controller": "inactive", "mirte_base_controller": "unconfigured"}
    manager = Manager(graph_host, states)
    home.run()
    assert manager.states == dict.fromkeys(graph.CONTROLLERS, "active")
    assert manager.presets == ["home"]


@pytest.mark.graph
def test_one_controller_that_stays_inactive_is_a_failure_and_the_arm_is_not_moved(graph_host, home):
    from lupin_runtime.arm.auto_home import NotHome

    manager = Manager(graph_host, dict.fromkeys(graph.CONTROLLERS, "inactive"), stubborn="mirte_base_controller")
    with pytest.raises(NotHome, match="mirte_base_controller is inactive"):
        home.run()
    assert manager.presets == []


@pytest.mark.graph
def test_a_preset_server_that_is_not_quite_ready_is_asked_again(graph_host, home):
    manager = Manager(graph_host, dict.fromkeys(graph.CONTROLLERS, "active"))
    manager.refusals = 1
    home.run()
    assert manager.presets == ["home", "home"]


@pytest.mark.graph
def test_without_a_controller_manager_it_fails_in_bounded_time(graph_host):
    from lupin_runtime.arm.auto_home import AutoHome, Limits, NotHome
    from lupin_runtime.ros import LupinNode

    node = LupinNode("auto_home")
    home = AutoHome(node, Limits(manager_s=0.3), say=lambda _: None)
    with pytest.raises(NotHome, match=r"waited 0\.3 s for the service /controller_manager/list_controllers"):
        home.run()
    home.close()
    node.destroy_node()


@pytest.mark.graph
def test_a_line_per_step_says_what_was_found_and_what_was_done(graph_host):
    from lupin_runtime.arm.auto_home import AutoHome, Limits
    from lupin_runtime.ros import LupinNode

    Manager(graph_host, {**dict.fromkeys(graph.CONTROLLERS, "active"), "pid_wheels_controller": "unconfigured"})
    said: list[str] = []
    node = LupinNode("auto_home")
    home = AutoHome(node, Limits(5.0, 0.5, 0.1, 5.0, 5.0, 5.0, 0.1, 5.0), said.append)
    home.run()
    home.close()
    node.destroy_node()
    told = [line for line in said if not line.startswith("waiting for ")]
    assert told == [
        "found: pid_wheels_controller is unconfigured",
        "configure pid_wheels_controller",
        "now: pid_wheels_controller is inactive",
        "activate pid_wheels_controller",
        "now: all 5 controllers are active",
        "preset home",
        "arm: sent",
    ]


@pytest.mark.graph
def test_a_manager_that_is_there_and_never_answers_is_left_alone(graph_host, monkeypatch):
    from lupin_runtime.arm.auto_home import AutoHome, Limits, NotHome
    from lupin_runtime.ros import LupinNode

    node = LupinNode("auto_home")
    said: list[str] = []
    home = AutoHome(node, Limits(visible_s=0.3, poll_s=0.1, call_s=0.1, again_s=0.1), said.append)
    monkeypatch.setattr(home, "_wait", lambda *_: None)  # as if its service had been seen, just before it hung
    with pytest.raises(NotHome, match="is there and never answered"):
        home.heal()
    assert not any(line.startswith(("load", "configure", "activate")) for line in said)
    home.close()
    node.destroy_node()


LATE_S = 1.0


class Slow(Manager):
    """A manager whose first answer comes late."""

    asked = 0

    def _list(self, request, response):
        self.asked += 1
        if self.asked == 1:
            time.sleep(LATE_S)  # the lateness is what is tested: nothing else would tell when it is late enough
        return super()._list(request, response)


@pytest.mark.graph
def test_what_a_late_answer_would_have_said_is_not_guessed(graph_host):
    from lupin_runtime.arm.auto_home import AutoHome, Limits
    from lupin_runtime.ros import LupinNode

    manager = Slow(graph_host, dict.fromkeys(graph.CONTROLLERS, "inactive"))
    node = LupinNode("auto_home")
    said: list[str] = []
    home = AutoHome(node, Limits(again_s=0.2 * LATE_S, poll_s=0.1), said.append)
    home.heal()
    assert manager.asked > 1 and set(manager.states.values()) == {"active"}
    found = [line for line in said if line.startswith("found: ")]
    assert len(found) == 1 and found[0].count("is inactive") == len(graph.CONTROLLERS)
    home.close()
    node.destroy_node()


@pytest.mark.graph
def test_a_listing_whose_answer_is_lost_is_asked_for_again(graph_host, monkeypatch):
    from rclpy.task import Future

    from lupin_runtime.arm.auto_home import AutoHome, Limits
    from lupin_runtime.ros import LupinNode

    Manager(graph_host, dict.fromkeys(graph.CONTROLLERS, "active"))
    node = LupinNode("auto_home")
    said: list[str] = []
    home = AutoHome(node, Limits(call_s=10.0, visible_s=0.0, again_s=0.2), said.append)
    ask, lost = home._list.call_async, [Future()]
    monkeypatch.setattr(home._list, "call_async", lambda request: lost.pop() if lost else ask(request))
    home.heal()
    assert not lost and said[-1] == "found: all 5 controllers are active"
    home.close()
    node.destroy_node()


@pytest.mark.graph
def test_all_waits_together_are_bounded_too(graph_host):
    from lupin_runtime.arm.auto_home import AutoHome, Limits, NotHome
    from lupin_runtime.ros import LupinNode

    node = LupinNode("auto_home")
    home = AutoHome(node, Limits(longest_s=0.5), say=lambda _: None)
    with pytest.raises(NotHome, match=r"waited 0\.[45] s for the service"):
        home.run()
    with pytest.raises(NotHome, match=r"gave up after 0\.5 s"):
        home.run()
    home.close()
    node.destroy_node()


@pytest.mark.graph
@pytest.mark.parametrize("word", ["false", "0", "No", " OFF "])
def test_the_environment_may_say_no(word):
    run = subprocess.run(
        [sys.executable, "-m", "lupin_runtime.arm.auto_home"],
        env={**os.environ, "LUPIN_AUTO_HOME": word},
        capture_output=True,
        text=True,
        timeout=30,
    )
    assert run.returncode == 0 and "stays where it is" in run.stdout


@pytest.mark.graph
def test_lupin_home_does_the_same_on_the_graph_of_a_live_run_and_says_so_as_it_goes(graph_host, tmp_path, monkeypatch):
    from lupin_runtime.stack.dds import GRAPH_VARIABLES
    from lupin_runtime.stack.runs import create_run

    command = [sys.executable, "-m", "lupin_cli.app", "home"]
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    nothing = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert nothing.returncode == 3 and "no run is up" in nothing.stderr
    run, lock = create_run()
    run.write_info({"environment": {name: os.environ[name] for name in GRAPH_VARIABLES if name in os.environ}})
    manager = Manager(graph_host, {**dict.fromkeys(graph.CONTROLLERS, "active"), "pid_wheels_controller": "inactive"})
    home = subprocess.run(command, capture_output=True, text=True, timeout=60)
    os.close(lock)
    assert home.returncode == 0, home.stderr
    said = [line.partition(" s  ")[2] for line in home.stdout.splitlines()]
    assert "found: pid_wheels_controller is inactive" in said and said[-1] == "arm: sent"
    assert manager.states["pid_wheels_controller"] == "active" and manager.presets == ["home"]
