"""Where a release lies on a robot, what is sourced before anything of it, and running a program of it there."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence

from lupin_cli.config import ROS_SETUP, Robot
from lupin_cli.target.base import Output, Target

ROOT = "/opt/lupin"
RELEASE = f"{ROOT}/current"
NOT_DEPLOYED = 127


def set_up(ros_setup: Sequence[str] = ROS_SETUP) -> tuple[str, ...]:
    """Lines of bash that come before anything of the release: the vendor's choice of discovery, its ROS, our messages.

    Messages are built on the robot only where it has a ROS of its own.
    """
    ours = f"{RELEASE}/ws/install/setup.bash"
    return ("source ~/.mirte_settings.sh", *ros_setup, f"if [ -r {ours} ]; then source {ours}; fi")


def program(robot: Robot, module: str, *arguments: str) -> str:
    """A shell script that runs a module of the release as the robot's units do. Its status is the module's, or NOT_DEPLOYED."""
    python = f"{RELEASE}/venv/bin/python3"
    # UDP as in the units: what joins late over shared memory sees names and gets no samples.
    udp = "export FASTDDS_BUILTIN_TRANSPORTS=UDPv4"
    lines: Sequence[str] = (*set_up(robot.ros_setup), udp, f"exec {shlex.join([python, '-u', '-m', module, *arguments])}")
    # bash, since the set-up files are bash's; with a login's environment, as the units have it.
    return f"[ -x {python} ] || exit {NOT_DEPLOYED}\nexec bash -lc {shlex.quote('; '.join(lines))}"


def run_program(
    target: Target, robot: Robot, module: str, *arguments: str, bound_s: float, on_line: Callable[[str], None] | None = None
) -> Output:
    """Run it and wait for its end. Raises TargetError where the robot can't be reached."""
    return target.run(program(robot, module, *arguments), bound_s=bound_s, on_line=on_line)
