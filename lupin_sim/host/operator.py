"""The operator's home directory on the simulated laptop: SSH key, known host keys, and an inventory with the robot."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lupin_sim.host.host import Host


def environment_without_ros() -> dict[str, str]:
    """Return this process's environment without ROS and DDS variables, which would connect a program to its ROS graph."""
    prefixes = ("ROS_", "RMW_", "FASTRTPS_", "FASTDDS_")
    return {name: value for name, value in os.environ.items() if not name.startswith(prefixes)}


def create_home(host: Host, home: Path, setup_lines: tuple[str, ...] = ()) -> dict[str, str]:
    """Create the operator's home directory; its inventory has one robot, `mirte`. Returns the environment that selects it.

    `setup_lines` become the robot's `ros_setup` in the inventory.
    """
    ssh, config = home / ".ssh", home / ".config" / "lupin"
    ssh.mkdir(parents=True, mode=0o700)
    config.mkdir(parents=True)
    (ssh / "config").write_text(f"Host *\n  IdentityFile {host.key}\n  IdentitiesOnly yes\n")
    (ssh / "known_hosts").write_text(host.known_hosts.read_text())
    lines = ", ".join(f'"{line}"' for line in setup_lines)
    inventory = (
        f'[robots.mirte]\nuser = "mirte"\nros_setup = [{lines}]\n\n[robots.mirte.addresses]\nwired = "{host.robot.eth0}"\n'
    )
    (config / "lupin.toml").write_text(inventory)
    return {"HOME": str(home), "XDG_CONFIG_HOME": str(home / ".config"), "XDG_STATE_HOME": str(home / "state")}
