"""A host: simulated robots and a laptop on one network. Starts or attaches to one, runs programs on it, injects faults."""

from __future__ import annotations

import json
import os
import select
import shutil
import socket
import subprocess
import sys
import sysconfig
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lupin_runtime.interpreter import PYTHON
from lupin_runtime.json_text import parse_json
from lupin_sim.host import booted_laptop, state
from lupin_sim.host.computer import CommandResult
from lupin_sim.host.namespaces import CLEAN_ENVIRONMENT, NEW_FLAGS, inside_namespace, popen_in
from lupin_sim.host.overlay import Identity, known_hosts, ssh_keys
from lupin_sim.host.prerequisites import missing_prerequisite
from lupin_sim.host.rootfs import Progress, RootError, root_directory

PROJECT = Path(__file__).resolve().parents[2]
START_TIMEOUT_S = 60.0
END_TIMEOUT_S = 30.0
READY_TIMEOUT_S = 60.0
PER_ROBOT_TIMEOUT_S = 10.0
USER = "mirte"
# Rendering the cameras would use up one core. A robot stamps messages with its own clock.
ROBOT_ARGUMENTS = "--wall-clock --no-cameras"
MACHINE_LIBRARIES = "/opt/machine-libraries"  # on the robot: this machine's, which has OpenGL
EGL_VENDORS = "/usr/share/glvnd"


class HostError(Exception):
    """A request to a host failed; the message says what was found and what to type."""


class HostUnavailable(HostError):
    """This machine lacks something that a host needs."""


@dataclass(frozen=True)
class Robot:
    """One simulated robot of a host. `number` counts from 0."""

    host: Host
    number: int
    name: str
    eth0: str
    wlan0: str

    def run_as_root(self, *command: str, stdin: str = "", timeout_s: float = 20.0) -> CommandResult:
        """Run a command on the robot as root, without SSH: to prepare and to inspect it."""
        value = self.host.request("run_as_root", robot=self.number, command=command, stdin=stdin, timeout_s=timeout_s)
        return CommandResult(*value)

    def inject_fault(self, name: str, **settings: Any) -> None:
        """Inject a fault; `lupin sim host fault` lists them with their settings."""
        self.host.request("fault", robot=self.number, name=name, settings=settings)

    def undo_fault(self, name: str, **settings: Any) -> None:
        """Undo a fault."""
        self.host.request("fault", robot=self.number, name=name, settings=settings, undo=True)

    @contextmanager
    def with_fault(self, name: str, **settings: Any) -> Iterator[None]:
        """Inject a fault for the duration of the block."""
        self.inject_fault(name, **settings)
        try:
            yield
        finally:
            self.undo_fault(name, **settings)

    def power_on(self) -> None:
        """Switch it on, without waiting for its boot; see `wait_ready`."""
        self.host.request("on", robot=self.number)

    def power_off(self) -> None:
        """Shut it down cleanly."""
        self.host.request("off", robot=self.number)

    def power_cut(self) -> None:
        """Cut its power."""
        self.host.request("cut", robot=self.number)

    def factory_reset(self) -> None:
        """Reboot it with a new disk, a correct clock and no faults, and wait until it is ready."""
        self.host.request("reset", robot=self.number)
        self.wait_ready()

    @property
    def state(self) -> dict[str, Any]:
        """Its entry in `lupin sim host status --json`."""
        robots: list[dict[str, Any]] = self.host.request("status")["robots"]
        return robots[self.number]

    def wait_ready(self, timeout_s: float = READY_TIMEOUT_S, link: str = "eth0") -> None:
        """Wait until its sshd answers on the laptop's network. Raises HostError."""
        deadline = time.monotonic() + timeout_s
        address = self.eth0 if link == "eth0" else self.wlan0
        while True:
            try:
                with self.host.on_laptop(), socket.create_connection((address, 22), timeout=1.0) as connection:
                    if connection.recv(4) == b"SSH-":
                        return
            except OSError as error:
                found = str(error)
            else:
                found = "it sent no banner"
            if time.monotonic() > deadline:
                raise HostError(
                    f"{self.name} did not answer SSH on {address} within {timeout_s:g} s ({found}); {self.host.console_tails()}"
                )
            if not self.state["running"]:
                raise HostError(f"{self.name} is off; {self.host.console_tails()}")
            time.sleep(0.02)


