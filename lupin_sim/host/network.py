"""The network between laptop and robots: namespaces, virtual cables, and one bridge per link, where faults are injected."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from lupin_sim.host.namespaces import CLEAN_ENVIRONMENT, hold_new_namespaces
from lupin_sim.host.overlay import LAPTOP_LINKS, NETWORKS, Identity

LAPTOP_KINDS = ("net", "mnt", "ipc", "uts", "pid")
LINK_EMULATOR = Path(__file__).with_name("link_emulator.py")

LinkSettings = Mapping[str, object]  # see link_emulator.py


class NetworkError(Exception):
    """The kernel refused a change to the network."""


class Network:
    """For each link (eth0, wlan0) one bridge, with a port to the laptop and one to each robot.

    The bridges are in their own namespace, so that no fault needs a command on the laptop or on a robot. A cut cable takes
    the carrier from both of its ends. Setting an interface down instead would also remove its routes.
    """

    def __init__(self) -> None:
        self._laptop = hold_new_namespaces(*LAPTOP_KINDS)
        self._bridges = hold_new_namespaces("net")
        for holder in (self._laptop, self._bridges):
            assert holder.stdout is not None
            holder.stdout.readline()
        self.laptop_pid = _first_child(self._laptop.pid)
        # The laptop's namespaces by kind, as open descriptors.
        flags = os.O_RDONLY | os.O_CLOEXEC
        self.laptop = {kind: os.open(f"/proc/{self.laptop_pid}/ns/{kind}", flags) for kind in LAPTOP_KINDS}
        self.run_on_laptop("mount", "-t", "sysfs", "sysfs", "/sys")  # the inherited one shows this machine's interfaces
        self.run_on_laptop("mount", "-t", "tmpfs", "-o", "mode=1777", "tmpfs", "/dev/shm")
        self.run_on_laptop("hostname", "laptop")
        self._cut_ports: set[str] = set()
        self._plugged_ports: set[str] = set()
        self._emulators: dict[str, subprocess.Popen[str]] = {}
        self._settings: dict[str, LinkSettings] = {}
        self._ip(self.laptop_pid, "link", "set", "lo", "up")
        _nsenter(self._bridges.pid, "sh", "-c", "echo 1 > /proc/sys/net/ipv6/conf/all/disable_ipv6")
        for link, network in NETWORKS.items():
            laptop_interface, bridge = LAPTOP_LINKS[link], f"br-{link}"
            mac = f"02:00:00:1{list(NETWORKS).index(link)}:42:02"
            self._ip(self._bridges.pid, "link", "add", bridge, "type", "bridge", "mcast_snooping", "0", "forward_delay", "0")
            self._ip(self._bridges.pid, "link", "set", bridge, "up")
            self._ip(
                *(self._bridges.pid, "link", "add", f"laptop-{link}", "type", "veth"),
                *("peer", "name", laptop_interface, "address", mac, "netns", str(self.laptop_pid)),
            )
            self._ip(self._bridges.pid, "link", "set", f"laptop-{link}", "master", bridge, "up")
            self._ip(self.laptop_pid, "address", "add", f"{network}.2/24", "dev", laptop_interface)
            self._ip(self.laptop_pid, "link", "set", laptop_interface, "up")

    def plug(self, robot: Identity, robot_pid: int) -> None:
        """Create the interfaces in a robot's new network namespace. The faults of its links stay as they were."""
        self._ip(robot_pid, "link", "set", "lo", "up")
        for link in NETWORKS:
            port = self._port(robot, link)
            self._ip(
                self._bridges.pid, "link", "delete", port, check=False
            )  # its peer was removed with the namespace of the previous boot
            self._ip(
                *(self._bridges.pid, "link", "add", port, "type", "veth"),
                *("peer", "name", link, "address", robot.mac(link), "netns", str(robot_pid)),
            )
            self._ip(self._bridges.pid, "link", "set", port, "master", f"br-{link}")
            if port not in self._cut_ports:
                self._ip(self._bridges.pid, "link", "set", port, "up")
            self._plugged_ports.add(port)
            if port in self._emulators:
                self.impair(robot, link, self._settings[port])  # the running emulator holds the deleted port

    def unplug(self, robot: Identity) -> None:
        """Remove the interfaces of a robot that went off, without waiting until the kernel removes its network namespace."""
        for link in NETWORKS:
            port = self._port(robot, link)
            if port in self._plugged_ports:
                self._plugged_ports.discard(port)
                self._ip(self._bridges.pid, "link", "delete", port, check=False)

    def set_cable_cut(self, robot: Identity, link: str, cut: bool) -> None:
        """Unplug or replug a robot's cable. With only one robot on the link, the laptop's end loses its carrier too."""
        port = self._port(robot, link)
        (self._cut_ports.add if cut else self._cut_ports.discard)(port)
        state = "down" if cut else "up"
        self._ip(self._bridges.pid, "link", "set", port, state, check=port in self._plugged_ports)
        if len({name for name in self._plugged_ports if name.endswith(link)}) <= 1:
            self._ip(self._bridges.pid, "link", "set", f"laptop-{link}", state)

    def set_switch_dead(self, link: str, dead: bool) -> None:
        """Stop or start the bridge of a link: both ends keep their carrier, and no frame passes."""
        self._ip(self._bridges.pid, "link", "set", f"br-{link}", "down" if dead else "up")

    def impair(self, robot: Identity, link: str, settings: LinkSettings | None) -> None:
        """Put a link emulator with these settings into a robot's link, or remove it (None). Raises NetworkError."""
        port = self._port(robot, link)
        inner = f"{port}-p"
        if old := self._emulators.pop(port, None):
            old.kill()
            old.wait()
            self._ip(self._bridges.pid, "link", "delete", inner, check=False)
            self._ip(self._bridges.pid, "link", "set", port, "master", f"br-{link}", check=port in self._plugged_ports)
        if settings is None:
            return
        # The emulator connects the robot's port with one end of a veth pair; the other end is on the bridge.
        self._ip(self._bridges.pid, "link", "add", inner, "type", "veth", "peer", "name", f"{inner}b")
        self._ip(self._bridges.pid, "link", "set", f"{inner}b", "master", f"br-{link}", "up")
        self._ip(self._bridges.pid, "link", "set", inner, "up")
        self._ip(self._bridges.pid, "link", "set", port, "nomaster")
        enter = ["nsenter", "--target", str(self._bridges.pid), "--net", "--", sys.executable, "-I", str(LINK_EMULATOR)]
        emulator = subprocess.Popen(
            [*enter, port, inner, json.dumps(settings)], env=CLEAN_ENVIRONMENT, stdout=subprocess.PIPE, text=True
        )
        assert emulator.stdout is not None
        if emulator.stdout.readline() != "running\n":
            raise NetworkError(f"the link emulator on {port} exited with status {emulator.wait()}")
        self._emulators[port], self._settings[port] = emulator, settings

    def set_laptop_away(self, link: str, away: bool) -> None:
        """Take the laptop off a network, without address and route as after a WiFi roam, or bring it back."""
        interface = LAPTOP_LINKS[link]
        if away:
            self._ip(self.laptop_pid, "address", "flush", "dev", interface)
        else:
            self._ip(self.laptop_pid, "address", "replace", f"{NETWORKS[link]}.2/24", "dev", interface)

    def run_on_laptop(self, *command: str) -> None:
        """Run a command with the laptop's mounts, network and host name. Raises NetworkError."""
        _nsenter(self.laptop_pid, *command)

    def _port(self, robot: Identity, link: str) -> str:
        """Return the name of the bridge's port to a robot."""
        return f"r{robot.index}-{link}"

    def _ip(self, pid: int, *arguments: str, check: bool = True) -> None:
        """Run ip(8) in the network namespace of a process. Raises NetworkError unless `check` is False."""
        _run(["nsenter", "--target", str(pid), "--net", "--", "ip", *arguments], check)


def _nsenter(pid: int, *command: str) -> None:
    _run(["nsenter", "--target", str(pid), "--mount", "--net", "--uts", "--", *command], True)


def _first_child(pid: int) -> int:
    return int(Path(f"/proc/{pid}/task/{pid}/children").read_text().split()[0])


def _run(command: list[str], check: bool) -> None:
    done = subprocess.run(command, env=CLEAN_ENVIRONMENT, capture_output=True, text=True, timeout=20, check=False)
    if check and done.returncode:
        raise NetworkError(f"{' '.join(command[command.index('--') + 1 :])}: {done.stderr.strip()}")
