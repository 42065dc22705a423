"""Auto-home sends the arm home once its controllers are active, within a time limit, whatever the manager does."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime import graph
from lupin_runtime.arm.controllers import inactive_controllers, next_step

if TYPE_CHECKING:
    from controller_manager_msgs.srv import (
        ConfigureController_Response,
        ListControllers_Request,
        ListControllers_Response,
        LoadController_Response,
        SwitchController_Response,
    )
    from lupin_msgs.srv import SetArmPreset_Response

    from lupin_runtime.arm.auto_home import AutoHome
    from tests.conftest import GraphHost

# The waits that always take their whole time, in s.
SHORT = {"visible_s": 0.5, "poll_s": 0.1, "settle_s": 0.02}
STATES = ("unconfigured", "inactive", "active", "finalized")
LISTED = st.dictionaries(st.sampled_from(graph.CONTROLLERS), st.sampled_from(STATES))


def apply_step(states: dict[str, str], targets: tuple[str, ...]) -> dict[str, str]:
    """Return the states that the manager lists after a step."""
    step = next_step(states, targets)
    after = dict(states)
    after.update(dict.fromkeys(step.load, "unconfigured"))
    after.update(dict.fromkeys(step.configure, "inactive"))
    after.update(dict.fromkeys(step.activate, "active"))
    return after


@given(LISTED)
def test_three_steps_activate_every_controller_not_finalized(states: dict[str, Any]) -> None:
    for _ in range(3):
        states = apply_step(states, graph.CONTROLLERS)
    wrong = inactive_controllers(states, graph.CONTROLLERS)
    assert all("finalized" in text for text in wrong)
    assert len(wrong) == sum(state == "finalized" for state in states.values())


@given(LISTED)
def test_missing_controller_is_reported(states: dict[str, Any]) -> None:
    missing = [name for name in graph.CONTROLLERS if name not in states]
    assert {f"{name} is not loaded" for name in missing} <= set(inactive_controllers(states, graph.CONTROLLERS))


def test_active_controllers_need_no_step() -> None:
    assert not next_step(dict.fromkeys(graph.CONTROLLERS, "active"), graph.CONTROLLERS)


class Manager:
    """A controller manager with the states that a test gives it, and a preset server."""

    def __init__(self, host: GraphHost, states: dict[str, str], stubborn: str = "") -> None:
        from sensor_msgs.msg import JointState

        from lupin_runtime.ros import LupinNode

        self.states, self.stubborn, self.refusals = states, stubborn, 0
        self.presets: list[Any] = []
        self.refusal = "no arm controller listens"
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

    def _list(self, _: ListControllers_Request, response: ListControllers_Response) -> ListControllers_Response:
        from controller_manager_msgs.msg import ControllerState

        response.controller = [ControllerState(name=name, state=state) for name, state in self.states.items()]
        return response

    def _change(self, state: str) -> Callable[..., Any]:
        def serve(
            request: Any, response: ConfigureController_Response | LoadController_Response
        ) -> ConfigureController_Response | LoadController_Response:
            self.states[request.name] = state
            response.ok = True
            return response

        return serve

    def _switch(self, request: Any, response: SwitchController_Response) -> SwitchController_Response:
        assert request.strictness == request.BEST_EFFORT and request.activate_asap
        for name in request.activate_controllers:
            if name != self.stubborn:
                self.states[name] = "active"
        response.ok = True
        return response

    def _preset(self, request: Any, response: SetArmPreset_Response) -> SetArmPreset_Response:
        self.presets.append(request.name)
        response.success = len(self.presets) > self.refusals
        response.message = "sent" if response.success else self.refusal
        return response


@pytest.fixture
def home(graph_host: GraphHost) -> Iterator[AutoHome]:  # noqa: ARG001 -- the fixture must have run
    from lupin_runtime.arm.auto_home import AutoHome, Limits
    from lupin_runtime.ros import LupinNode

    node = LupinNode("auto_home")
    home = AutoHome(node, Limits(**SHORT), say=lambda _: None)
    yield home
    home.close()
    node.destroy_node()


@pytest.mark.graph
def test_arm_is_sent_home_after_controllers_are_active(graph_host: GraphHost, home: AutoHome) -> None:
    states = {"joint_state_broadcaster": "active", "pid_wheels_controller": "inactive", "mirte_base_controller": "unconfigured"}
    manager = Manager(graph_host, states)
    home.run()
    assert manager.states == dict.fromkeys(graph.CONTROLLERS, "active")
    assert manager.presets == ["home"]


@pytest.mark.graph
def test_inactive_controller_is_a_failure_without_arm_motion(graph_host: GraphHost, home: AutoHome) -> None:
    from lupin_runtime.arm.auto_home import NotHome

    manager = Manager(graph_host, dict.fromkeys(graph.CONTROLLERS, "inactive"), stubborn="mirte_base_controller")
    with pytest.raises(NotHome, match="mirte_base_controller is inactive"):
        home.run()
    assert manager.presets == []


@pytest.mark.graph
def test_preset_call_is_repeated_until_it_succeeds(
    graph_host: GraphHost, home: AutoHome, monkeypatch: pytest.MonkeyPatch
) -> None:
    from lupin_runtime.arm import auto_home

    monkeypatch.setattr(auto_home, "RETRY_S", 0.1)
    manager = Manager(graph_host, dict.fromkeys(graph.CONTROLLERS, "active"))
    manager.refusals = 1
    home.run()
    assert manager.presets == ["home", "home"]


@pytest.mark.usefixtures("graph_host")
@pytest.mark.graph
def test_auto_home_fails_in_time_without_a_manager() -> None:
    from lupin_runtime.arm.auto_home import AutoHome, Limits, NotHome
    from lupin_runtime.ros import LupinNode

    node = LupinNode("auto_home")
    home = AutoHome(node, Limits(manager_s=0.3), say=lambda _: None)
    with pytest.raises(NotHome, match=r"waited 0\.3 s for the service /controller_manager/list_controllers"):
        home.run()
    home.close()
    node.destroy_node()


@pytest.mark.graph
def test_auto_home_prints_a_line_per_step(graph_host: GraphHost) -> None:
    from lupin_runtime.arm.auto_home import AutoHome, Limits
    from lupin_runtime.ros import LupinNode

    Manager(graph_host, {**dict.fromkeys(graph.CONTROLLERS, "active"), "pid_wheels_controller": "unconfigured"})
    lines: list[str] = []
    node = LupinNode("auto_home")
    home = AutoHome(node, Limits(**SHORT), lines.append)
    home.run()
    home.close()
    node.destroy_node()
    reported = [line for line in lines if not line.startswith("waiting for ")]
    assert reported == [
        "found: pid_wheels_controller is unconfigured",
        "configure pid_wheels_controller",
        "now: pid_wheels_controller is inactive",
        "activate pid_wheels_controller",
        "now: all 5 controllers are active",
        "preset home",
        "arm: sent",
    ]


@pytest.mark.usefixtures("graph_host")
@pytest.mark.graph
def test_silent_controller_manager_is_not_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    from lupin_runtime.arm.auto_home import AutoHome, Limits, NotHome
    from lupin_runtime.ros import LupinNode

    node = LupinNode("auto_home")
    lines: list[str] = []
    home = AutoHome(node, Limits(visible_s=0.1, poll_s=0.02, call_s=0.1, list_repeat_s=0.02), lines.append)
    monkeypatch.setattr(home, "_wait", lambda *_: None)  # as if the service had been available just before the manager hung
    with pytest.raises(NotHome, match="has a server that does not respond"):
        home.activate_controllers()
    assert not any(line.startswith(("load", "configure", "activate")) for line in lines)
    home.close()
    node.destroy_node()


LATE_S = 1.0


class Slow(Manager):
    """A manager whose first response is late."""

    asked = 0

    def _list(self, request: pytest.FixtureRequest, response: ListControllers_Response) -> ListControllers_Response:
        self.asked += 1
        if self.asked == 1:
            time.sleep(LATE_S)  # the delay itself is under test; there is no event to wait for
        return super()._list(request, response)


@pytest.mark.graph
def test_late_list_response_is_waited_for(graph_host: GraphHost) -> None:
    from lupin_runtime.arm.auto_home import AutoHome, Limits
    from lupin_runtime.ros import LupinNode

    manager = Slow(graph_host, dict.fromkeys(graph.CONTROLLERS, "inactive"))
    node = LupinNode("auto_home")
    lines: list[str] = []
    home = AutoHome(node, Limits(list_repeat_s=0.02 * LATE_S, poll_s=0.1), lines.append)
    home.activate_controllers()
    assert manager.asked > 1 and set(manager.states.values()) == {"active"}
    found = [line for line in lines if line.startswith("found: ")]
    assert len(found) == 1 and found[0].count("is inactive") == len(graph.CONTROLLERS)
    home.close()
    node.destroy_node()


@pytest.mark.graph
def test_lost_list_response_is_requested_again(graph_host: GraphHost, monkeypatch: pytest.MonkeyPatch) -> None:
    from rclpy.task import Future

    from lupin_runtime.arm.auto_home import AutoHome, Limits
    from lupin_runtime.ros import LupinNode

    Manager(graph_host, dict.fromkeys(graph.CONTROLLERS, "active"))
    node = LupinNode("auto_home")
    lines: list[str] = []
    home = AutoHome(node, Limits(call_s=10.0, visible_s=0.0, list_repeat_s=0.02), lines.append)
    ask, lost = home._list.call_async, [Future()]
    monkeypatch.setattr(home._list, "call_async", lambda request: lost.pop() if lost else ask(request))
    home.activate_controllers()
    assert not lost and lines[-1] == "found: all 5 controllers are active"
    home.close()
    node.destroy_node()


@pytest.mark.usefixtures("graph_host")
@pytest.mark.graph
def test_auto_home_is_bounded_in_total() -> None:
    from lupin_runtime.arm.auto_home import AutoHome, Limits, NotHome
    from lupin_runtime.ros import LupinNode

    node = LupinNode("auto_home")
    home = AutoHome(node, Limits(total_s=0.2), say=lambda _: None)  # a wait for one service alone may take longer
    with pytest.raises(NotHome, match=r"waited 0\.\d s for the service"):
        home.run()
    with pytest.raises(NotHome, match=r"gave up after 0\.2 s"):
        home.run()
    home.close()
    node.destroy_node()


@pytest.mark.graph
@pytest.mark.parametrize("word", ["false", "0", "No", " OFF "])
def test_environment_disables_auto_home(word: str) -> None:
    run = subprocess.run(
        [sys.executable, "-m", "lupin_runtime.arm.auto_home"],
        env={**os.environ, "LUPIN_AUTO_HOME": word},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert run.returncode == 0 and "the arm is not moved" in run.stdout


@pytest.mark.graph
def test_lupin_home_moves_the_arm_of_a_live_run(graph_host: GraphHost, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from lupin_runtime.stack.dds import GRAPH_VARIABLES
    from lupin_runtime.stack.runs import create_run

    command = [sys.executable, "-m", "lupin_cli.app", "home", "--local"]
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    nothing = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert nothing.returncode == 3 and "no run is up" in nothing.stderr
    run, lock = create_run()
    run.write_info({"environment": {name: os.environ[name] for name in GRAPH_VARIABLES if name in os.environ}})
    manager = Manager(graph_host, {**dict.fromkeys(graph.CONTROLLERS, "active"), "pid_wheels_controller": "inactive"})
    home = subprocess.run(command, capture_output=True, text=True, timeout=60)
    os.close(lock)
    assert home.returncode == 0, home.stderr
    lines = [line.partition(" s  ")[2] for line in home.stdout.splitlines()]
    assert "found: pid_wheels_controller is inactive" in lines and lines[-1] == "arm: sent"
    assert manager.states["pid_wheels_controller"] == "active" and manager.presets == ["home"]


@pytest.mark.graph
def test_arm_is_not_moved_after_the_command_was_killed(
    graph_host: GraphHost, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from std_msgs.msg import String

    from lupin_runtime.stack.dds import GRAPH_VARIABLES
    from lupin_runtime.stack.runs import create_run

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    run, lock = create_run()
    run.write_info({"environment": {name: os.environ[name] for name in GRAPH_VARIABLES if name in os.environ}})
    manager = Manager(graph_host, dict.fromkeys(graph.CONTROLLERS, "active"))
    status = {"holder": "jogging", "moving": False, "limp": False}
    publisher = manager.node.publisher(graph.ARM_STATUS)
    manager.node.create_timer(0.1, lambda: publisher.publish(String(data=json.dumps(status))))
    command = [sys.executable, "-m", "lupin_cli.app", "home", "--local", "--when-idle"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as home:
        assert home.stdout is not None
        assert any("waiting until the arm is idle" in line for line in home.stdout)
        (program,) = psutil.Process(home.pid).children()
        home.kill()
        status["holder"] = ""
        graph_host.until(lambda: not program.is_running() or program.status() == psutil.STATUS_ZOMBIE, what="the program's end")
    os.close(lock)
    assert manager.presets == []


@pytest.mark.graph
@pytest.mark.parametrize("refuses", [True, False], ids=["preset-refused", "state-received"])
def test_auto_home_is_not_repeated_after_an_estop(graph_host: GraphHost, home: AutoHome, refuses: bool) -> None:
    from std_msgs.msg import Bool

    from lupin_runtime.arm.auto_home import Estopped

    manager = Manager(graph_host, dict.fromkeys(graph.CONTROLLERS, "active"))
    if refuses:
        manager.refusals, manager.refusal = 1, "e-stop engaged: the arm is not moved"
    else:
        estop = manager.node.publisher(graph.ESTOP_STATE)
        manager.node.create_timer(0.05, lambda: estop.publish(Bool(data=True)))
    with pytest.raises(Estopped, match="e-stop engaged"):
        home.run()
    assert manager.presets == ["home"] * refuses


@pytest.mark.graph
def test_auto_home_waits_for_an_estop_that_nobody_pressed(graph_host: GraphHost) -> None:
    """At boot the e-stop is engaged until it has heard the button: that is no press, and the arm is sent home after it."""
    from std_msgs.msg import Bool, String

    from lupin_runtime.arm.auto_home import AutoHome, Limits
    from lupin_runtime.ros import LupinNode

    manager = Manager(graph_host, dict.fromkeys(graph.CONTROLLERS, "active"))
    states, statuses = manager.node.publisher(graph.ESTOP_STATE), manager.node.publisher(graph.ESTOP_STATUS)
    engaged = True
    manager.node.create_timer(0.05, lambda: states.publish(Bool(data=engaged)))

    def say(line: str) -> None:
        """Hear the button once auto-home waits for it."""
        nonlocal engaged
        if line.startswith("waiting for the e-stop"):
            assert manager.presets == []
            engaged = False
            statuses.publish(String(data=json.dumps({"engaged": False, "unheard": [], "presses": 0})))

    node = LupinNode("auto_home")
    home = AutoHome(node, Limits(settle_s=0.1), say, unattended=True)
    statuses.publish(String(data=json.dumps({"engaged": True, "unheard": ["button"], "presses": 0})))
    home.run()
    assert not engaged and manager.presets == ["home"]
    home.close()
    node.destroy_node()


@pytest.mark.graph
def test_press_while_auto_home_waits_for_the_estop_ends_it(graph_host: GraphHost) -> None:
    from std_msgs.msg import Bool, String

    from lupin_runtime.arm.auto_home import AutoHome, Estopped, Limits
    from lupin_runtime.ros import LupinNode

    manager = Manager(graph_host, dict.fromkeys(graph.CONTROLLERS, "active"))
    states, statuses = manager.node.publisher(graph.ESTOP_STATE), manager.node.publisher(graph.ESTOP_STATUS)
    manager.node.create_timer(0.05, lambda: states.publish(Bool(data=True)))
    said: list[str] = []

    def say(line: str) -> None:
        if line.startswith("waiting for the e-stop"):
            said.append(line)
            statuses.publish(String(data=json.dumps({"engaged": True, "unheard": [], "presses": 1})))

    node = LupinNode("auto_home")
    home = AutoHome(node, Limits(settle_s=0.1), say, unattended=True)
    statuses.publish(String(data=json.dumps({"engaged": True, "unheard": ["button"], "presses": 0})))
    with pytest.raises(Estopped, match="e-stop engaged"):
        home.run()
    assert said and manager.presets == []
    home.close()
    node.destroy_node()


def tell_of_press(manager: Manager, ago_s: float) -> None:
    """Publish the e-stop's status after a press that was released again."""
    from std_msgs.msg import String

    status = {"engaged": False, "bridge": "a", "presses": 1, "engaged_s_ago": ago_s}
    manager.node.publisher(graph.ESTOP_STATUS).publish(String(data=json.dumps(status)))