class Host:
    """A laptop, a network, and robots. Use `Host.start` as a context manager, or `Host.attach` for a host that is up."""

    def __init__(self, name: str, process: subprocess.Popen[str] | None = None) -> None:
        self.name, self.folder, self._process = name, state.STATE / name, process
        status = self.request("status")
        self.laptop_boots: bool = status["laptop_boots"]
        self._laptop = self._receive_laptop()
        self.key, self.known_hosts = ssh_keys() / "id_ed25519", self.folder / "known_hosts"
        if self.laptop_boots:  # it has no other file of this machine than the project and its Python
            self.key, self.known_hosts = (booted_laptop.HOME / ".ssh" / each for each in ("id_ed25519", "known_hosts"))
        self.robots = [
            Robot(self, number, robot["name"], robot["eth0"], robot["wlan0"]) for number, robot in enumerate(status["robots"])
        ]

    @classmethod
    def start(
        cls,
        name: str | None = None,
        *,
        robots: int = 1,
        vendor_robot: bool = False,
        boot_laptop: bool = False,
        robot_arguments: str = ROBOT_ARGUMENTS,
        graphics: bool = False,
        lifeline: bool = True,
        progress: Progress = lambda _: None,
        **hardware: Any,
    ) -> Host:
        """Boot robots and return when SSH answers on all of them.

        With `lifeline` the host ends with this process; without, it stays up until `Host.end`. With `vendor_robot`,
        mirte-ros.service runs the simulated robot with `robot_arguments`, whose cameras need the machine's OpenGL (`graphics`).
        With `boot_laptop`, the laptop has its own systemd, disk and account; see `booted_laptop`. `hardware` are fields of
        computer.Hardware.
        Raises HostError; HostUnavailable names what this machine lacks.
        """
        if missing := missing_prerequisite():
            raise HostUnavailable(missing)
        state.remove_stale()
        try:
            root = root_directory(progress)
        except RootError as error:
            raise HostUnavailable(str(error)) from None
        chosen = name or f"{os.getpid()}-{time.monotonic_ns() // 1_000_000 % 1_000_000}"
        folder = state.STATE / chosen
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            raise HostError(f"host {chosen!r} is already up: lupin sim host down --name {chosen}") from None
        # The robot sees the project and its Python installations, read-only, so that all of the project can run on it.
        binds = sorted({str(PROJECT), str(Path(sys.prefix).resolve()), str(Path(sys.base_prefix).resolve())} - {"/usr"})
        robot = f"ROBOT_PROJECT={PROJECT}\nROBOT_PYTHON={sys.executable}\nROBOT_ARGUMENTS={robot_arguments!r}\n"
        if graphics:
            libraries = f"/usr/lib/{sysconfig.get_config_var('MULTIARCH')}"
            binds += [f"{libraries}:{MACHINE_LIBRARIES}", EGL_VENDORS]
            robot += f"ROBOT_GRAPHICS={MACHINE_LIBRARIES}\nROBOT_OWN_LIBRARIES={libraries}\n"
        settings = {
            "robots": robots,
            "hardware": {"binds": binds, "robot": robot if vendor_robot else None, **hardware},
            "lifeline": lifeline,
            "boot_laptop": boot_laptop,
        }
        host = None
        progress(f"booting {robots} robot{'' if robots == 1 else 's'}: 10 to 30 seconds")
        try:
            process = _start_daemon(folder, root, settings)
            host = cls(chosen, process)
            if not boot_laptop:
                host.known_hosts.write_text(known_hosts([Identity(number) for number in range(robots)]))
            progress("waiting until SSH answers" + (" and the vendor's stack runs" if vendor_robot else ""))
            for each in host.robots:
                each.wait_ready(READY_TIMEOUT_S + PER_ROBOT_TIMEOUT_S * robots)
            if boot_laptop:
                host._wait_for_laptop()
        except BaseException:
            if host is not None:
                host.end()
            state.remove_stale()
            raise
        return host

    @classmethod
    def attach(cls, name: str) -> Host:
        """Attach to a host that another process started. Raises HostError if it is not up."""
        if name not in state.running():
            others = ", ".join(state.running()) or "none"
            raise HostError(f"no host {name!r} is up (up: {others}): lupin sim host up --name {name}")
        return cls(name)

    @property
    def robot(self) -> Robot:
        """The first robot."""
        return self.robots[0]

    @contextmanager
    def on_laptop(self) -> Iterator[None]:
        """Inside the block, this thread and the threads and programs it starts use the laptop's network: 10.42.0.2 and
        192.168.42.2. Sockets opened in the block stay on that network."""
        with inside_namespace(self._laptop["net"], "net"):
            yield

    def popen(self, command: Sequence[str], env: Mapping[str, str] | None = None, **options: Any) -> subprocess.Popen[Any]:
        """Start a program on the laptop, which has its own network, processes and /dev/shm, and this machine's files.

        It is a child of this process, so signals and kill() reach the program itself. A laptop that boots has its own files,
        and the program belongs to its account; `env` is added to the account's environment.
        """
        if self.laptop_boots:
            command, env = booted_laptop.as_account(command, env), CLEAN_ENVIRONMENT
            options.setdefault("cwd", str(booted_laptop.HOME))
        return popen_in(self._laptop, command, env, **options)

    def run(self, command: Sequence[str], timeout_s: float = 60.0, **options: Any) -> subprocess.CompletedProcess[str]:
        """Run a program on the laptop until it exits. Its output is captured as text, unless `options` (those of Popen) say
        otherwise. Raises subprocess.TimeoutExpired."""
        options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True} | options
        stdin = options.pop("input", None)
        options.setdefault("stdin", subprocess.DEVNULL if stdin is None else subprocess.PIPE)
        process = self.popen(command, **options)
        try:
            stdout, stderr = process.communicate(stdin, timeout=timeout_s)
        except BaseException:
            process.kill()
            process.communicate()
            raise
        return subprocess.CompletedProcess(command, process.returncode, stdout, stderr)

    def ssh_command(self, *command: str, robot: Robot | None = None, link: str = "eth0") -> list[str]:
        """Return the OpenSSH command line that logs in to a robot from the laptop; without `robot`, the first one."""
        chosen = robot or self.robot
        address = chosen.eth0 if link == "eth0" else chosen.wlan0
        options = [
            "IdentitiesOnly=yes",
            "StrictHostKeyChecking=yes",
            "ConnectTimeout=5",
            f"UserKnownHostsFile={self.known_hosts}",
        ]
        flags = [part for option in options for part in ("-o", option)]
        return ["ssh", "-F", "none", "-i", str(self.key), *flags, f"{USER}@{address}", *command]

    def ssh(self, command: str, robot: Robot | None = None, **options: Any) -> subprocess.CompletedProcess[str]:
        """Run a shell command over SSH as mirte; without `robot`, on the first one."""
        return self.run(self.ssh_command("-o", "BatchMode=yes", command, robot=robot), **options)

    def serve_ntp(self, mode: str = "serving") -> None:
        """Switch the laptop's NTP server: "serving", "silent", or "off" as at the start. It never sets a clock itself."""
        self.request("ntp", mode=mode)

    def request(self, verb: str, **details: Any) -> Any:
        """Send one request to the daemon and return its value. Raises HostError."""
        with self._connection() as connection:
            connection.sendall(json.dumps({"do": verb, **details}).encode() + b"\n")
            line = connection.makefile("rb").readline()
        if not line:
            raise HostError(f"the daemon of host {self.name!r} has exited: {self.console_tails()}")
        reply = parse_json(line)
        if "error" in reply:
            raise HostError(reply["error"])
        return reply.get("value")

    def end(self) -> None:
        """Cut the power of all robots, and remove everything that belongs to the host."""
        daemon = state.read(self.folder)
        with suppress(HostError, OSError):  # it has exited already, or is killed below
            self.request("end")
        deadline = time.monotonic() + END_TIMEOUT_S
        if self._process is not None:
            try:
                self._process.wait(END_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout):
                if pipe is not None:
                    pipe.close()
        while daemon is not None and daemon.alive:
            if time.monotonic() > deadline:
                os.kill(daemon.pid, 9)
            time.sleep(0.01)
        for fd in self._laptop.values():
            os.close(fd)
        self._laptop = {}
        state.remove_cgroups(self.name)
        shutil.rmtree(self.folder, ignore_errors=True)

    def console_tails(self) -> str:
        """Return the last output of the robots and of the daemon."""
        texts = []
        for path in sorted(self.folder.glob("*.console")) if self.folder.is_dir() else ():
            texts.append(f"{path.name}: {path.read_text(errors='replace')[-500:].strip()}")
        return "; ".join(texts) or "the consoles are empty"

    def __enter__(self) -> Host:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def _connection(self) -> socket.socket:
        connection = socket.socket(socket.AF_UNIX)
        connection.settimeout(150.0)
        try:
            connection.connect(str(self.folder / "control"))
        except OSError as error:
            connection.close()
            raise HostError(
                f"the daemon of host {self.name!r} does not answer ({error.strerror}): lupin sim host status"
            ) from None
        return connection

    def _receive_laptop(self) -> dict[str, int]:
        """Receive the laptop's namespaces from the daemon, as open descriptors by kind."""
        with self._connection() as connection:
            connection.sendall(b'{"do": "laptop"}\n')
            message, fds, _, _ = socket.recv_fds(connection, 4096, len(NEW_FLAGS))
        for fd in fds:
            os.set_inheritable(fd, False)
        return dict(zip(parse_json(message)["value"], fds))

    def _wait_for_laptop(self) -> None:
        """Wait until a laptop that boots has started its units. Raises HostError."""
        deadline = time.monotonic() + READY_TIMEOUT_S
        while self.run(["systemctl", "is-active", "--quiet", "multi-user.target"]).returncode != 0:
            if time.monotonic() > deadline:
                raise HostError(f"the laptop did not boot within {READY_TIMEOUT_S:g} s; {self.console_tails()}")
            time.sleep(0.05)


