"""A computer that can be switched on: systemd-nspawn behind an interface that a virtual machine could have too."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Protocol

from lupin_sim.host.clock import Clock
from lupin_sim.host.layer import Identity, lay
from lupin_sim.host.missing import cgroup_roots
from lupin_sim.host.namespaces import CLEAN_ENVIRONMENT, popen_in

REBOOT_STATUS = 133  # nspawn with --keep-unit leaves the second start to whoever called it
SIGRTMIN_POWEROFF = signal.SIGRTMIN + 4
POWEROFF_LIMIT_S = 20.0


@dataclass(frozen=True)
class Done:
    """What a command in the robot did."""

    status: int
    stdout: str
    stderr: str


class Machine(Protocol):
    """What the keeper and the faults want of a backend. Calls raise MachineError."""

    identity: Identity
    clock: Clock
    boots: int

    @property
    def running(self) -> bool:
        """Whether it is switched on."""

    @property
    def project_python(self) -> str:
        """A Python in there that has the project's packages."""

    def power_on(self) -> None:
        """Start it; returns before it is up."""

    def power_cut(self) -> None:
        """The plug is pulled: nothing in there gets to do anything more."""

    def power_off(self) -> None:
        """The button is pressed: systemd stops everything in its order; the plug is pulled where that takes too long."""

    def wipe(self) -> None:
        """Forget all that was ever written to its disk. Only while it is off."""

    def inside(self, command: Sequence[str], stdin: str = "", timeout_s: float = 20.0) -> Done:
        """Run a command in there as root, without a network between."""

    def popen_inside(self, command: Sequence[str], **options: Any) -> subprocess.Popen[Any]:
        """Start a command in there as root. Its standard streams are this process's."""

    def freeze(self, frozen: bool) -> None:
        """Stop every process in there where it stands, or let them all go on."""

    def limit_disk(self, size_mb: int | None) -> None:
        """Leave that much room for what it writes in all; None is what it had first."""

    def disk_used_mb(self) -> int:
        """What it has written, rounded up."""


class MachineError(Exception):
    """The machine isn't in a state for this."""


@dataclass(frozen=True)
class Hardware:
    """What a robot is made of."""

    disk_mb: int = 4096
    memory_shm_mb: int = 256
    own_clock: bool = True
    binds: tuple[str, ...] = ()  # of this machine's folders, read-only, at the same place
    robot: str | None = None  # what mirte-ros.service is to launch: assignments of ROBOT_PROJECT, _PYTHON and _ARGUMENTS


