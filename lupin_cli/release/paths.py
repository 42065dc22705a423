"""The path of the current release on a robot, and the command that runs a module of it."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from lupin_cli.connection.inventory import ROS_SETUP, Robot

ROOT = "/opt/lupin"
RELEASE = f"{ROOT}/current"
NOT_DEPLOYED = 127


def setup_lines(ros_setup: Sequence[str] = ROS_SETUP) -> tuple[str, ...]:
    """Return the bash lines that set up the release's environment: the vendor's discovery settings, ROS, our interface package.

    The interface package is built on the robot only if the robot has its own ROS.
    """
    workspace = f"{RELEASE}/ws/install/setup.bash"
    return ("source ~/.mirte_settings.sh", *ros_setup, f"if [ -r {workspace} ]; then source {workspace}; fi")


def remote_command(robot: Robot, module: str, *arguments: str) -> str:
    """Return the shell script that runs a module of the release as the robot's units do.

    Its exit status is the module's, or NOT_DEPLOYED if there is no release.
    """
    python = f"{RELEASE}/venv/bin/python3"
    # UDP as in the units: over shared memory, a process that joins late sees names but receives no samples.
    udp_only = "export FASTDDS_BUILTIN_TRANSPORTS=UDPv4"
    lines: Sequence[str] = (
        *setup_lines(robot.ros_setup),
        udp_only,
        "cd /",  # Python imports from the current folder first, and the robot's may be too old for -P
        f"exec {shlex.join([python, '-u', '-m', module, *arguments])}",
    )
    # The setup files need bash. -l gives the login environment that the units have.
    return f"[ -x {python} ] || exit {NOT_DEPLOYED}\nexec bash -lc {shlex.quote('; '.join(lines))}"
