"""Lupin's units on a simulated robot: they run this checkout, as if it had been deployed, and programs join their graph."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lupin_sim.host.computer import CommandResult
    from lupin_sim.host.host import Robot

TIMEOUT_S = 60.0
# The vendor's DDS profile, with which a program on the robot learns of all participants.
PROFILE = "/home/mirte/mirte_ws/install/super_client.xml"
STATE = "/run/lupin-onboard"  # where the state of their run is
# As a deploy sets it: else the robot's publishers, including the simulator's, stall while the laptop is unreachable.
WAITING_BYTES = 65536


def install_units(robot: Robot, names: Collection[str] = ()) -> None:
    """Install units without starting them; all of them, if none is named. Raises RuntimeError on failure."""
    from lupin_cli.systemd import units
    from lupin_sim.host.checkout import CURRENT_RELEASE, SETUP_LINES, keep_shared_memory, link_checkout

    link_checkout(robot)
    keep_shared_memory(robot)
    for name, text in units.robot_units("mirte", CURRENT_RELEASE, SETUP_LINES).items():
        if not names or name in names:
            done = robot.run_as_root("sh", "-c", f"cat > /etc/systemd/system/{name}", stdin=text)
            if done.status != 0:
                raise RuntimeError(f"{name} was not installed on {robot.name}: {done.stderr}")
    limit = f"for each in /proc/sys/net/ipv4/neigh/*/unres_qlen_bytes; do echo {WAITING_BYTES} > $each; done"
    done = robot.run_as_root("sh", "-ec", f"{limit}; systemctl daemon-reload")
    if done.status != 0:
        raise RuntimeError(f"the units of {robot.name} were not prepared: {done.stderr}")


def run_on_graph(robot: Robot, command: Sequence[str], timeout_s: float = TIMEOUT_S) -> CommandResult:
    """Run a command with arguments on the robot, as a part of its graph."""
    from lupin_sim.host.host import PROJECT

    environment = f"ROS_DISCOVERY_SERVER=127.0.0.1 FASTRTPS_DEFAULT_PROFILES_FILE={PROFILE} PYTHONPATH={PROJECT}"
    environment += f" XDG_STATE_HOME={STATE}"
    # As the robot's user: nodes of other users do not get all data over shared memory. As a unit, as its monotonic clock is
    # that of the other units; the clock of a command that enters the computer from outside differs.
    unit = ("systemd-run", "--quiet", "--wait", "--pipe", "--collect", "--uid=mirte", "--property=LimitRTPRIO=1")
    return robot.run_as_root(*unit, "sh", "-c", f"{environment} {shlex.join(command)}", timeout_s=timeout_s)


def run_script_on_graph(robot: Robot, script: str, *arguments: str) -> CommandResult:
    """Run a Python script on the robot, as a node of its graph."""
    return run_on_graph(robot, [sys.executable, "-c", script, *arguments])
