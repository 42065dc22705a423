"""A simulated computer: an interface that a virtual machine could implement too, and its implementation with systemd-nspawn."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Protocol

from lupin_sim.host.clock import Clock
from lupin_sim.host.namespaces import CLEAN_ENVIRONMENT, popen_in
from lupin_sim.host.network import Network
from lupin_sim.host.overlay import Identity, write_overlay
from lupin_sim.host.prerequisites import cgroup_roots

REBOOT_STATUS = 133  # status of nspawn with --keep-unit after a reboot; the caller has to start it again
SIGRTMIN_POWEROFF = signal.SIGRTMIN + 4
POWEROFF_TIMEOUT_S = 20.0


@dataclass(frozen=True)
class CommandResult:
    """The exit status and output of a command on the robot."""

    status: int
    stdout: str
    stderr: str


class Computer(Protocol):
    """The interface of a backend, as the daemon and the faults use it. Its methods may raise ComputerError."""

    identity: Identity
    clock: Clock
    boots: int

    @property
    def running(self) -> bool:
        """Whether it is switched on."""

    @property
    def project_python(self) -> str:
        """The path on the robot of a Python that has the project's packages."""

    def power_on(self) -> None:
        """Switch it on; returns before it has booted."""

    def power_cut(self) -> None:
        """Cut its power: every process is killed at once."""

    def power_off(self) -> None:
        """Shut it down: systemd stops everything in order. Its power is cut after POWEROFF_TIMEOUT_S."""

    def wipe(self) -> None:
        """Restore the original disk and clock; it must be off."""

    def run_as_root(self, command: Sequence[str], stdin: str = "", timeout_s: float = 20.0) -> CommandResult:
        """Run a command on it as root, without a connection over its network."""

    def popen_as_root(self, command: Sequence[str], **options: Any) -> subprocess.Popen[Any]:
        """Start a command on it as root. `options` are those of subprocess.Popen."""

    def freeze(self, frozen: bool) -> None:
        """Suspend all of its processes, or resume them."""

    def limit_disk(self, size_mb: int | None) -> None:
        """Set the size of its disk, which holds only what it has written; None restores the original size."""

    def disk_used_mb(self) -> int:
        """Return how much the robot has written to its disk, in MB, rounded up."""


class ComputerError(Exception):
    """The computer cannot do what was requested."""


@dataclass(frozen=True)
class Hardware:
    """The equipment of a simulated computer.

    own_clock: it has its own wall clock, see clock.py.
    binds: folders of this machine, mounted read-only at the same path, or as FOLDER:PATH at another.
    robot: the simulated robot that mirte-ros.service launches, as shell assignments of ROBOT_PROJECT, ROBOT_PYTHON and
        ROBOT_ARGUMENTS, with OpenGL also of ROBOT_GRAPHICS and ROBOT_OWN_LIBRARIES; None for no simulated robot.
    """

    disk_mb: int = 4096
    memory_shm_mb: int = 256
    own_clock: bool = True
    binds: tuple[str, ...] = ()
    robot: str | None = None


@dataclass(frozen=True)
class HostFiles:
    """What a simulated computer uses on this machine.

    folder: its own files, not yet created. root: the root file system that all computers share and none changes.
    console: the file to which its console's output is appended. cgroup: the name of the host's cgroup.
    """

    folder: Path
    root: Path
    console: Path
    cgroup: str


