"""Runs programs of the ROS distribution that is installed on this computer, as a part of this process."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import yaml
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.task import Future

from lupin_runtime.ament import find_package
from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.environment import without_ros_wheels
from lupin_runtime.ros.node import ROS_ARGUMENTS, LupinNode

ANSWER_TIMEOUT_S = 30.0
TERMINATE_GRACE_S = 1.5
_PERIOD_S = 0.1
_LOG_WAIT_PERIOD_S = 10.0
_TRANSITIONS = ((Transition.TRANSITION_CONFIGURE, "configure"), (Transition.TRANSITION_ACTIVATE, "activate"))


class ProgramError(RuntimeError):
    """A program is missing, has exited, or does not become active."""


@dataclass(frozen=True)
class Running:
    """A program, and the managed node in it (design.ros2.org/articles/node_lifecycle.html)."""

    name: str
    node: str
    process: subprocess.Popen[bytes]


class SystemPrograms(LupinNode):
    """Starts programs, and makes their managed nodes active in their order. If one exits, this process ends, and all others.

    How long they may take to start is the supervisor's to judge: it ends what is not up in time.

    Parameters: `programs`, each `PACKAGE/EXECUTABLE/NODE`; `parameter_file`, to which `ros_parameters` (nodes and their
    parameters, as for `--params-file`) are written. `remappings` apply to every program.
    """

    def __init__(
        self,
        name: str,
        ros_parameters: Mapping[str, Any],
        remappings: Mapping[str, str],
        parameters: dict[str, Any] | None = None,
    ) -> None:
        super().__init__(name, parameters)
        programs = [text.split("/") for text in self.parameter("programs", [""])]
        file = Path(self.parameter("parameter_file", ""))
        commands = [_command(package, executable) for package, executable, _ in programs]
        _write(file, yaml.safe_dump(dict(ros_parameters), sort_keys=False))
        arguments = [*ROS_ARGUMENTS, "--params-file", str(file)]
        for source, target in remappings.items():
            arguments += ["-r", f"{source}:={target}"]
        self._stopping = False
        self._running = [
            Running(executable, node, _start([*command, *arguments]))
            for (_, executable, node), command in zip(programs, commands, strict=True)
        ]
        self._steps = deque((program.node, *step) for program in self._running for step in _TRANSITIONS)
        self._client: Client | None = None
        self._answer: Future | None = None
        self._requested_s = 0.0
        # A paused simulation must not hide that a program has exited.
        self.create_timer(_PERIOD_S, self._step, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _step(self) -> None:
        if self._stopping:
            return
        for program in self._running:
            status = program.process.poll()
            if status is not None:
                self._fail(f"{program.name} {_exit_text(status)}")
        if self._steps:
            self._advance(*self._steps[0])

    def _advance(self, node: str, transition: int, verb: str) -> None:
        """Request a transition, or look for its answer."""
        if self._client is None:
            self._client = self.create_client(ChangeState, f"/{node}/change_state")
        if self._answer is None and self._client.service_is_ready():
            self._answer = self._client.call_async(ChangeState.Request(transition=Transition(id=transition)))
            self._requested_s = time.monotonic()
        if self._answer is None or not self._answer.done():
            if self._answer is not None and time.monotonic() - self._requested_s > ANSWER_TIMEOUT_S:
                self._fail(f"{node} did not answer a request to {verb} within {ANSWER_TIMEOUT_S:.0f} s")
            self.get_logger().warning(
                f"waiting for {node} to {verb}", throttle_duration_sec=_LOG_WAIT_PERIOD_S, skip_first=True
            )
            return
        result = self._answer.result()
        if result is None or not result.success:
            self._fail(f"{node} did not {verb}; its own lines in this log say why")
        self.destroy_client(self._client)
        self._client = self._answer = None
        self._steps.popleft()
        if not self._steps:
            self.get_logger().info(f"active: {', '.join(program.node for program in self._running)}")

    def _fail(self, reason: str) -> NoReturn:
        self._end_programs()  # what they print at their end must not stand below the reason in the log
        raise ProgramError(reason)

    def before_shutdown(self) -> None:
        """End the programs."""
        self._end_programs()

    def _end_programs(self) -> None:
        """Terminate the programs; kill what has not ended after TERMINATE_GRACE_S."""
        self._stopping = True
        for program in self._running:
            program.process.terminate()
            program.process.send_signal(signal.SIGCONT)
        deadline = time.monotonic() + TERMINATE_GRACE_S
        for program in self._running:
            try:
                program.process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                program.process.kill()
                program.process.wait()


def _command(package: str, executable: str) -> list[str]:
    found = find_package(package, os.environ)
    if found is None or not (command := found.command(executable)):
        raise ProgramError(f"{executable} of the ROS package {package} is not installed")
    return command


def _write(path: Path, text: str) -> None:
    """Write a file unless it is there already: a full disk must not keep a process from being replaced."""
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_atomically(path, text)


def _start(command: Sequence[str]) -> subprocess.Popen[bytes]:
    """Start a program that the kernel kills with this process, so that no second one ever runs beside its replacement."""
    killed_with_parent = ["setpriv", "--pdeathsig", "KILL", "--"]
    return subprocess.Popen([*killed_with_parent, *command], stdin=subprocess.DEVNULL, env=without_ros_wheels(os.environ))


def _exit_text(status: int) -> str:
    return f"was killed by {signal.Signals(-status).name}" if status < 0 else f"exited with status {status}"