class NspawnMachine:
    """A container with its own PID 1, disk, network and wall clock. `plug` gives a new network namespace its interfaces."""

    def __init__(
        self,
        folder: Path,
        root: Path,
        identity: Identity,
        hardware: Hardware,
        console: Path,
        plug: Callable[[int], None],
        unplug: Callable[[], None],
        cgroup: str,
    ) -> None:
        self.identity, self.console, self.boots = identity, console, 0
        self._folder, self._root, self._hardware, self._plug = folder, root, hardware, plug
        self._unplug = unplug
        self._cgroups = [base / cgroup / identity.name for base in cgroup_roots()]
        self._process: subprocess.Popen[bytes] | None = None
        self._watcher: threading.Thread | None = None
        self._lock = threading.RLock()
        self._cut = False
        folder.mkdir()
        self.clock = Clock(folder / "clock")
        lay(self._made("layer"), identity, hardware.own_clock)
        if hardware.robot is not None:
            (folder / "layer/etc/mirte/robot").write_text(hardware.robot)
        self._insert_disk()

    @property
    def running(self) -> bool:
        return self._process is not None

    def power_on(self) -> None:
        with self._lock:
            if self._process is not None:
                raise MachineError(f"{self.identity.name} is on already")
            self._cut = False
            self._process = self._start()
            self._watcher = threading.Thread(target=self._watch, name=self.identity.name, daemon=True)
            self._watcher.start()

    def power_cut(self) -> None:
        with self._lock:
            self._cut = True
            if self._process is not None and (leader := self._leader()) is not None:
                os.kill(leader, signal.SIGKILL)  # of a PID namespace: the kernel ends the rest with it
            elif self._process is not None:
                self._process.kill()
        self._await_off()

    def power_off(self) -> None:
        with self._lock:
            if self._process is None:
                return
            self._cut = True
            if (leader := self._leader()) is not None:
                os.kill(leader, SIGRTMIN_POWEROFF)
        try:
            self._await_off(POWEROFF_LIMIT_S)
        except MachineError:
            self.power_cut()

    def wipe(self) -> None:
        if self._process is not None:
            raise MachineError(f"{self.identity.name} is on: its disk can be wiped only while it is off")
        unmount(self._folder / "root")
        unmount(self._folder / "disk")
        self._insert_disk()
        self.clock.reset()

    def inside(self, command: Sequence[str], stdin: str = "", timeout_s: float = 20.0) -> Done:
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        with self.popen_inside(command, text=True, errors="replace", **pipes) as process:
            try:
                stdout, stderr = process.communicate(stdin, timeout=timeout_s)
            except subprocess.TimeoutExpired:
                process.kill()
                raise MachineError(f"{' '.join(command)[:80]} did not end within {timeout_s:g} s") from None
        return Done(process.returncode, stdout, stderr)

    def popen_inside(self, command: Sequence[str], **options: Any) -> subprocess.Popen[Any]:
        leader = self._leader()
        if leader is None:
            raise MachineError(f"{self.identity.name} is off")
        kinds = ("mnt", "uts", "ipc", "net", "pid")
        try:
            there = {kind: os.open(f"/proc/{leader}/ns/{kind}", os.O_RDONLY | os.O_CLOEXEC) for kind in kinds}
        except OSError as error:
            raise MachineError(f"{self.identity.name} just went off: {error}") from None
        try:
            return popen_in(there, command, env=CLEAN_ENVIRONMENT, cwd="/", **options)
        finally:
            for fd in there.values():
                os.close(fd)

    def freeze(self, frozen: bool) -> None:
        for cgroup in self._cgroups:
            control = cgroup / "cgroup.freeze"
            if control.exists():
                control.write_text("1" if frozen else "0")
                return
        raise MachineError("this machine's cgroups cannot freeze: it has no cgroup v2")

    @property
    def project_python(self) -> str:
        return sys.executable  # bind-mounted at the same place

    def limit_disk(self, size_mb: int | None) -> None:
        size = f"{self._hardware.disk_mb if size_mb is None else size_mb}M"
        mount("-o", f"remount,size={size}", str(self._folder / "disk"))

    def disk_used_mb(self) -> int:
        usage = shutil.disk_usage(self._folder / "disk")
        return (usage.used >> 20) + 1

    # -- how

    def _made(self, name: str) -> Path:
        folder = self._folder / name
        folder.mkdir(exist_ok=True)
        return folder

    def _insert_disk(self) -> None:
        """An empty disk in memory, so nothing of a robot ever reaches this machine's own."""
        disk, merged = self._made("disk"), self._made("root")
        mount("-t", "tmpfs", "-o", f"size={self._hardware.disk_mb}M,mode=755", "tmpfs", str(disk))
        (disk / "upper").mkdir()
        (disk / "work").mkdir()
        lower = f"{self._folder / 'layer'}:{self._root}"
        options = f"lowerdir={lower},upperdir={disk / 'upper'},workdir={disk / 'work'}"
        mount("-t", "overlay", "-o", options, "overlay", str(merged))

    def _start(self) -> subprocess.Popen[bytes]:
        """A new network namespace each time, since a robot forgets routes and rules over a reboot; a new time namespace, so
        that it is up since now."""
        self.boots += 1
        for cgroup in self._cgroups:
            cgroup.mkdir(parents=True, exist_ok=True)
        up_s = int(float(Path("/proc/uptime").read_text().split()[0]))
        join = "".join(f"echo $$ > {cgroup}/cgroup.procs; " for cgroup in self._cgroups)
        script = f"{join}echo here; read go; exec {' '.join(self._nspawn())} < /dev/null"
        with self.console.open("ab") as console:
            process = subprocess.Popen(
                ["unshare", "--net", "--time", "--boottime", str(-up_s), "--monotonic", str(-up_s), "sh", "-c", script],
                # The robot may set net.* of its own namespace; nspawn keeps its locks in a /run of its own.
                env=CLEAN_ENVIRONMENT | {"SYSTEMD_NSPAWN_API_VFS_WRITABLE": "network"},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=console,
            )
            assert process.stdin is not None and process.stdout is not None
            if process.stdout.readline() != b"here\n":
                process.wait()
                raise MachineError(f"{self.identity.name} got no namespaces of its own: {self._last_words()}")
            self._plug(process.pid)
            threading.Thread(target=_drain, args=(process.stdout, self.console), daemon=True).start()
            process.stdin.write(b"go\n")
            process.stdin.close()
        return process

    def _nspawn(self) -> list[str]:
        hardware = self._hardware
        command = ["systemd-nspawn", "--quiet", "--boot", "--register=no", "--keep-unit", "--console=pipe"]
        command += [f"--machine={self.identity.name}", f"--directory={self._folder / 'root'}"]
        command += ["--resolv-conf=off", "--timezone=off", "--link-journal=no", "--capability=CAP_NET_ADMIN,CAP_NET_RAW"]
        command += [f"--tmpfs=/dev/shm:mode=1777,size={hardware.memory_shm_mb}M"]
        command += [f"--bind-ro={folder}" for folder in hardware.binds]
        if hardware.own_clock:
            # chronyd wants the capability to set a clock; the filter sees to it that the machine's is never the one.
            command += [f"--bind={self._folder / 'clock'}:/run/lupin-clock", "--capability=CAP_SYS_TIME"]
            command += ["--system-call-filter=~@clock"]
        return command

    def _watch(self) -> None:
        """Wait for its end; a reboot starts it again."""
        while True:
            process = self._process
            assert process is not None
            status = process.wait()
            self._unplug()
            with self._lock:
                if status != REBOOT_STATUS or self._cut:
                    self._process = None
                    return
                try:
                    self._process = self._start()
                except (MachineError, OSError, subprocess.SubprocessError) as error:
                    with self.console.open("a") as console:
                        console.write(f"did not come back from its reboot: {error}\n")
                    self._process = None
                    return

    def _await_off(self, limit_s: float = 10.0) -> None:
        watcher = self._watcher
        if watcher is not None:
            watcher.join(limit_s)
            if watcher.is_alive():
                raise MachineError(f"{self.identity.name} is still on after {limit_s:g} s: {self._last_words()}")

    def _leader(self) -> int | None:
        """The PID of the robot's systemd: the descendant of nspawn that is the first in a PID namespace of its own."""
        mine = Path("/proc/self/ns/pid").readlink()
        to_ask = [self._process.pid] if self._process is not None else []
        while to_ask:
            pid = to_ask.pop()
            try:
                if Path(f"/proc/{pid}/ns/pid").readlink() != mine:
                    return pid
                to_ask += [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
            except OSError:
                continue  # it ended meanwhile
        return None

    def _last_words(self) -> str:
        return self.console.read_text(errors="replace")[-600:].strip() if self.console.exists() else "it said nothing"


def _drain(pipe: IO[bytes], console: Path) -> None:
    """From nspawn's console into a file, whatever it prints."""
    with console.open("ab") as file:
        while line := pipe.readline():
            file.write(line)
            file.flush()


def mount(*arguments: str) -> None:
    """mount(8). Raises MachineError."""
    _call("mount", *arguments)


def unmount(folder: Path) -> None:
    """umount(8). Raises MachineError."""
    _call("umount", str(folder))


def _call(*command: str) -> None:
    done = subprocess.run(command, env=CLEAN_ENVIRONMENT, capture_output=True, text=True, timeout=30, check=False)
    if done.returncode:
        raise MachineError(f"{' '.join(command)}: {done.stderr.strip()}")