class NspawnComputer:
    """A container with its own PID 1, disk and wall clock; `network` gives it its interfaces when it is switched on."""

    def __init__(self, identity: Identity, hardware: Hardware, files: HostFiles, network: Network) -> None:
        folder = files.folder
        self.identity, self.console, self.boots = identity, files.console, 0
        self._folder, self._root, self._hardware, self._network = folder, files.root, hardware, network
        self._cgroups = [base / files.cgroup / identity.name for base in cgroup_roots()]
        self._process: subprocess.Popen[bytes] | None = None
        self._watcher: threading.Thread | None = None
        self._lock = threading.RLock()
        self._stay_off = False
        folder.mkdir()
        self.clock = Clock(folder / "clock")
        self._write_overlay(self._subfolder("overlay"))
        self._insert_disk()

    @property
    def running(self) -> bool:
        return self._process is not None

    def power_on(self) -> None:
        with self._lock:
            if self._process is not None:
                raise ComputerError(f"{self.identity.name} is already on")
            self._stay_off = False
            self._process = self._start()
            self._watcher = threading.Thread(target=self._watch, name=self.identity.name, daemon=True)
            self._watcher.start()

    def power_cut(self) -> None:
        with self._lock:
            self._stay_off = True
            if self._process is not None and (leader := self._leader()) is not None:
                os.kill(leader, signal.SIGKILL)  # PID 1 of its namespace: the kernel kills all other processes with it
            elif self._process is not None:
                self._process.kill()
        self._wait_off()

    def power_off(self) -> None:
        with self._lock:
            if self._process is None:
                return
            self._stay_off = True
            if (leader := self._leader()) is not None:
                os.kill(leader, SIGRTMIN_POWEROFF)
        try:
            self._wait_off(POWEROFF_TIMEOUT_S)
        except ComputerError:
            self.power_cut()

    def wipe(self) -> None:
        if self._process is not None:
            raise ComputerError(f"{self.identity.name} is on: its disk can be wiped only while it is off")
        unmount(self._folder / "root")
        unmount(self._folder / "disk")
        self._insert_disk()
        self.clock.reset()

    def run_as_root(self, command: Sequence[str], stdin: str = "", timeout_s: float = 20.0) -> CommandResult:
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        with self.popen_as_root(command, text=True, errors="replace", **pipes) as process:
            try:
                stdout, stderr = process.communicate(stdin, timeout=timeout_s)
            except subprocess.TimeoutExpired:
                process.kill()
                raise ComputerError(f"{' '.join(command)[:80]} did not exit within {timeout_s:g} s") from None
        return CommandResult(process.returncode, stdout, stderr)

    def popen_as_root(self, command: Sequence[str], **options: Any) -> subprocess.Popen[Any]:
        namespaces = self.open_namespaces()
        try:
            return popen_in(namespaces, command, env=CLEAN_ENVIRONMENT, cwd="/", **options)
        finally:
            for fd in namespaces.values():
                os.close(fd)

    def open_namespaces(self) -> dict[str, int]:
        """Return open descriptors of its namespaces by kind; the caller closes them. Raises ComputerError."""
        leader = self._leader()
        if leader is None:
            raise ComputerError(f"{self.identity.name} is off")
        kinds = ("mnt", "uts", "ipc", "net", "pid")
        try:
            return {kind: os.open(f"/proc/{leader}/ns/{kind}", os.O_RDONLY | os.O_CLOEXEC) for kind in kinds}
        except OSError as error:
            raise ComputerError(f"{self.identity.name} has just been switched off: {error}") from None

    def freeze(self, frozen: bool) -> None:
        for cgroup in self._cgroups:
            control = cgroup / "cgroup.freeze"
            if control.exists():
                control.write_text("1" if frozen else "0")
                return
        raise ComputerError("this machine has no cgroup v2, so it cannot freeze a computer")

    @property
    def project_python(self) -> str:
        return sys.executable  # bind-mounted at the same path

    def limit_disk(self, size_mb: int | None) -> None:
        size = f"{self._hardware.disk_mb if size_mb is None else size_mb}M"
        mount("-o", f"remount,size={size}", str(self._folder / "disk"))

    def disk_used_mb(self) -> int:
        usage = shutil.disk_usage(self._folder / "disk")
        return (usage.used >> 20) + 1

    def _subfolder(self, name: str) -> Path:
        folder = self._folder / name
        folder.mkdir(exist_ok=True)
        return folder

    def _write_overlay(self, folder: Path) -> None:
        """Write what this computer has in addition to the root that all share."""
        write_overlay(folder, self.identity, self._hardware.own_clock)
        if self._hardware.robot is not None:
            (folder / "etc/mirte/robot").write_text(self._hardware.robot)

    def _network_command(self) -> list[str]:
        """Return the beginning of the command in whose namespaces the computer boots; options of `unshare` follow."""
        return ["unshare", "--net"]

    def _plug(self, pid: int) -> None:
        """Connect the network namespace of a process, in which the computer is about to boot."""
        self._network.plug(self.identity, pid)

    def _unplug(self) -> None:
        self._network.unplug(self.identity)

    def _insert_disk(self) -> None:
        """Mount an empty disk. It is in memory, so a simulated computer never writes to this machine's disk."""
        disk, merged = self._subfolder("disk"), self._subfolder("root")
        mount("-t", "tmpfs", "-o", f"size={self._hardware.disk_mb}M,mode=755", "tmpfs", str(disk))
        (disk / "upper").mkdir()
        (disk / "work").mkdir()
        lower = f"{self._folder / 'overlay'}:{self._root}"
        options = f"lowerdir={lower},upperdir={disk / 'upper'},workdir={disk / 'work'}"
        mount("-t", "overlay", "-o", options, "overlay", str(merged))

    def _start(self) -> subprocess.Popen[bytes]:
        """Boot it in a new network namespace, because a reboot loses routes and rules, and in a new time namespace, so that its
        uptime starts at 0."""
        self.boots += 1
        for cgroup in self._cgroups:
            cgroup.mkdir(parents=True, exist_ok=True)
        uptime_s = int(float(Path("/proc/uptime").read_text().split()[0]))
        join = "".join(f"echo $$ > {cgroup}/cgroup.procs; " for cgroup in self._cgroups)
        script = f"{join}echo ready; read go; exec {' '.join(self._nspawn())} < /dev/null"
        new_time = ("--time", "--boottime", f"-{uptime_s}", "--monotonic", f"-{uptime_s}")
        with self.console.open("ab") as console:
            process = subprocess.Popen(
                [*self._network_command(), *new_time, "sh", "-c", script],
                # This setting lets the robot set net.* sysctls of its own namespace.
                env=CLEAN_ENVIRONMENT | {"SYSTEMD_NSPAWN_API_VFS_WRITABLE": "network"},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=console,
            )
            assert process.stdin is not None and process.stdout is not None
            if process.stdout.readline() != b"ready\n":
                process.wait()
                raise ComputerError(f"{self.identity.name} could not create its namespaces: {self._console_tail()}")
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
            # chronyd requires CAP_SYS_TIME; the system call filter protects this machine's clock from it.
            command += [f"--bind={self._folder / 'clock'}:/run/lupin-clock", "--capability=CAP_SYS_TIME"]
            command += ["--system-call-filter=~@clock"]
        return command

    def _watch(self) -> None:
        """Wait until nspawn exits; boot the computer again after a reboot."""
        while True:
            process = self._process
            assert process is not None
            status = process.wait()
            self._unplug()
            with self._lock:
                if status != REBOOT_STATUS or self._stay_off:
                    self._process = None
                    return
                try:
                    self._process = self._start()
                except (ComputerError, OSError, subprocess.SubprocessError) as error:
                    with self.console.open("a") as console:
                        console.write(f"did not boot again after a reboot: {error}\n")
                    self._process = None
                    return

    def _wait_off(self, timeout_s: float = 10.0) -> None:
        watcher = self._watcher
        if watcher is not None:
            watcher.join(timeout_s)
            if watcher.is_alive():
                raise ComputerError(f"{self.identity.name} is still on after {timeout_s:g} s: {self._console_tail()}")

    def _leader(self) -> int | None:
        """Return the PID of the robot's systemd: the first descendant of nspawn that is in another PID namespace."""
        own_namespace = Path("/proc/self/ns/pid").readlink()
        pending = [self._process.pid] if self._process is not None else []
        while pending:
            pid = pending.pop()
            try:
                if Path(f"/proc/{pid}/ns/pid").readlink() != own_namespace:
                    return pid
                pending += [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
            except OSError:
                continue  # the process has just exited
        return None

    def _console_tail(self) -> str:
        return self.console.read_text(errors="replace")[-600:].strip() if self.console.exists() else "its console is empty"


def _drain(pipe: IO[bytes], console: Path) -> None:
    """Copy the output of nspawn's console to a file."""
    with console.open("ab") as file:
        while line := pipe.readline():
            file.write(line)
            file.flush()


def mount(*arguments: str) -> None:
    """Run the program `mount` on this machine. Raises ComputerError."""
    _call("mount", *arguments)


def unmount(folder: Path) -> None:
    """Run the program `umount` on this machine. Raises ComputerError."""
    _call("umount", str(folder))


def _call(*command: str) -> None:
    done = subprocess.run(command, env=CLEAN_ENVIRONMENT, capture_output=True, text=True, timeout=30, check=False)
    if done.returncode:
        raise ComputerError(f"{' '.join(command)}: {done.stderr.strip()}")
