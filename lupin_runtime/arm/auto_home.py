"""Heal the vendor's controllers, then send the arm to `home`. Run as `python -m lupin_runtime.arm.auto_home [--patience S]`.

The robot's boot runs it, and so does `lupin home`. A line per step says what was found and what was done. Exit status 0 when
the arm was sent home (or LUPIN_AUTO_HOME says no), 1 with the reason otherwise. Every wait is bounded, in real time.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import rclpy
from controller_manager_msgs.srv import SwitchController
from rclpy.client import Client
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.task import Future

from lupin_runtime import graph
from lupin_runtime.arm.controllers import complaints, next_step
from lupin_runtime.arm.states import arm_state
from lupin_runtime.ros import LupinNode

OPT_OUT = ("false", "0", "no", "off")
RETRY_S = 1.0


class NotHome(RuntimeError):
    """The arm was not sent home; the message says what was missing."""


@dataclass(frozen=True)
class Limits:
    """How long each step may take, and all of them together, s."""

    manager_s: float = 30.0
    visible_s: float = 60.0
    poll_s: float = 2.0
    call_s: float = 15.0
    again_s: float = 3.0
    joint_states_s: float = 30.0
    preset_s: float = 30.0
    settle_s: float = 2.0
    home_s: float = 10.0
    longest_s: float = 220.0


def opted_out(environment: Mapping[str, str]) -> bool:
    """Whether LUPIN_AUTO_HOME says no."""
    return environment.get("LUPIN_AUTO_HOME", "").strip().lower() in OPT_OUT


class AutoHome:
    """The steps, in order. `say` gets a line per step."""

    def __init__(self, node: LupinNode, limits: Limits | None = None, say: Callable[[str], None] = print) -> None:
        self._limits, self._say = limits or Limits(), say
        self._began_s = time.monotonic()
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)
        self._list = node.client(graph.LIST_CONTROLLERS)
        self._load = node.client(graph.LOAD_CONTROLLER)
        self._configure = node.client(graph.CONFIGURE_CONTROLLER)
        self._switch = node.client(graph.SWITCH_CONTROLLER)
        self._preset = node.client(graph.ARM_PRESET)
        self._arm_heard = False
        node.subscription(graph.JOINT_STATES, self._on_joint_states)

    def run(self) -> None:
        """Do all steps. Raises NotHome."""
        self.heal()
        self._wait(lambda: self._arm_heard, self._limits.joint_states_s, "/joint_states with all four arm joints")
        self._wait(self._preset.service_is_ready, self._limits.preset_s, f"the service {graph.ARM_PRESET.name}")
        self._spin_for(self._limits.settle_s)
        self._go_home()

    def heal(self) -> None:
        """Bring every controller to `active`. Raises NotHome, naming each that is not."""
        limits = self._limits
        self._wait(self._list.service_is_ready, limits.manager_s, f"the service {graph.LIST_CONTROLLERS.name}")
        deadline = time.monotonic() + limits.visible_s
        states = self._states(limits.visible_s)
        self._report("found", states)
        # The vendor's spawners are at work at boot: what they load need not be loaded by us.
        while any(name not in states for name in graph.CONTROLLERS) and time.monotonic() < deadline:
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
        wrong = complaints(states, graph.CONTROLLERS)
        if wrong:
            raise NotHome(f"controllers not active: {', '.join(wrong)}; see journalctl -u mirte-ros")

    def _report(self, when: str, states: Mapping[str, str]) -> None:
        wrong = complaints(states, graph.CONTROLLERS)
        self._say(f"{when}: {', '.join(wrong)}" if wrong else f"{when}: all {len(graph.CONTROLLERS)} controllers are active")

    def _go_home(self) -> None:
        deadline = time.monotonic() + self._limits.home_s
        while True:
            answer = self._call(self._preset, "preset home", self._limits.home_s, name="home")
            if answer is not None and answer.success:
                self._say(f"arm: {answer.message}")
                return
            if time.monotonic() + RETRY_S > deadline:
                reason = "no answer" if answer is None else answer.message
                raise NotHome(f"{graph.ARM_PRESET.name} did not send the arm home: {reason}")
            self._spin_for(RETRY_S)

    def _activate(self, names: list[str]) -> None:
        self._call(
            self._switch,
            f"activate {', '.join(names)}",
            activate_controllers=names,
            strictness=SwitchController.Request.BEST_EFFORT,
            activate_asap=True,
        )

    def _states(self, patience_s: float = 0.0) -> dict[str, str]:
        """What the manager lists. Raises NotHome where it never does: loading on a guess would only make it worse.

        An answer is lost where the manager doesn't know yet who asked, so it is asked anew; the first answer to any of the
        questions counts, however late it is.
        """
        deadline = time.monotonic() + self._left_s(self._limits.call_s + patience_s)
        asked: list[Future] = []
        try:
            while (left_s := deadline - time.monotonic()) > 0.0:
                asked.append(self._list.call_async(self._list.srv_type.Request()))
                again = time.monotonic() + min(self._limits.again_s, left_s)
                while time.monotonic() < again:
                    self._executor.spin_once(timeout_sec=0.1)
                    if answered := next(filter(Future.done, asked), None):
                        return {item.name: item.state for item in answered.result().controller}
        finally:
            for question in asked:
                self._list.remove_pending_request(question)
        raise NotHome(f"{graph.LIST_CONTROLLERS.name} is there and never answered; see journalctl -u mirte-ros")

    def _call(self, client: Client, what: str, limit_s: float | None = None, /, **fields: Any) -> Any:
        """The answer of a service, or None where there was none in time. What came of it shows in what is listed next."""
        if what:
            self._say(what)
        future = client.call_async(client.srv_type.Request(**fields))
        self._executor.spin_until_future_complete(future, self._left_s(self._limits.call_s if limit_s is None else limit_s))
        if not future.done():
            client.remove_pending_request(future)
            self._say(f"no answer from {client.srv_name}")
            return None
        answer = future.result()
        if what and not getattr(answer, "ok", True):
            self._say(f"{what}: refused by {client.srv_name}")
        return answer

    def _left_s(self, limit_s: float) -> float:
        """`limit_s`, or what is left of the whole where that is less. Raises NotHome when nothing is."""
        left_s = self._began_s + self._limits.longest_s - time.monotonic()
        if left_s <= 0.0:
            raise NotHome(f"gave up after {self._limits.longest_s:g} s; see journalctl -u mirte-ros -u lupin-onboard")
        return min(limit_s, left_s)

    def _on_joint_states(self, message: Any) -> None:
        self._arm_heard = self._arm_heard or arm_state(message.name, message.position, 0) is not None

    def _wait(self, condition: Callable[[], bool], limit_s: float, what: str) -> None:
        limit_s = self._left_s(limit_s)
        deadline = time.monotonic() + limit_s
        if not condition():
            self._say(f"waiting for {what}")
        while not condition():
            if time.monotonic() > deadline:
                raise NotHome(f"waited {limit_s:.1f} s for {what}; see journalctl -u mirte-ros -u lupin-onboard")
            self._executor.spin_once(timeout_sec=0.1)

    def _spin_for(self, duration_s: float) -> None:
        end = time.monotonic() + self._left_s(duration_s)
        while (left_s := end - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=min(0.1, left_s))

    def close(self) -> None:
        """Stop the executor; before rclpy is shut down."""
        self._executor.shutdown(timeout_sec=2.0)


def main(arguments: list[str]) -> int:
    """Run all steps once."""
    parser = argparse.ArgumentParser(prog="auto_home", description="Heal the controllers, then send the arm home.")
    visible_s = Limits().visible_s
    parser.add_argument(
        "--patience", type=float, default=visible_s, help="s for the vendor to load a missing controller itself"
    )
    patience_s = parser.parse_args(arguments).patience
    if opted_out(os.environ):
        print("LUPIN_AUTO_HOME says no: the arm stays where it is")
        return 0
    began_s = time.monotonic()

    def say(line: str) -> None:
        print(f"{time.monotonic() - began_s:6.1f} s  {line}", flush=True)

    rclpy.init(args=[])
    node = LupinNode("auto_home")
    home = AutoHome(node, replace(Limits(), visible_s=patience_s), say)
    try:
        home.run()
    except NotHome as reason:
        print(reason, file=sys.stderr)
        return 1
    except ExternalShutdownException:
        print("told to end before the arm was home", file=sys.stderr)
        return 1
    finally:
        home.close()
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    status = main(sys.argv[1:])
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # nothing is left to do, and the middleware's threads may take their time
