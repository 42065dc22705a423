"""Activates the vendor's controllers, then moves the arm to `home`.

    python -m lupin_runtime.arm.auto_home [--patience S] [--unattended] [--when-idle S] [--ask]

The robot runs it at boot and again after a failure (`--unattended`), and `lupin home` runs it on request; over SSH, that
answers a question just before the arm moves (`--ask`), because its link may be lost by then. It prints a line per
step with what it found and did. Exit status: 0 the arm was sent home, or LUPIN_AUTO_HOME disables this; 4 the e-stop was
pressed, if only for a moment, and systemd does not start it again; 1 otherwise, with the reason. Every wait has a timeout, also
that for an e-stop whose process has not heard every source since it was started.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import rclpy
from controller_manager_msgs.srv import SwitchController
from rclpy.client import Client
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.task import Future

from lupin_runtime import graph, home_report
from lupin_runtime.arm.consent import ANSWER_LIMIT_S, Consent
from lupin_runtime.arm.controllers import inactive_controllers, next_step
from lupin_runtime.arm.idle_watch import IdleWatch
from lupin_runtime.arm.joint_state import arm_state
from lupin_runtime.arm.motion import RESERVED
from lupin_runtime.ending import exit_with
from lupin_runtime.environment import is_off
from lupin_runtime.exit_codes import ESTOPPED, FAILURE, SUCCESS
from lupin_runtime.ros.leaving import leave_graph
from lupin_runtime.ros.node import ROS_ARGUMENTS, LupinNode
from lupin_runtime.safety.estop_monitor import ESTOP_ENGAGED
from lupin_runtime.safety.estop_subscription import subscribe_estop
from lupin_runtime.safety.expected_sources import tells_of_no_press

RETRY_S = 1.0
# The unit's RestartSec= and the start of a process on a slow computer: a press between two attempts is not older than this.
BETWEEN_ATTEMPTS_S = 30.0
# An engaged state may arrive before the status that tells of its reason; the state repeats at 5 Hz.
STATUS_DELAY_S = 1.0
_ESTOPPED = f"{ESTOP_ENGAGED}: the arm is not moved; after its release: lupin home"


class NotHome(RuntimeError):
    """The arm was not sent home; the message gives the reason."""


class LeftAlone(NotHome):
    """The arm is in use, or the request to move it was withdrawn."""


class Estopped(NotHome):
    """The e-stop is engaged, or was pressed after the command to move, so that the command is older than the release."""


@dataclass(frozen=True)
class Limits:
    """The largest duration of each step, and of all steps together, in seconds."""

    manager_s: float = 30.0
    visible_s: float = 60.0
    poll_s: float = 2.0
    call_s: float = 15.0
    list_repeat_s: float = 3.0
    joint_states_s: float = 30.0
    preset_s: float = 30.0
    release_s: float = 30.0
    settle_s: float = 2.0
    home_s: float = 10.0
    idle_s: float | None = None  # None: the arm is sent home whoever uses it
    total_s: float = 220.0


def opted_out(environment: Mapping[str, str]) -> bool:
    """Return whether LUPIN_AUTO_HOME disables auto-home."""
    return is_off(environment, "LUPIN_AUTO_HOME")


class AutoHome:
    """Runs the steps in order; `say` is called with a line per step. With `consent`, it is asked for just before the arm moves.

    Nobody has just asked for an `unattended` one: it moves nothing if the e-stop was pressed within BETWEEN_ATTEMPTS_S before.
    """

    def __init__(
        self,
        node: LupinNode,
        limits: Limits | None = None,
        say: Callable[[str], None] = print,
        unattended: bool = False,
        consent: Consent | None = None,
    ) -> None:
        self._limits, self._say, self._unattended, self._consent = limits or Limits(), say, unattended, consent
        self.before = home_report.read_report(home_report.own_folder())  # what an earlier one reported
        self._monotonic_ns = node.monotonic_ns
        self._began_s = self._now_s()
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)
        self._list = node.client(graph.LIST_CONTROLLERS)
        self._load = node.client(graph.LOAD_CONTROLLER)
        self._configure = node.client(graph.CONFIGURE_CONTROLLER)
        self._switch = node.client(graph.SWITCH_CONTROLLER)
        self._preset = node.client(graph.ARM_PRESET)
        self._arm_received = self._status_received = False
        self._engaged_s: float | None = None  # since when the e-stop is engaged
        self._no_press = False  # whether its process was never pressed: it may be engaged until it has heard every source
        since_ns = node.monotonic_ns() - int(BETWEEN_ATTEMPTS_S * 1e9) * unattended
        subscribe_estop(node, self._on_estop, pressed_since_ns=since_ns)
        node.subscription(graph.ESTOP_STATUS, self._on_estop_status)
        node.subscription(graph.JOINT_STATES, self._on_joint_states)
        self._idle = IdleWatch(node.monotonic_ns())
        if self._limits.idle_s is not None:
            node.subscription(graph.ARM_STATUS, lambda message: self._on_use(self._idle.status, message))
            node.subscription(graph.ARM_LIBRARY_STATE, lambda message: self._on_use(self._idle.library, message))
            node.subscription(graph.MISSION_STATE, self._on_mission)

    def run(self) -> None:
        """Run all steps. Raises NotHome."""
        if self._limits.idle_s is None:
            home_report.write_report(home_report.ACTIVATING)
        self.activate_controllers()
        awaited = f"{graph.JOINT_STATES.name} with all four arm joints"
        self._wait(lambda: self._arm_received, self._limits.joint_states_s, awaited)
        self._wait(self._preset.service_is_ready, self._limits.preset_s, f"the service {graph.ARM_PRESET.name}")
        if self._unattended:
            self._wait(lambda: self._status_received, self._limits.preset_s, graph.ESTOP_STATUS.name)
        is_idle = False
        while not is_idle:
            if self._limits.idle_s is not None:
                self._wait_until_idle(self._limits.idle_s)
            self._settle()  # during which somebody may begin to use the arm
            self._require_consent()
            is_idle = self._limits.idle_s is None or not self._idle.reason(self._monotonic_ns())
        self._go_home()

    def _settle(self) -> None:
        """Announce the motion for a moment, and wait for an e-stop that nobody pressed."""
        home_report.write_report(home_report.HOMING)
        self._spin_for(self._limits.settle_s)
        while self._engaged_s is not None:
            self._wait(lambda: self._engaged_s is None, self._limits.release_s, "the e-stop, which has not heard every source")
            self._spin_for(self._limits.settle_s)  # the arm's service may notice the release a little later

    def _require_consent(self) -> None:
        """Ask for consent, if it is to be asked for. Raises LeftAlone if the answer does not come."""
        consent = self._consent
        if consent is None:
            return
        consent.ask()
        deadline = self._now_s() + self._bounded_s(ANSWER_LIMIT_S)
        while not consent.is_given():
            if consent.is_refused or self._now_s() > deadline:
                raise LeftAlone("the computer that asked for it does not answer any more; the arm is not moved")
            self._executor.spin_once(timeout_sec=0.1)

    def _wait_until_idle(self, limit_s: float) -> None:
        deadline, said = self._now_s() + self._bounded_s(limit_s), ""
        while reason := self._idle.reason(self._monotonic_ns()):
            if not said:
                home_report.write_left_alone(self.before, reason)  # in place of an announced motion
            if self._now_s() > deadline:
                raise LeftAlone(f"the arm was not idle within {limit_s:g} s: {reason}")
            if reason != said:
                self._say(f"waiting until the arm is idle: {reason}")
            said = reason
            self._executor.spin_once(timeout_sec=0.1)

    def activate_controllers(self) -> None:
        """Load, configure and activate every controller. Raises NotHome, naming each that is not active."""
        limits = self._limits
        self._wait(self._list.service_is_ready, limits.manager_s, f"the service {graph.LIST_CONTROLLERS.name}")
        deadline = self._now_s() + limits.visible_s
        states = self._states(limits.visible_s)
        self._report("found", states)
        # At boot the vendor's spawners are still running: first give them time to load the controllers.
        while any(name not in states for name in graph.CONTROLLERS) and self._now_s() < deadline:
            self._spin_for(limits.poll_s)
            states = self._states()
        for _ in range(3):  # load, configure, activate
            step = next_step(states, graph.CONTROLLERS)
            if not step:
                break
            for name in step.load:
                self._call(self._load, f"load {name}", name=name)
            for name in step.configure:
                self._call(self._configure, f"configure {name}", name=name)
            if step.activate:
                self._activate(list(step.activate))
            states = self._states()
            self._report("now", states)
        inactive = inactive_controllers(states, graph.CONTROLLERS)
        if inactive:
            raise NotHome(f"controllers not active: {', '.join(inactive)}; see journalctl -u mirte-ros")

    def _report(self, when: str, states: Mapping[str, str]) -> None:
        inactive = inactive_controllers(states, graph.CONTROLLERS)
        self._say(f"{when}: " + (", ".join(inactive) or f"all {len(graph.CONTROLLERS)} controllers are active"))

    def _go_home(self) -> None:
        deadline = self._now_s() + self._limits.home_s
        while True:
            answer = self._call(self._preset, "preset home", self._limits.home_s, name="home")
            if answer is not None and answer.success:
                self._say(f"arm: {answer.message}")
                return
            if answer is not None and answer.message.startswith(ESTOP_ENGAGED):
                raise Estopped(answer.message)
            if answer is not None and answer.message.startswith(RESERVED) and self._limits.idle_s is None:
                raise LeftAlone(answer.message)  # it was in use a moment ago: a hand may still be near it
            if self._now_s() + RETRY_S > deadline:
                reason = "no response" if answer is None else answer.message
                raise NotHome(f"{graph.ARM_PRESET.name} did not send the arm home: {reason}")
            self._spin_for(RETRY_S)
            if self._limits.idle_s is not None:  # somebody has begun to use the arm
                self._wait_until_idle(self._limits.idle_s)
                self._require_consent()

    def _activate(self, names: list[str]) -> None:
        self._call(
            self._switch,
            f"activate {', '.join(names)}",
            activate_controllers=names,
            strictness=SwitchController.Request.BEST_EFFORT,
            activate_asap=True,
        )

    def _states(self, patience_s: float = 0.0) -> dict[str, str]:
        """Return the states that the controller manager lists. Raises NotHome if it does not respond.

        A response is lost while the manager has not yet discovered this client, so the request is repeated; the first response
        to any of the requests is used.
        """
        deadline = self._now_s() + self._bounded_s(self._limits.call_s + patience_s)
        requests: list[Future] = []
        try:
            while (remaining_s := deadline - self._now_s()) > 0.0:
                requests.append(self._list.call_async(self._list.srv_type.Request()))
                repeat = self._now_s() + min(self._limits.list_repeat_s, remaining_s)
                while self._now_s() < repeat:
                    self._executor.spin_once(timeout_sec=0.1)
                    if done := next(filter(Future.done, requests), None):
                        return {item.name: item.state for item in done.result().controller}
        finally:
            for request in requests:
                self._list.remove_pending_request(request)
        raise NotHome(f"{graph.LIST_CONTROLLERS.name} has a server that does not respond; see journalctl -u mirte-ros")

    def _call(self, client: Client, what: str, limit_s: float | None = None, /, **fields: Any) -> Any:
        """Return the response of a service, or None after the timeout. The next list of controllers shows the effect."""
        if what:
            self._say(what)
        future = client.call_async(client.srv_type.Request(**fields))
        self._executor.spin_until_future_complete(future, self._bounded_s(self._limits.call_s if limit_s is None else limit_s))
        if not future.done():
            client.remove_pending_request(future)
            self._say(f"no response from {client.srv_name}")
            return None
        answer = future.result()
        if what and not getattr(answer, "ok", True):
            self._say(f"{what}: refused by {client.srv_name}")
        return answer

    def _bounded_s(self, limit_s: float) -> float:
        """Return `limit_s`, but at most the rest of the total. Raises NotHome if no time remains."""
        remaining_s = self._began_s + self._limits.total_s - self._now_s()
        if remaining_s <= 0.0:
            raise NotHome(f"gave up after {self._limits.total_s:g} s; the journals of mirte-ros and lupin-onboard say why")
        return min(limit_s, remaining_s)

    def _on_estop(self, engaged: bool) -> None:
        now_s = self._now_s()
        if not engaged:
            self._engaged_s = None
            return
        if self._engaged_s is None:
            self._engaged_s = now_s
        is_new = not self._status_received and now_s - self._engaged_s < STATUS_DELAY_S
        if not (self._no_press or is_new):
            raise Estopped(_ESTOPPED)

    def _on_estop_status(self, message: Any) -> None:
        self._status_received = True
        self._no_press = tells_of_no_press(message.data)
        if self._engaged_s is not None and not self._no_press:
            raise Estopped(_ESTOPPED)

    def _on_use(self, handle: Callable[[str, int], None], message: Any) -> None:
        with suppress(ValueError):  # another program's: as if it had not been received
            handle(message.data, self._monotonic_ns())

    def _on_mission(self, message: Any) -> None:
        self._idle.mission(message.lifecycle_state, self._monotonic_ns())

    def _on_joint_states(self, message: Any) -> None:
        self._arm_received = self._arm_received or arm_state(message.name, message.position, 0) is not None

    def _now_s(self) -> float:
        return self._monotonic_ns() / 1e9

    def _wait(self, condition: Callable[[], bool], limit_s: float, what: str) -> None:
        limit_s = self._bounded_s(limit_s)
        deadline = self._now_s() + limit_s
        if not condition():
            self._say(f"waiting for {what}")
        while not condition():
            if self._now_s() > deadline:
                raise NotHome(f"waited {limit_s:.1f} s for {what}; see journalctl -u mirte-ros -u lupin-onboard")
            self._executor.spin_once(timeout_sec=0.1)

    def _spin_for(self, duration_s: float) -> None:
        end = self._now_s() + self._bounded_s(duration_s)
        while (remaining_s := end - self._now_s()) > 0.0:
            self._executor.spin_once(timeout_sec=min(0.1, remaining_s))

    def close(self) -> None:
        """Stop the executor; call it before rclpy is shut down."""
        self._executor.shutdown(timeout_sec=2.0)


def main(arguments: list[str]) -> int:
    """Run all steps once; return the exit status."""
    parser = argparse.ArgumentParser(prog="auto_home", description="Activate the controllers, then send the arm home.")
    visible_s = Limits().visible_s
    parser.add_argument(
        "--patience", type=float, default=visible_s, help="seconds to wait for the vendor to load its controllers"
    )
    parser.add_argument(
        "--unattended", action="store_true", help=f"exit with 4 if the e-stop was pressed in the last {BETWEEN_ATTEMPTS_S:g} s"
    )
    parser.add_argument(
        "--when-idle", type=float, metavar="S", help="wait up to S seconds until the arm is idle, then send it home"
    )
    parser.add_argument("--ask", action="store_true", help="ask on standard output before the arm moves")
    options = parser.parse_args(arguments)
    if opted_out(os.environ):
        home_report.write_report(home_report.OFF)
        print("LUPIN_AUTO_HOME disables auto-home: the arm is not moved")
        return SUCCESS
    began_s = time.monotonic()

    def say(line: str) -> None:
        print(f"{time.monotonic() - began_s:6.1f} s  {line}", flush=True)

    rclpy.init(args=ROS_ARGUMENTS)
    node = LupinNode("auto_home", enable_rosout=False)
    limits = replace(Limits(), visible_s=options.patience, idle_s=options.when_idle)
    limits = replace(limits, total_s=limits.total_s + (limits.idle_s or 0.0))
    home = AutoHome(node, limits, say, options.unattended, Consent() if options.ask else None)
    try:
        home.run()
    except NotHome as reason:
        print(reason, file=sys.stderr)
        return _report_failure(reason, options.unattended, home.before)
    except ExternalShutdownException:
        home_report.write_report(home_report.FAILED, "auto-home was stopped before the arm was home")
        print("stopped before the arm was home", file=sys.stderr)
        return FAILURE
    finally:
        home.close()
        leave_graph(node)
    home_report.write_report(home_report.HOME)
    return SUCCESS


def _report_failure(reason: NotHome, unattended: bool, before: home_report.HomeReport | None = None) -> int:
    """Write why the arm was not sent home; return the exit status. systemd tries again, unless that is ESTOPPED."""
    if isinstance(reason, LeftAlone):
        # No failure: an operator uses the arm, or withdrew the request.
        home_report.write_left_alone(before, str(reason))
        return ESTOPPED if unattended else FAILURE
    if isinstance(reason, Estopped):
        home_report.write_report(home_report.ESTOPPED, str(reason))
        return ESTOPPED
    home_report.write_report(home_report.RETRYING if unattended else home_report.FAILED, str(reason))
    return FAILURE


if __name__ == "__main__":
    exit_with(main(sys.argv[1:]))
