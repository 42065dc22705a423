"""The overlay on the bare Debian: the vendor's files, SSH keys, and one robot's name and addresses."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lupin_sim.host.clock import clock_library
from lupin_sim.host.rootfs import cache_directory

IMAGE = Path(__file__).with_name("image")
MIRTE_UID = 1000
EXECUTABLE, SECRET, SUDOERS = 0o755, 0o600, 0o440
HOST_KEYS = ("ed25519", "ecdsa", "rsa")
WANTS_FOLDER = "etc/systemd/system/multi-user.target.wants"
ENABLED = ("mirte-ros", "mirte-ap", "mirte-wifi-watchdog", "mirte-web-interface", "mirte-jupyter")


@dataclass(frozen=True)
class Identity:
    """The number of a robot, from 0, with the name and addresses that follow from it."""

    index: int

    @property
    def name(self) -> str:
        """The host name."""
        return "mirte" if self.index == 0 else f"mirte-{self.index + 1}"

    @property
    def last_byte(self) -> int:
        """The last byte of all its addresses: 1 for the first robot, then 11, 12, ...; the laptop has 2."""
        return 1 if self.index == 0 else 10 + self.index

    def address(self, link: str) -> str:
        """Return the IPv4 address on eth0 or wlan0."""
        return f"{NETWORKS[link]}.{self.last_byte}"

    def mac(self, link: str) -> str:
        """Return the MAC address. It is fixed, so that the laptop's neighbor entry outlives a reboot as with a real robot."""
        return f"02:00:00:0{list(NETWORKS).index(link)}:42:{self.last_byte:02x}"

    @property
    def machine_id(self) -> str:
        """The content of /etc/machine-id."""
        return f"4d69727465{self.index:022x}"


NETWORKS = {"eth0": "10.42.0", "wlan0": "192.168.42"}
LAPTOP_LINKS = {"eth0": "lan0", "wlan0": "wifi0"}


def ssh_keys() -> Path:
    """Return the folder with the robots' host keys and the private key that mirte accepts. They are generated once."""
    folder = cache_directory() / "keys"
    if not folder.is_dir():
        folder.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(
            tempfile.mkdtemp(prefix=".keys-", dir=folder.parent)
        )  # random: every daemon has PID 1 in its own namespace
        for name, kind in (("id_ed25519", "ed25519"), *((f"ssh_host_{kind}_key", kind) for kind in HOST_KEYS)):
            command = ["ssh-keygen", "-q", "-t", kind, "-N", "", "-C", "lupin-host", "-f", str(draft / name)]
            subprocess.run(command, check=True, timeout=60, stdin=subprocess.DEVNULL)
        try:
            draft.rename(folder)
        except OSError:  # another process was faster; use its keys
            shutil.rmtree(draft)
    return folder


def known_hosts(robots: Sequence[Identity]) -> str:
    """Return the lines of a known_hosts file with the host keys of all robots."""
    lines = []
    for robot in robots:
        for kind in HOST_KEYS:
            public = (ssh_keys() / f"ssh_host_{kind}_key.pub").read_text().split()[:2]
            lines.append(f"{','.join(robot.address(link) for link in NETWORKS)} {' '.join(public)}\n")
    return "".join(lines)


def write_overlay(target: Path, robot: Identity, clock: bool) -> None:
    """Write the overlay of one robot into an empty folder, with the owners and modes that the files have on a robot."""
    shutil.copytree(IMAGE, target, dirs_exist_ok=True)
    for path in (target, *target.rglob("*")):
        mirte = path.is_relative_to(target / "home/mirte")
        os.chown(path, MIRTE_UID if mirte else 0, MIRTE_UID if mirte else 0)
        executable = path.is_dir() or (not path.is_symlink() and path.read_bytes().startswith(b"#!"))
        path.chmod(EXECUTABLE if executable else 0o644)

    write_file(target / "etc/sudoers.d/mirte", "mirte ALL=(ALL) NOPASSWD:ALL\n", SUDOERS)
    write_name(target, robot)
    write_file(target / "etc/mirte/ap-address", f"{robot.address('wlan0')}/24\n")
    eth0 = (target / "etc/systemd/network/10-eth0.network").read_text()
    write_file(target / "etc/systemd/network/10-eth0.network", eth0.replace("ADDRESS", robot.address("eth0")))
    if clock:
        write_clock(target)
    (target / WANTS_FOLDER).mkdir(parents=True, exist_ok=True)
    for unit in ENABLED:
        (target / WANTS_FOLDER / f"{unit}.service").symlink_to(f"/etc/systemd/system/{unit}.service")

    # The server has the Fast DDS version of the robot's processes, which cannot use shared-memory segments of another version.
    libraries = f"{sys.prefix}/lib:{sysconfig.get_paths()['purelib']}/ros_fastrtps.libs"
    server = f'LD_LIBRARY_PATH={libraries} exec {sys.prefix}/bin/fast-discovery-server "$@"'
    write_file(target / "usr/bin/fast-discovery-server", f"#!/bin/sh\n{server}\n", EXECUTABLE)

    secrets = ssh_keys()
    for kind in HOST_KEYS:
        write_file(target / f"etc/ssh/ssh_host_{kind}_key", (secrets / f"ssh_host_{kind}_key").read_text(), SECRET)
        write_file(target / f"etc/ssh/ssh_host_{kind}_key.pub", (secrets / f"ssh_host_{kind}_key.pub").read_text())
    authorized = target / "home/mirte/.ssh/authorized_keys"
    write_file(authorized, (secrets / "id_ed25519.pub").read_text(), SECRET)
    authorized.parent.chmod(0o700)
    for path in (authorized.parent, authorized):
        os.chown(path, MIRTE_UID, MIRTE_UID)


def write_name(target: Path, computer: Identity) -> None:
    """Write a computer's name, and let its users traverse /root, below which a bind-mounted Python may be installed."""
    write_file(target / "etc/hostname", f"{computer.name}\n")
    write_file(target / "etc/hosts", f"127.0.0.1 localhost\n127.0.1.1 {computer.name}\n")
    write_file(target / "etc/machine-id", f"{computer.machine_id}\n", 0o444)
    (target / "root").mkdir(exist_ok=True)
    (target / "root").chmod(0o711)


def write_clock(target: Path) -> None:
    """Write the library that gives a computer its own wall clock."""
    write_file(target / "etc/ld.so.preload", "/usr/lib/lupin-clock.so\n")
    (target / "usr/lib").mkdir(parents=True, exist_ok=True)
    shutil.copy(clock_library(), target / "usr/lib/lupin-clock.so")


def write_file(path: Path, text: str, mode: int = 0o644) -> None:
    """Write a file of the overlay with this mode, and the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(mode)
