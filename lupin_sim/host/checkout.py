"""Lets a simulated robot run Lupin's units from this checkout, without a deploy.

Does what a deploy would do: links this checkout's virtual environment as the current release, and configures logind.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lupin_sim.host.host import Robot

CURRENT_RELEASE = "/opt/lupin/current"
UNIT_DROP_IN = "/etc/systemd/system/lupin-.service.d/checkout.conf"  # of every unit whose name begins with lupin-
# Shell lines to run before a Lupin program. None sources /opt/ros: the simulated computer has only the vendor's workspace.
SETUP_LINES = ("source ~/.mirte_settings.sh", "source ~/mirte_ws/install/setup.bash")
LOGIND_CONFIG = "/etc/systemd/logind.conf.d/60-lupin.conf"
RELOAD_LOGIND = "systemctl kill -s HUP systemd-logind"
MAKE_LOGIND_KEEP_SHM = (
    f"mkdir -p {LOGIND_CONFIG.rpartition('/')[0]}; printf '[Login]\\nRemoveIPC=no\\n' > {LOGIND_CONFIG}; {RELOAD_LOGIND}"
)
LET_LOGIND_REMOVE_SHM = f"rm -f {LOGIND_CONFIG}; {RELOAD_LOGIND}"


def keep_shared_memory(robot: Robot) -> None:
    """Configure logind as a deploy does, so shared memory outlives the operator's logins. Raises RuntimeError on failure."""
    done = robot.run_as_root("sh", "-ec", MAKE_LOGIND_KEEP_SHM)
    if done.status != 0:
        raise RuntimeError(f"logind of {robot.name} was not configured to keep shared memory: {done.stderr}")


def link_checkout(robot: Robot) -> None:
    """Link `/opt/lupin/current/venv` on the robot to this checkout's virtual environment. Raises RuntimeError on failure.

    The robot sees environment and checkout at the same path, because this machine's folders are mounted there. The checkout
    comes first, as the environment may be another one's. The units do not verify it, since it is no signed release. They have a
    private /tmp, which would hide a checkout below /tmp; in that case they use the robot's /tmp instead.
    """
    from lupin_sim.host.host import PROJECT

    private = "PrivateTmp=no\\n" if sys.prefix.startswith(("/tmp/", "/var/tmp/")) else ""
    folder = UNIT_DROP_IN.rpartition("/")[0]
    script = f"""mkdir -p {CURRENT_RELEASE} {folder}; ln -sfn {sys.prefix} {CURRENT_RELEASE}/venv
printf '[Service]\\nExecStartPre=\\nEnvironment=PYTHONPATH={PROJECT}\\n{private}' > {UNIT_DROP_IN}
"""
    done = robot.run_as_root("sh", "-ec", script)
    if done.status != 0:
        raise RuntimeError(f"the checkout could not be linked on {robot.name}: {done.stderr}")
