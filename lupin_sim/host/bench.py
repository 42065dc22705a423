"""Where faults are made: the wire, the laptop's clock server and the robots, and which faults stand."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lupin_sim.host.machine import Machine
from lupin_sim.host.namespaces import CLEAN_ENVIRONMENT, popen_in
from lupin_sim.host.wire import Wire

Settings = Mapping[str, Any]
Act = Callable[["Bench", Machine, Settings], None]
NTP_PORT = 123
NTP_LIMIT_S = 10.0


class FaultError(Exception):
    """There is no such fault, or it cannot be made as things stand."""


@dataclass(frozen=True)
class Fault:
    """One row: what it is, how it is made and taken back, and the settings it takes, with their defaults.

    `undo` is None for what is over once it happened. `outside` faults are not on the robot, so a new disk and a new boot of it
    don't take them back. `link_settings` gives what a frame pump in the cable is to do.
    """

    summary: str
    do: Act
    undo: Act | None
    settings: Mapping[str, Any] = field(default_factory=dict)
    outside: bool = False
    link_settings: Callable[[Settings], Mapping[str, Any]] | None = None


class Bench:
    """Makes the faults of a table, takes them back, and knows which stand."""

    def __init__(self, table: Mapping[str, Fault], wire: Wire, machines: list[Machine], root: Path, folder: Path) -> None:
        self.table, self.wire, self.machines = table, wire, machines
        self._root, self._folder = root, folder
        # By robot, fault and cable: the same fault may stand on both of a robot's cables.
        self._active: dict[tuple[int, str, str], Settings] = {}
        self._ntp: subprocess.Popen[bytes] | None = None
        self.ntp_mode = "off"

    def apply(self, machine: Machine, name: str, settings: Settings, undo: bool) -> None:
        """Make a fault, or take it back, on both cables unless one is named. Raises FaultError."""
        fault = self.table.get(name)
        if fault is None:
            raise FaultError(f"there is no fault {name!r}; there are: {', '.join(sorted(self.table))}")
        if unknown := sorted(set(settings) - set(fault.settings)):
            raise FaultError(f"{name} knows no {', '.join(unknown)}; it takes {', '.join(fault.settings) or 'no settings'}")
        chosen = {**fault.settings, **settings}
        where = (machine.identity.index, name, chosen.get("link", ""))
        if undo and fault.undo is None:
            raise FaultError(f"{name} is over once it happened: there is nothing to undo")
        if undo:
            assert fault.undo is not None
            standing = [where] if "link" in settings else [each for each in self._active if each[:2] == where[:2]]
            for each in standing or [where]:
                fault.undo(self, machine, self._active.pop(each, chosen))
            return
        if fault.undo is not None:
            self._active[where] = chosen
        try:
            fault.do(self, machine, chosen)
        except BaseException:
            self._active.pop(where, None)
            raise

    def active(self, machine: Machine) -> list[str]:
        """The faults that stand."""
        return [name for index, name, _ in self._active if index == machine.identity.index]

    def forget(self, machine: Machine) -> None:
        """Take back all that would outlive a new disk and a new boot of a robot."""
        for each in [each for each in self._active if each[0] == machine.identity.index]:
            settings, fault = self._active.pop(each), self.table[each[1]]
            if fault.outside and fault.undo is not None:
                fault.undo(self, machine, settings)
        self.serve_ntp("off")

    def pump(self, machine: Machine, link: str) -> None:
        """Make a robot's cable do what all faults that stand on it ask for together."""
        together: dict[str, Any] = {}
        for (index, name, _), settings in self._active.items():
            asked = self.table[name].link_settings
            if asked is not None and index == machine.identity.index and settings["link"] == link:
                together |= asked(settings)
        self.wire.impair(machine.identity, link, together or None)

    def serve_ntp(self, mode: str) -> None:
        """The laptop's clock server: "serving", "refusing" (it runs and lets nobody ask, as installed) or "off".

        It is the chronyd of the robot's root, with -x: it never touches a clock.
        """
        if mode not in ("serving", "refusing", "off"):
            raise FaultError(f"a clock server is serving, refusing or off, not {mode!r}")
        self.ntp_mode = mode
        if self._ntp is not None:
            self._ntp.kill()
            self._ntp.wait()
            self._ntp = None
        if mode == "off":
            return
        directives = ["local stratum 8", "cmdport 0"]
        if mode == "serving":
            directives += ["allow 10.42.0.0/24", "allow 192.168.42.0/24"]
        # It may write into the root's /run as far as the laptop sees it, and nowhere else.
        self.wire.in_laptop("sh", "-ec", f"mountpoint -q {self._root}/run || mount -t tmpfs tmpfs {self._root}/run")
        self.wire.in_laptop("rm", "-rf", f"{self._root}/run/chrony")
        console = self._folder / "ntp.console"
        with console.open("ab") as log:
            self._ntp = popen_in(
                self.wire.laptop,
                ["chroot", str(self._root), "/usr/sbin/chronyd", "-x", "-d", "-u", "root", *directives],
                env=CLEAN_ENVIRONMENT,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        deadline = time.monotonic() + NTP_LIMIT_S
        while f":{NTP_PORT:04X} " not in Path(f"/proc/{self.wire.laptop_pid}/net/udp").read_text():
            if mode == "refusing":
                return  # nobody may ask, so it doesn't even listen
            if self._ntp.poll() is not None or time.monotonic() > deadline:
                raise FaultError(f"the laptop's chronyd does not serve: {console.read_text()[-300:]}")
            time.sleep(0.02)


def inside(machine: Machine, script: str, *arguments: str, timeout_s: float = 30.0) -> str:
    """Run a shell script in the robot as root; `$1`... are its arguments. Returns what it printed. Raises FaultError."""
    done = machine.inside(["sh", "-ec", script, "sh", *arguments], timeout_s=timeout_s)
    if done.status:
        raise FaultError(f"the robot said {done.status} to: {script[:120]}: {done.stderr.strip()[-300:]}")
    return done.stdout
