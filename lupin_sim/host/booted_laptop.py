"""A laptop that boots: with its own systemd, disk, chrony and account, in the network namespace of the host's laptop.

Commands that configure the laptop itself can be rehearsed on it, without a change to this machine.
"""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from lupin_sim.host.computer import ComputerError, Hardware, HostFiles, NspawnComputer
from lupin_sim.host.network import Network
from lupin_sim.host.overlay import SECRET, SUDOERS, Identity, known_hosts, ssh_keys, write_clock, write_file, write_name

ACCOUNT, UID = "student", 1001
HOME = Path("/home") / ACCOUNT
START_TIMEOUT_S = 10.0
ENVIRONMENT = {
    "HOME": str(HOME),
    "USER": ACCOUNT,
    "LOGNAME": ACCOUNT,
    "SHELL": "/bin/bash",
    "PATH": "/usr/local/bin:/usr/bin:/bin:/usr/local/sbin:/usr/sbin:/sbin",
    "LANG": "C.UTF-8",
}


class LaptopIdentity(Identity):
    """Its name; its addresses are those of the host's laptop."""

    @property
    def name(self) -> str:
        """The host name."""
        return "laptop"

    @property
    def machine_id(self) -> str:
        """The content of /etc/machine-id."""
        return f"4c6170746f70{self.index:020x}"


class BootedLaptop(NspawnComputer):
    """The laptop as a computer that boots. Faults of its cables are those of the network namespace that it shares."""

    def __init__(self, robots: Sequence[Identity], hardware: Hardware, files: HostFiles, network: Network) -> None:
        self._robots = robots
        super().__init__(LaptopIdentity(0), hardware, files, network)

    def open_namespaces(self) -> dict[str, int]:
        """Return open descriptors of its namespaces by kind, also if it has just been switched on. Raises ComputerError."""
        deadline = time.monotonic() + START_TIMEOUT_S
        while True:
            try:
                return super().open_namespaces()
            except ComputerError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.02)

    def _write_overlay(self, folder: Path) -> None:
        write_laptop_overlay(folder, self._root, self.identity, self._robots)

    def _network_command(self) -> list[str]:
        return ["nsenter", f"--net=/proc/{self._network.laptop_pid}/ns/net", "--", "unshare"]

    def _plug(self, pid: int) -> None:
        """Its interfaces exist before it boots, and after it is off."""

    def _unplug(self) -> None:
        """See `_plug`."""


def write_laptop_overlay(target: Path, root: Path, identity: Identity, robots: Sequence[Identity]) -> None:
    """Write the laptop's account, which reaches all robots, with `lupin` on its PATH, and its name and clock."""
    write_name(target, identity)
    write_clock(target)
    for name, line in (
        ("passwd", f"{ACCOUNT}:x:{UID}:{UID}::{HOME}:/bin/bash"),
        ("group", f"{ACCOUNT}:x:{UID}:"),
        ("shadow", f"{ACCOUNT}:*:19000:0:99999:7:::"),
    ):
        path = root / "etc" / name
        write_file(target / "etc" / name, f"{path.read_text().rstrip()}\n{line}\n", path.stat().st_mode & 0o777)
        os.chown(target / "etc" / name, path.stat().st_uid, path.stat().st_gid)
    write_file(target / f"etc/sudoers.d/{ACCOUNT}", f"{ACCOUNT} ALL=(ALL) NOPASSWD:ALL\n", SUDOERS)
    units = target / "etc/systemd/system"
    units.mkdir(parents=True, exist_ok=True)
    (units / "ssh.service").symlink_to("/dev/null")  # nobody logs in on the laptop, so it has no host keys
    programs = target / "usr/local/bin"
    programs.mkdir(parents=True, exist_ok=True)
    (programs / "lupin").symlink_to(Path(sys.prefix) / "bin" / "lupin")

    home = target / HOME.relative_to("/")
    shutil.copytree(root / "etc/skel", home)
    keys = ssh_keys()
    write_file(home / ".ssh/id_ed25519", (keys / "id_ed25519").read_text(), SECRET)
    write_file(home / ".ssh/known_hosts", known_hosts(robots))
    tables = [
        f'[robots.{robot.name}]\nuser = "mirte"\n\n[robots.{robot.name}.addresses]\n'
        + "".join(f'{way} = "{robot.address(link)}"\n' for way, link in (("wired", "eth0"), ("ap", "wlan0")))
        for robot in robots
    ]
    write_file(home / ".config/lupin/lupin.toml", "\n".join(tables))
    for path in (home, *home.rglob("*")):
        os.chown(path, UID, UID)
    (home / ".ssh").chmod(0o700)


def in_new_terminal(command: Sequence[str]) -> list[str]:
    """Return the command that runs another one with the DDS environment that a terminal opened now would have."""
    source = "[ ! -r ~/.config/lupin/ros-env.sh ] || . ~/.config/lupin/ros-env.sh"
    return ["bash", "-c", f'{source}; exec "$@"', "bash", *command]


def as_account(command: Sequence[str], env: Mapping[str, str] | None) -> list[str]:
    """Return the command that runs another one as the laptop's account, with its environment and `env`."""
    variables = [f"{name}={value}" for name, value in {**ENVIRONMENT, **(env or {})}.items()]
    return ["runuser", "-u", ACCOUNT, "--", "env", "-i", *variables, *command]
