"""The cables: a namespace between laptop and robots with one bridge a link, where they are cut."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from lupin_sim.host.layer import LAPTOP_LINKS, NETWORKS, Identity
from lupin_sim.host.namespaces import CLEAN_ENVIRONMENT, new_namespaces

LAPTOP_KINDS = ("net", "mnt", "ipc", "uts", "pid")
PUMP = Path(__file__).with_name("pump.py")


class WireError(Exception):
    """The kernel refused a link."""


class Wire:
    """One segment a link: the laptop's port, a bridge, and a port for each robot.

    A cut cable takes the carrier from both of its ends; setting an end down would not, since routes vanish with it.
    """

    def __init__(self) -> None:
        self._laptop = new_namespaces(*LAPTOP_KINDS)
        self._wire = new_namespaces("net")
        for holder in (self._laptop, self._wire):
            assert holder.stdout is not None
            holder.stdout.readline()
        self.laptop_pid = _first_child(self._laptop.pid)
        # Open descriptors of the namespaces that are the laptop.
        flags = os.O_RDONLY | os.O_CLOEXEC
        self.laptop = {kind: os.open(f"/proc/{self.laptop_pid}/ns/{kind}", flags) for kind in LAPTOP_KINDS}
        self._in(self.laptop_pid, "mount", "-t", "sysfs", "sysfs", "/sys")  # else it shows this machine's interfaces
        self._in(self.laptop_pid, "mount", "-t", "tmpfs", "-o", "mode=1777", "tmpfs", "/dev/shm")
        self._in(self.laptop_pid, "hostname", "laptop")
        self._cut: set[str] = set()
        self._pumps: dict[str, subprocess.Popen[str]] = {}
        self._settings: dict[str, Mapping[str, float | bool]] = {}
        self._robots: set[str] = set()
        self._ip(self.laptop_pid, "link", "set", "lo", "up")
        self._in(self._wire.pid, "sh", "-c", "echo 1 > /proc/sys/net/ipv6/conf/all/disable_ipv6")
        for link, network in NETWORKS.items():
            end, bridge = LAPTOP_LINKS[link], f"br-{link}"
            mac = f"02:00:00:1{list(NETWORKS).index(link)}:42:02"
            self._ip(self._wire.pid, "link", "add", bridge, "type", "bridge", "mcast_snooping", "0", "forward_delay", "0")
            self._ip(self._wire.pid, "link", "set", bridge, "up")
            self._ip(
                *(self._wire.pid, "link", "add", f"laptop-{link}", "type", "veth"),
                *("peer", "name", end, "address", mac, "netns", str(self.laptop_pid)),
            )
            self._ip(self._wire.pid, "link", "set", f"laptop-{link}", "master", bridge, "up")
            self._ip(self.laptop_pid, "address", "add", f"{network}.2/24", "dev", end)
            self._ip(self.laptop_pid, "link", "set", end, "up")

    def plug(self, robot: Identity, robot_pid: int) -> None:
        """Give a robot's new network namespace its interfaces, at the end of cables that are as they were."""
        self._ip(robot_pid, "link", "set", "lo", "up")
        for link in NETWORKS:
            port = self._port(robot, link)
            self._ip(self._wire.pid, "link", "delete", port, check=False)  # its other end went with the last boot
            self._ip(
                *(self._wire.pid, "link", "add", port, "type", "veth"),
                *("peer", "name", link, "address", robot.mac(link), "netns", str(robot_pid)),
            )
            self._ip(self._wire.pid, "link", "set", port, "master", f"br-{link}")
            if port not in self._cut:
                self._ip(self._wire.pid, "link", "set", port, "up")
            self._robots.add(port)
            if port in self._pumps:
                self.impair(robot, link, self._settings[port])  # the pump's end went with the old port

    def unplug(self, robot: Identity) -> None:
        """A robot went off: its interfaces are gone at once, while the kernel takes its time over a namespace that ended."""
        for link in NETWORKS:
            port = self._port(robot, link)
            if port in self._robots:
                self._robots.discard(port)
                self._ip(self._wire.pid, "link", "delete", port, check=False)

    def cut(self, robot: Identity, link: str, is_cut: bool) -> None:
        """Pull a robot's cable, or plug it in again. With one robot on the wire the laptop's end loses its carrier too."""
        port = self._port(robot, link)
        (self._cut.add if is_cut else self._cut.discard)(port)
        state = "down" if is_cut else "up"
        self._ip(self._wire.pid, "link", "set", port, state, check=port in self._robots)
        if len({name for name in self._robots if name.endswith(link)}) <= 1:
            self._ip(self._wire.pid, "link", "set", f"laptop-{link}", state)

    def switch(self, link: str, dead: bool) -> None:
        """The switch between dies: both ends keep their carrier, and nothing passes."""
        self._ip(self._wire.pid, "link", "set", f"br-{link}", "down" if dead else "up")

    def impair(self, robot: Identity, link: str, settings: Mapping[str, float | bool] | None) -> None:
        """Put a frame pump into a robot's cable, or take it out (None). See pump.py for the settings."""
        port = self._port(robot, link)
        inner = f"{port}-p"
        if old := self._pumps.pop(port, None):
            old.kill()
            old.wait()
            self._ip(self._wire.pid, "link", "delete", inner, check=False)
            self._ip(self._wire.pid, "link", "set", port, "master", f"br-{link}", check=port in self._robots)
        if settings is None:
            return
        # The pump stands between the robot's port and a pair of its own whose other end is on the bridge.
        self._ip(self._wire.pid, "link", "add", inner, "type", "veth", "peer", "name", f"{inner}b")
        self._ip(self._wire.pid, "link", "set", f"{inner}b", "master", f"br-{link}", "up")
        self._ip(self._wire.pid, "link", "set", inner, "up")
        self._ip(self._wire.pid, "link", "set", port, "nomaster")
        enter = ["nsenter", "--target", str(self._wire.pid), "--net", "--", sys.executable, "-I", str(PUMP)]
        pump = subprocess.Popen(
            [*enter, port, inner, json.dumps(settings)], env=CLEAN_ENVIRONMENT, stdout=subprocess.PIPE, text=True
        )
        assert pump.stdout is not None
        if pump.stdout.readline() != "pumping\n":
            raise WireError(f"the frame pump on {port} ended with {pump.wait()}")
        self._pumps[port], self._settings[port] = pump, settings

    def laptop_link(self, link: str, away: bool) -> None:
        """The laptop leaves a network: no address and no route there any more, as after a roam; or it is back."""
        end = LAPTOP_LINKS[link]
        if away:
            self._ip(self.laptop_pid, "address", "flush", "dev", end)
        else:
            self._ip(self.laptop_pid, "address", "replace", f"{NETWORKS[link]}.2/24", "dev", end)

    def in_laptop(self, *command: str) -> None:
        """Run a command where the laptop's mounts and network are. Raises WireError."""
        self._in(self.laptop_pid, *command)

    def _port(self, robot: Identity, link: str) -> str:
        return f"r{robot.index}-{link}"

    def _in(self, pid: int, *command: str) -> None:
        _run(["nsenter", "--target", str(pid), "--mount", "--net", "--uts", "--", *command], True)

    def _ip(self, pid: int, *arguments: str, check: bool = True) -> None:
        _run(["nsenter", "--target", str(pid), "--net", "--", "ip", *arguments], check)


def _first_child(pid: int) -> int:
    return int(Path(f"/proc/{pid}/task/{pid}/children").read_text().split()[0])


def _run(command: list[str], check: bool) -> None:
    done = subprocess.run(command, env=CLEAN_ENVIRONMENT, capture_output=True, text=True, timeout=20, check=False)
    if check and done.returncode:
        raise WireError(f"{' '.join(command[command.index('--') + 1 :])}: {done.stderr.strip()}")