def _start_daemon(folder: Path, root: Path, settings: dict[str, Any]) -> subprocess.Popen[str]:
    """Start the daemon as the first process of its own namespaces, and wait until it listens. Raises HostError."""
    command = ["unshare", "--mount", "--propagation", "private", "--pid", "--fork", "--kill-child=SIGKILL", "--mount-proc"]
    command += [*PYTHON, "-m", "lupin_sim.host.daemon", str(folder), str(root), json.dumps(settings)]
    with (folder / "daemon.console").open("w") as log:
        process = subprocess.Popen(
            command,
            cwd=PROJECT,
            stdin=subprocess.PIPE if settings["lifeline"] else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            start_new_session=True,  # a Ctrl-C in the terminal is for this process only
        )
    state.write(folder, process.pid)
    assert process.stdout is not None
    timeout_s = START_TIMEOUT_S + PER_ROBOT_TIMEOUT_S * settings["robots"]
    readable, _, _ = select.select([process.stdout], [], [], timeout_s)
    line = process.stdout.readline().strip() if readable else f"its daemon was not ready within {timeout_s:g} s"
    if line != "up":
        process.kill()
        with process:  # closes its pipes and waits for its exit
            pass
        log_text = (folder / "daemon.console").read_text()[-800:].strip()
        raise HostError(f"the host did not start: {line or log_text}")
    return process
