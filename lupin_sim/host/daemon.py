"""The daemon of a host: it owns the network and the simulated computers, and serves requests on a Unix socket.

It is the first process of its own PID and mount namespaces: when it exits, even by SIGKILL, the kernel kills everything that it
started. It exits on a request or on SIGTERM; with the setting `lifeline`, also when its standard input is closed, that is, when
the process that started it exits.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lupin_runtime.json_text import parse_json
from lupin_sim.host.booted_laptop import BootedLaptop
from lupin_sim.host.computer import Computer, ComputerError, Hardware, HostFiles, NspawnComputer, mount
from lupin_sim.host.fault_injector import FaultError, FaultInjector
from lupin_sim.host.faults import FAULTS
from lupin_sim.host.network import Network, NetworkError
from lupin_sim.host.overlay import Identity
from lupin_sim.host.state import CGROUP, remove_cgroups

Message = dict[str, Any]
REQUEST_LIMIT = 1 << 20


class Daemon:
    """Handles requests, one per connection: {"do": verb, ...} -> {"value": ...} or {"error": "..."}."""

    def __init__(self, folder: Path, root: Path, robots: int, hardware: Hardware, *, boot_laptop: bool = False) -> None:
        self._folder = folder
        private = mount_private_folder(folder)
        self.network = Network()
        self.computers: list[Computer] = []
        for index in range(robots):
            robot = Identity(index)
            console = folder / f"{robot.name}.console"
            files = HostFiles(private / f"robot-{index}", root, console, f"{CGROUP}-{folder.name}")
            self.computers.append(NspawnComputer(robot, hardware, files, self.network))
        self.laptop: BootedLaptop | None = None
        if boot_laptop:
            files = HostFiles(private / "laptop", root, folder / "laptop.console", f"{CGROUP}-{folder.name}")
            identities = [computer.identity for computer in self.computers]
            self.laptop = BootedLaptop(identities, Hardware(binds=hardware.binds), files, self.network)
        self.injector = FaultInjector(FAULTS, self.network, self.computers, root, folder)
        self._lock = threading.Lock()  # held by requests that change something; `run_as_root` and `status` do not need it
        self.stop_requested = threading.Event()
        self._verbs: dict[str, Callable[[Message], Any]] = {
            "status": self._status,
            "on": lambda request: self._computer(request).power_on(),
            "off": lambda request: self._computer(request).power_off(),
            "cut": lambda request: self._computer(request).power_cut(),
            "reset": self._reset,
            "fault": self._fault,
            "ntp": lambda request: self.injector.serve_ntp(request["mode"]),
            "end": lambda _: self.stop_requested.set(),
        }

    def handle(self, connection: socket.socket) -> None:
        """Read one request from a connection and send the reply."""
        with connection:
            connection.settimeout(120.0)
            try:
                line = connection.makefile("rb").readline(REQUEST_LIMIT)
                request = parse_json(line)
                verb = request["do"]
                if verb == "laptop":
                    self._send_laptop(connection)
                    return
                if verb == "run_as_root":
                    reply: Message = {"value": self._run_as_root(request)}
                elif verb == "status":
                    reply = {"value": self._status(request)}
                else:
                    with self._lock:
                        reply = {"value": self._verbs[verb](request)}
            except (ComputerError, NetworkError, FaultError) as error:
                reply = {"error": str(error)}
            except OSError as error:
                reply = {"error": f"{type(error).__name__}: {error}"}
            except (ValueError, KeyError, TypeError) as error:
                reply = {"error": f"invalid request: {error!r}"}
            try:
                connection.sendall(json.dumps(reply).encode() + b"\n")
            except OSError:
                return  # the client has disconnected

    def close(self) -> None:
        """Cut the power of all robots and remove the host's cgroups."""
        for computer in filter(None, [*self.computers, self.laptop]):
            try:
                computer.power_cut()
            except ComputerError as error:
                print(error, file=sys.stderr)
        remove_cgroups(self._folder.name)

    def _computer(self, request: Message) -> Computer:
        return self.computers[int(request.get("robot", 0))]

    def _run_as_root(self, request: Message) -> list[Any]:
        done = self._computer(request).run_as_root(
            request["command"], request.get("stdin", ""), float(request.get("timeout_s", 20.0))
        )
        return [done.status, done.stdout, done.stderr]

    def _reset(self, request: Message) -> None:
        """Reboot a robot with a new disk, a correct clock and no faults."""
        computer = self._computer(request)
        self.injector.prepare_reset(computer)
        computer.power_cut()
        computer.wipe()
        computer.power_on()

    def _fault(self, request: Message) -> None:
        action = self.injector.undo if request.get("undo") else self.injector.inject
        action(self._computer(request), request["name"], request.get("settings", {}))

    def _status(self, _: Message) -> Message:
        robots = [
            {
                "name": computer.identity.name,
                "eth0": computer.identity.address("eth0"),
                "wlan0": computer.identity.address("wlan0"),
                "running": computer.running,
                "boots": computer.boots,
                "clock_offset_s": computer.clock.offset_s,
                "clock_crystal_ppm": computer.clock.crystal_ppm,
                "clock_steps": computer.clock.steps,
                "disk_used_mb": computer.disk_used_mb(),
                "faults": sorted(self.injector.active_faults(computer)),
            }
            for computer in self.computers
        ]
        return {"robots": robots, "ntp": self.injector.ntp_mode, "laptop_boots": self.laptop is not None}

    def _send_laptop(self, connection: socket.socket) -> None:
        """Send the laptop's namespaces as open descriptors: PIDs of this namespace have no meaning outside it."""
        namespaces = self.network.laptop if self.laptop is None else self.laptop.open_namespaces()
        message = json.dumps({"value": list(namespaces)}).encode() + b"\n"
        try:
            socket.send_fds(connection, [message], list(namespaces.values()))
        finally:
            if self.laptop is not None:
                for fd in namespaces.values():
                    os.close(fd)