@pytest.mark.graph
@pytest.mark.parametrize(
    ("unattended", "ago_s", "moves"),
    [(True, 1.0, False), (True, 25.0, False), (True, 40.0, True), (False, 5.0, True), (False, 0.0, False)],
    ids=["between-attempts", "long-between-attempts", "earlier", "before-the-request", "after-the-request"],
)
def test_auto_home_does_not_move_after_a_press(
    graph_host: GraphHost, monkeypatch: pytest.MonkeyPatch, unattended: bool, ago_s: float, moves: bool
) -> None:
    from lupin_runtime.arm.auto_home import AutoHome, Estopped, Limits
    from lupin_runtime.ros import LupinNode

    manager = Manager(graph_host, dict.fromkeys(graph.CONTROLLERS, "active"))
    node = LupinNode("auto_home")
    home = AutoHome(node, Limits(settle_s=0.1), lambda _: None, unattended)
    monkeypatch.setattr(home, "activate_controllers", lambda: tell_of_press(manager, ago_s))
    if moves:
        home.run()
    else:
        with pytest.raises(Estopped, match="e-stop engaged"):
            home.run()
    assert manager.presets == ["home"] * moves
    home.close()
    node.destroy_node()


@pytest.mark.graph
def test_unattended_auto_home_waits_for_the_estop_status(graph_host: GraphHost) -> None:
    from lupin_runtime.arm.auto_home import AutoHome, Limits, NotHome
    from lupin_runtime.ros import LupinNode

    manager = Manager(graph_host, dict.fromkeys(graph.CONTROLLERS, "active"))
    node = LupinNode("auto_home")
    home = AutoHome(node, Limits(preset_s=0.1), lambda _: None, unattended=True)
    with pytest.raises(NotHome, match=graph.ESTOP_STATUS.name):
        home.run()
    assert manager.presets == []
    home.close()
    node.destroy_node()


def test_unit_does_not_restart_after_an_estop() -> None:
    from lupin_cli.systemd.units import TEMPLATES
    from lupin_runtime.exit_codes import ESTOPPED

    unit = (TEMPLATES / "lupin-auto-home.service.in").read_text()
    assert f"\nRestartPreventExitStatus={ESTOPPED}\n" in unit
    assert ' --unattended"\n' in unit
