"""An operator's home on the laptop of a booted host: keys, accepted host keys, and the inventory with its robot."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lupin_sim.host.host import Host


def off_graph() -> dict[str, str]:
    """This process's environment without what would put a program of the laptop on this process's own graph."""
    prefixes = ("ROS_", "RMW_", "FASTRTPS_", "FASTDDS_")
    return {name: value for name, value in os.environ.items() if not name.startswith(prefixes)}


def furnish(host: Host, home: Path, set_up: tuple[str, ...] = ()) -> dict[str, str]:
    """Fill `home`; the environment that makes lupin use it. The robot is called `mirte`."""
    ssh, config = home / ".ssh", home / ".config" / "lupin"
    ssh.mkdir(parents=True, mode=0o700)
    config.mkdir(parents=True)
    (ssh / "config").write_text(f"Host *\n  IdentityFile {host.key}\n  IdentitiesOnly yes\n")
    (ssh / "known_hosts").write_text(host.known_hosts.read_text())
    lines = ", ".join(f'"{line}"' for line in set_up)
    inventory = (
        f'[robots.mirte]\nuser = "mirte"\nros_setup = [{lines}]\n\n[robots.mirte.addresses]\nwired = "{host.robot.eth0}"\n'
    )
    (config / "lupin.toml").write_text(inventory)
    return {"HOME": str(home), "XDG_CONFIG_HOME": str(home / ".config"), "XDG_STATE_HOME": str(home / "state")}
