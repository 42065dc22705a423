"""This checkout in the place of a release on a robot: it is mounted there, so units run without a deploy."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lupin_sim.host.host import Robot

RELEASE = "/opt/lupin/current"
UNITS = ("lupin-onboard.service", "lupin-auto-home.service")
# What is sourced there before anything of Lupin's; it has no ROS beside the vendor's.
SET_UP = ("source ~/.mirte_settings.sh", "source ~/mirte_ws/install/setup.bash")
LOGIND = "/etc/systemd/logind.conf.d/60-lupin.conf"
READ_AGAIN = "systemctl kill -s HUP systemd-logind"
KEEP_MEMORY = f"mkdir -p {LOGIND.rpartition('/')[0]}; printf '[Login]\\nRemoveIPC=no\\n' > {LOGIND}; {READ_AGAIN}"
LOSE_MEMORY = f"rm -f {LOGIND}; {READ_AGAIN}"


def keep_memory(robot: Robot) -> None:
    """Let shared memory outlive the operator's logins, as a deploy does. Raises RuntimeError where that fails."""
    done = robot.inside("sh", "-ec", KEEP_MEMORY)
    if done.status != 0:
        raise RuntimeError(f"logind of {robot.name} was not told to keep shared memory: {done.stderr}")


def lend(robot: Robot) -> None:
    """Let `/opt/lupin/current` be this checkout's environment. Raises RuntimeError where that fails.

    Units have a /tmp of their own, so a checkout below it would be out of their sight: then they share the robot's.
    """
    script = f"mkdir -p {RELEASE}; ln -sfn {sys.prefix} {RELEASE}/venv\n"
    if sys.prefix.startswith(("/tmp/", "/var/tmp/")):
        for unit in UNITS:
            folder = f"/etc/systemd/system/{unit}.d"
            script += f"mkdir -p {folder}; printf '[Service]\\nPrivateTmp=no\\n' > {folder}/checkout.conf\n"
    made = robot.inside("sh", "-ec", script)
    if made.status != 0:
        raise RuntimeError(f"the checkout could not be lent to {robot.name}: {made.stderr}")