def main() -> int:
    """Run the daemon of one host until it is asked to stop."""
    parser = argparse.ArgumentParser(prog="python -m lupin_sim.host.daemon")
    parser.add_argument("folder", type=Path)
    parser.add_argument("root", type=Path)
    parser.add_argument("settings", type=json.loads)
    arguments = parser.parse_args()
    hardware = Hardware(**{**arguments.settings["hardware"], "binds": tuple(arguments.settings["hardware"].get("binds", ()))})
    folder: Path = arguments.folder
    os.umask(0o022)

    stop_requested = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop_requested.set())
    daemon: Daemon | None = None
    server = socket.socket(socket.AF_UNIX)
    try:
        boot_laptop = bool(arguments.settings["boot_laptop"])
        daemon = Daemon(folder, arguments.root, int(arguments.settings["robots"]), hardware, boot_laptop=boot_laptop)
        daemon.stop_requested = stop_requested
        for computer in filter(None, [*daemon.computers, daemon.laptop]):
            computer.power_on()
        server.bind(str(folder / "control"))
        server.listen(64)
        threading.Thread(target=_serve, args=(server, daemon), daemon=True).start()
        if arguments.settings["lifeline"]:
            threading.Thread(target=_watch_lifeline, args=(stop_requested,), daemon=True).start()
        print("up", flush=True)
        while not stop_requested.wait(60.0):
            pass
        return 0
    except (ComputerError, NetworkError, OSError) as error:
        print(f"error: {error}", flush=True)
        return 1
    finally:
        server.close()
        if daemon is not None:
            daemon.close()


def mount_private_folder(folder: Path) -> Path:
    """Mount a tmpfs that only this mount namespace sees, and another on /run/systemd for nspawn's locks. Returns the first."""
    private = folder / "private"
    private.mkdir()
    mount("-t", "tmpfs", "-o", "mode=755,size=256M", "tmpfs", str(private))
    Path("/run/systemd").mkdir(exist_ok=True)
    mount("-t", "tmpfs", "-o", "mode=755,size=16M", "tmpfs", "/run/systemd")
    return private


def _serve(server: socket.socket, daemon: Daemon) -> None:
    while True:
        try:
            connection, _ = server.accept()
        except OSError:
            return
        threading.Thread(target=daemon.handle, args=(connection,), daemon=True).start()


def _watch_lifeline(stop_requested: threading.Event) -> None:
    """Stop the daemon when its standard input is closed."""
    while os.read(0, 4096):
        pass
    stop_requested.set()


if __name__ == "__main__":
    sys.exit(main())
