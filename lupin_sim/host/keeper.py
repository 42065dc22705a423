"""The process that is the power supply: it holds the cables and the robots, and everything ends with it.

It is the first process of its own PID and mount namespaces. It ends when its standard input does (the test that started it is
gone, however that happened), at a request, or at SIGTERM; killed, the kernel takes all of it down.
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

from lupin_sim.host.bench import Bench, FaultError
from lupin_sim.host.faults import FAULTS
from lupin_sim.host.layer import Identity
from lupin_sim.host.machine import Hardware, Machine, MachineError, NspawnMachine, mount
from lupin_sim.host.state import CGROUP, remove_cgroups
from lupin_sim.host.wire import Wire, WireError

Reply = dict[str, Any]
REQUEST_LIMIT = 1 << 20


class Keeper:
    """Answers requests, one a connection: {"do": verb, ...} -> {"value": ...} or {"error": "..."}."""

    def __init__(self, folder: Path, root: Path, robots: int, hardware: Hardware) -> None:
        self._folder = folder
        inner = private_folder(folder)
        self.wire = Wire()
        self.machines: list[Machine] = []
        for index in range(robots):
            robot = Identity(index)
            machine = NspawnMachine(
                *(inner / f"robot-{index}", root, robot, hardware, folder / f"{robot.name}.console"),
                plug=lambda pid, robot=robot: self.wire.plug(robot, pid),  # type: ignore[misc]
                unplug=lambda robot=robot: self.wire.unplug(robot),  # type: ignore[misc]
                cgroup=f"{CGROUP}-{folder.name}",
            )
            self.machines.append(machine)
        self.bench = Bench(FAULTS, self.wire, self.machines, root, folder)
        self._lock = threading.Lock()  # one change at a time; looking needs none
        self.ended = threading.Event()
        self._verbs: dict[str, Callable[[Reply], Any]] = {
            "status": self._status,
            "on": lambda request: self._machine(request).power_on(),
            "off": lambda request: self._machine(request).power_off(),
            "cut": lambda request: self._machine(request).power_cut(),
            "renew": self._renew,
            "fault": self._fault,
            "ntp": lambda request: self.bench.serve_ntp(request["mode"]),
            "end": lambda _: self.ended.set(),
        }

    def answer(self, connection: socket.socket) -> None:
        """Serve one request."""
        with connection:
            connection.settimeout(120.0)
            try:
                line = connection.makefile("rb").readline(REQUEST_LIMIT)
                request = json.loads(line)
                verb = request["do"]
                if verb == "laptop":
                    self._hand_over(connection)
                    return
                if verb == "inside":
                    reply: Reply = {"value": self._inside(request)}
                elif verb == "status":
                    reply = {"value": self._status(request)}
                else:
                    with self._lock:
                        reply = {"value": self._verbs[verb](request)}
            except (MachineError, WireError, FaultError) as error:
                reply = {"error": str(error)}
            except OSError as error:
                reply = {"error": f"{type(error).__name__}: {error}"}
            except (ValueError, KeyError, TypeError) as error:
                reply = {"error": f"a request that makes no sense: {error!r}"}
            try:
                connection.sendall(json.dumps(reply).encode() + b"\n")
            except OSError:
                return  # whoever asked is gone

    def close(self) -> None:
        """Pull every plug and leave nothing behind."""
        for machine in self.machines:
            try:
                machine.power_cut()
            except MachineError as error:
                print(error, file=sys.stderr)
        remove_cgroups(self._folder.name)

    def _machine(self, request: Reply) -> Machine:
        return self.machines[int(request.get("robot", 0))]

    def _inside(self, request: Reply) -> list[Any]:
        done = self._machine(request).inside(
            request["command"], request.get("stdin", ""), float(request.get("timeout_s", 20.0))
        )
        return [done.status, done.stdout, done.stderr]

    def _renew(self, request: Reply) -> None:
        """A robot as it came from the factory, and a wire without faults."""
        machine = self._machine(request)
        self.bench.forget(machine)
        machine.power_cut()
        machine.wipe()
        machine.power_on()

    def _fault(self, request: Reply) -> None:
        self.bench.apply(self._machine(request), request["name"], request.get("settings", {}), bool(request.get("undo")))

    def _status(self, _: Reply) -> Reply:
        robots = [
            {
                "name": machine.identity.name,
                "eth0": machine.identity.address("eth0"),
                "wlan0": machine.identity.address("wlan0"),
                "running": machine.running,
                "boots": machine.boots,
                "clock_offset_s": machine.clock.offset_s,
                "clock_crystal_ppm": machine.clock.crystal_ppm,
                "clock_steps": machine.clock.steps,
                "disk_used_mb": machine.disk_used_mb(),
                "faults": sorted(self.bench.active(machine)),
            }
            for machine in self.machines
        ]
        return {"robots": robots, "ntp": self.bench.ntp_mode}

    def _hand_over(self, connection: socket.socket) -> None:
        """The laptop's namespaces as descriptors: PIDs mean nothing outside of this namespace."""
        message = json.dumps({"value": list(self.wire.laptop)}).encode() + b"\n"
        socket.send_fds(connection, [message], list(self.wire.laptop.values()))


def main() -> int:
    """Run one keeper until it is told to end."""
    parser = argparse.ArgumentParser(prog="python -m lupin_sim.host.keeper")
    parser.add_argument("folder", type=Path)
    parser.add_argument("root", type=Path)
    parser.add_argument("settings", type=json.loads)
    arguments = parser.parse_args()
    hardware = Hardware(**{**arguments.settings["hardware"], "binds": tuple(arguments.settings["hardware"].get("binds", ()))})
    folder: Path = arguments.folder
    os.umask(0o022)

    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.set())
    keeper: Keeper | None = None
    server = socket.socket(socket.AF_UNIX)
    try:
        keeper = Keeper(folder, arguments.root, int(arguments.settings["robots"]), hardware)
        keeper.ended = ended
        for machine in keeper.machines:
            machine.power_on()
        server.bind(str(folder / "control"))
        server.listen(64)
        threading.Thread(target=_serve, args=(server, keeper), daemon=True).start()
        if arguments.settings["lifeline"]:
            threading.Thread(target=_watch_lifeline, args=(ended,), daemon=True).start()
        print("up", flush=True)
        while not ended.wait(60.0):
            pass
        return 0
    except (MachineError, WireError, OSError) as error:
        print(f"error: {error}", flush=True)
        return 1
    finally:
        server.close()
        if keeper is not None:
            keeper.close()


def private_folder(folder: Path) -> Path:
    """A place in memory that is seen from here only, and goes with the keeper; likewise for what nspawn keeps in /run."""
    inner = folder / "inner"
    inner.mkdir()
    mount("-t", "tmpfs", "-o", "mode=755,size=256M", "tmpfs", str(inner))
    Path("/run/systemd").mkdir(exist_ok=True)
    mount("-t", "tmpfs", "-o", "mode=755,size=16M", "tmpfs", "/run/systemd")
    return inner


def _serve(server: socket.socket, keeper: Keeper) -> None:
    while True:
        try:
            connection, _ = server.accept()
        except OSError:
            return
        threading.Thread(target=keeper.answer, args=(connection,), daemon=True).start()


def _watch_lifeline(ended: threading.Event) -> None:
    while os.read(0, 4096):
        pass
    ended.set()


if __name__ == "__main__":
    sys.exit(main())
