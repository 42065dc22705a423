"""Injects and undoes faults of the network, the laptop's NTP server and the robots. Knows which faults are active."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from lupin_sim.host.computer import Computer
from lupin_sim.host.namespaces import CLEAN_ENVIRONMENT, popen_in
from lupin_sim.host.network import Network

Settings = Mapping[str, Any]
FaultAction = Callable[["FaultInjector", Computer, Settings], None]
NTP_PORT = 123
NTP_TIMEOUT_S = 10.0


class FaultError(Exception):
    """A fault or a setting does not exist, or a fault cannot be injected or undone."""


@dataclass(frozen=True)
class Fault:
    """One row of the table of faults.

    summary: what is broken, for `lupin sim host fault`.
    inject, undo: the actions that inject and undo it. `undo` is None for a one-time fault, such as a reboot.
    settings: its settings with their default values.
    external: its cause is outside the simulated computer, so a new disk and a new boot do not undo it.
    link_settings: returns the settings of the link emulator on the fault's link while the fault is active.
    """

    summary: str
    inject: FaultAction
    undo: FaultAction | None
    settings: Mapping[str, Any] = field(default_factory=dict)
    external: bool = False
    link_settings: Callable[[Settings], Mapping[str, Any]] | None = None


class FaultKey(NamedTuple):
    """Identifies an active fault. `link` is "" for a fault without a link; a fault with one may be active on both links."""

    robot: int
    fault: str
    link: str


class FaultInjector:
    """Injects the faults of a table, undoes them, and records the active ones.

    `robot_rootfs` is the root file system of the simulated computers. Its chronyd also serves as the laptop's NTP server, whose
    output goes to `folder`.
    """

    def __init__(
        self, table: Mapping[str, Fault], network: Network, computers: list[Computer], robot_rootfs: Path, folder: Path
    ) -> None:
        self.table, self.network, self.computers = table, network, computers
        self._robot_rootfs, self._folder = robot_rootfs, folder
        self._active: dict[FaultKey, Settings] = {}
        self._ntp: subprocess.Popen[bytes] | None = None
        self.ntp_mode = "off"

    def inject(self, computer: Computer, name: str, settings: Settings) -> None:
        """Inject a fault into the simulated computer, its network or the laptop. Raises FaultError."""
        fault, chosen, key = self._look_up(computer, name, settings)
        with self._restore_record_on_failure(key):
            if fault.undo is not None:
                self._active[key] = chosen
            fault.inject(self, computer, chosen)

    def undo(self, computer: Computer, name: str, settings: Settings) -> None:
        """Undo a fault of the simulated computer; without a `link` setting, on both links. Raises FaultError."""
        fault, chosen, key = self._look_up(computer, name, settings)
        if fault.undo is None:
            raise FaultError(f"{name} is a one-time fault: there is nothing to undo")
        active = [each for each in self._active if (each.robot, each.fault) == (key.robot, name)]
        for each in [key] if "link" in settings else active or [key]:
            with self._restore_record_on_failure(each):
                fault.undo(self, computer, self._active.pop(each, chosen))

    def _look_up(self, computer: Computer, name: str, settings: Settings) -> tuple[Fault, Settings, FaultKey]:
        """Return a fault, its settings with the defaults filled in, and the key of its record. Raises FaultError."""
        fault = self.table.get(name)
        if fault is None:
            raise FaultError(f"unknown fault {name!r}; expected one of: {', '.join(sorted(self.table))}")
        if unknown := sorted(set(settings) - set(fault.settings)):
            raise FaultError(f"{name} has no setting {', '.join(unknown)}; it has: {', '.join(fault.settings) or 'none'}")
        chosen = {**fault.settings, **settings}
        return fault, chosen, FaultKey(computer.identity.index, name, chosen.get("link", ""))

    @contextmanager
    def _restore_record_on_failure(self, key: FaultKey) -> Iterator[None]:
        """Restore the record of a fault if the block fails."""
        before = self._active.get(key)
        try:
            yield
        except BaseException:
            self._active.pop(key, None)
            if before is not None:
                self._active[key] = before
            raise

    def active_faults(self, computer: Computer) -> list[str]:
        """Return the names of the simulated computer's active faults."""
        return [key.fault for key in self._active if key.robot == computer.identity.index]

    def prepare_reset(self, computer: Computer) -> None:
        """Undo the faults of the simulated computer that a new disk and a new boot do not undo, and remove the records of all.

        Also stops the laptop's NTP server.
        """
        for key in [key for key in self._active if key.robot == computer.identity.index]:
            fault = self.table[key.fault]
            with self._restore_record_on_failure(key):
                settings = self._active.pop(key)
                if fault.external and fault.undo is not None:
                    fault.undo(self, computer, settings)
        self.serve_ntp("off")

    def update_link(self, computer: Computer, link: str) -> None:
        """Impair a link of the simulated computer with the combined settings of all active faults on it.

        Without any such fault, the link emulator is removed.
        """
        combined: dict[str, Any] = {}
        for key, settings in self._active.items():
            link_settings = self.table[key.fault].link_settings
            if link_settings is not None and key.robot == computer.identity.index and settings["link"] == link:
                combined |= link_settings(settings)
        self.network.impair(computer.identity, link, combined or None)

    def serve_ntp(self, mode: str) -> None:
        """Switch the laptop's NTP server: "serving", "silent" (it runs without `allow`, as Debian installs it) or "off".

        The server is the chronyd of the simulated computers' root file system, with -x, so it never changes a clock. Raises
        FaultError.
        """
        if mode not in ("serving", "silent", "off"):
            raise FaultError(f"expected the NTP server to be serving, silent or off, found {mode!r}")
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
        # chronyd writes only to /run, which is a tmpfs in the laptop's mount namespace, so the shared root stays unchanged.
        run = f"{self._robot_rootfs}/run"
        self.network.run_on_laptop("sh", "-ec", f"mountpoint -q {run} || mount -t tmpfs tmpfs {run}")
        self.network.run_on_laptop("rm", "-rf", f"{run}/chrony")
        console = self._folder / "ntp.console"
        with console.open("ab") as log:
            self._ntp = popen_in(
                self.network.laptop,
                ["chroot", str(self._robot_rootfs), "/usr/sbin/chronyd", "-x", "-d", "-u", "root", *directives],
                env=CLEAN_ENVIRONMENT,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        if mode == "silent":
            return  # without `allow` it does not even listen
        deadline = time.monotonic() + NTP_TIMEOUT_S
        while f":{NTP_PORT:04X} " not in Path(f"/proc/{self.network.laptop_pid}/net/udp").read_text():
            if self._ntp.poll() is not None or time.monotonic() > deadline:
                raise FaultError(
                    f"the laptop's chronyd did not open UDP port {NTP_PORT} within {NTP_TIMEOUT_S:g} s; see {console}:"
                    f" {console.read_text()[-300:].strip()}"
                )
            time.sleep(0.02)


def run_script(computer: Computer, script: str, *arguments: str, timeout_s: float = 30.0) -> str:
    """Run a shell script as root on the simulated computer, with `arguments` as `$1`...; returns its output.

    Raises FaultError.
    """
    done = computer.run_as_root(["sh", "-ec", script, "sh", *arguments], timeout_s=timeout_s)
    if done.status:
        reason = done.stderr.strip()[-300:] or script.strip()[:120]
        raise FaultError(f"the fault's script failed on the robot with status {done.status}: {reason}")
    return done.stdout
