"""A host to work with: start one, attach to one, run programs on the laptop, break the robot, give it back healthy."""

from __future__ import annotations

import json
import os
import select
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lupin_sim.host import state
from lupin_sim.host.layer import keys
from lupin_sim.host.machine import Done
from lupin_sim.host.missing import what_is_missing
from lupin_sim.host.namespaces import NEW_FLAGS, popen_in, standing_in
from lupin_sim.host.rootfs import Progress, RootError, root_directory

PROJECT = Path(__file__).resolve().parents[2]
START_LIMIT_S = 60.0
END_LIMIT_S = 30.0
READY_LIMIT_S = 60.0
PER_ROBOT_LIMIT_S = 10.0
USER = "mirte"
# Drawing pictures would take a core from everything else, and a robot stamps by its own clock.
ROBOT_ARGUMENTS = "--wall-clock --no-cameras"


class HostError(Exception):
    """What was expected of a host, what was found, what to type."""


class HostUnavailable(HostError):
    """This machine lacks something that a host needs."""


@dataclass(frozen=True)
class Robot:
    """One robot of a host. `number` counts from 0."""

    host: Host
    number: int
    name: str
    eth0: str
    wlan0: str

    def inside(self, *command: str, stdin: str = "", timeout_s: float = 20.0) -> Done:
        """Run a command in there as root, without a network between: to arrange things and to look at them."""
        value = self.host.ask("inside", robot=self.number, command=command, stdin=stdin, timeout_s=timeout_s)
        return Done(*value)

    def fault(self, name: str, **settings: Any) -> None:
        """Break something; `lupin sim host fault` lists what there is."""
        self.host.ask("fault", robot=self.number, name=name, settings=settings)

    def mend(self, name: str, **settings: Any) -> None:
        """Take a fault back."""
        self.host.ask("fault", robot=self.number, name=name, settings=settings, undo=True)

    @contextmanager
    def broken(self, name: str, **settings: Any) -> Iterator[None]:
        """A fault that stands inside the block."""
        self.fault(name, **settings)
        try:
            yield
        finally:
            self.mend(name, **settings)

    def power_on(self) -> None:
        """Switch it on; `wait_ready` waits until it can be logged into."""
        self.host.ask("on", robot=self.number)

    def power_off(self) -> None:
        """Shut it down in good order."""
        self.host.ask("off", robot=self.number)

    def power_cut(self) -> None:
        """Pull the plug."""
        self.host.ask("cut", robot=self.number)

    def renew(self) -> None:
        """A new disk, a right clock, no faults, freshly booted, and ready."""
        self.host.ask("renew", robot=self.number)
        self.wait_ready()

    @property
    def state(self) -> dict[str, Any]:
        """What `lupin sim host status --json` says of it."""
        robots: list[dict[str, Any]] = self.host.ask("status")["robots"]
        return robots[self.number]

    def wait_ready(self, limit_s: float = READY_LIMIT_S, link: str = "eth0") -> None:
        """Wait until its sshd answers on the laptop's network. Raises HostError."""
        deadline = time.monotonic() + limit_s
        address = self.eth0 if link == "eth0" else self.wlan0
        while True:
            try:
                with self.host.on_laptop(), socket.create_connection((address, 22), timeout=1.0) as connection:
                    if connection.recv(4) == b"SSH-":
                        return
            except OSError as error:
                found = str(error)
            else:
                found = "no banner"
            if time.monotonic() > deadline:
                raise HostError(f"{self.name} has no sshd on {address} after {limit_s:g} s ({found}); {self.host.last_words()}")
            if not self.state["running"]:
                raise HostError(f"{self.name} is off; {self.host.last_words()}")
            time.sleep(0.02)


class Host:
    """A laptop, cables, and robots. Use `Host.start` as a context manager, or `Host.attach` to one that is up."""

    def __init__(self, name: str, process: subprocess.Popen[str] | None = None) -> None:
        self.name, self.folder, self._process = name, state.STATE / name, process
        self._laptop = self._ask_for_laptop()
        self.key, self.known_hosts = keys() / "id_ed25519", self.folder / "known_hosts"
        self.robots = [
            Robot(self, number, robot["name"], robot["eth0"], robot["wlan0"])
            for number, robot in enumerate(self.ask("status")["robots"])
        ]

    @classmethod
    def start(
        cls,
        name: str | None = None,
        *,
        robots: int = 1,
        vendor_robot: bool = False,
        robot_arguments: str = ROBOT_ARGUMENTS,
        lifeline: bool = True,
        progress: Progress = lambda _: None,
        **hardware: Any,
    ) -> Host:
        """Boot robots and return once all can be logged into.

        With `lifeline` everything ends with this process; without, it stays up until `Host.end`. `hardware` is that of
        machine.Hardware. Raises HostError with what is missing.
        """
        if missing := what_is_missing():
            raise HostUnavailable(missing)
        state.sweep()
        try:
            root = root_directory(progress)
        except RootError as error:
            raise HostUnavailable(str(error)) from None
        chosen = name or f"{os.getpid()}-{time.monotonic_ns() // 1_000_000 % 1_000_000}"
        folder = state.STATE / chosen
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            raise HostError(f"there is a host {chosen!r} already: lupin sim host down --name {chosen}") from None
        # The project is there, read-only, with the Pythons that it runs on, so that anything of it can run on the robot.
        binds = sorted({str(PROJECT), str(Path(sys.prefix).resolve()), str(Path(sys.base_prefix).resolve())} - {"/usr"})
        robot = f"ROBOT_PROJECT={PROJECT}\nROBOT_PYTHON={sys.executable}\nROBOT_ARGUMENTS={robot_arguments!r}\n"
        settings = {
            "robots": robots,
            "hardware": {"binds": binds, "robot": robot if vendor_robot else None, **hardware},
            "lifeline": lifeline,
        }
        host = None
        try:
            process = _start_keeper(folder, root, settings)
            host = cls(chosen, process)
            host._write_known_hosts()
            for each in host.robots:
                each.wait_ready(READY_LIMIT_S + PER_ROBOT_LIMIT_S * robots)
        except BaseException:
            if host is not None:
                host.end()
            state.sweep()
            raise
        return host

    @classmethod
    def attach(cls, name: str) -> Host:
        """A host that another process started. Raises HostError."""
        if name not in state.running():
            others = ", ".join(state.running()) or "none"
            raise HostError(f"no host {name!r} is up (up: {others}): lupin sim host up --name {name}")
        return cls(name)

    @property
    def robot(self) -> Robot:
        """The first robot."""
        return self.robots[0]

    # -- the laptop

    @contextmanager
    def on_laptop(self) -> Iterator[None]:
        """Inside the block this thread, with the threads and programs it starts, is on the laptop's network: 10.42.0.2 and
        192.168.42.2. Sockets made in there stay there."""
        with standing_in(self._laptop["net"], "net"):
            yield

    def popen(self, command: Sequence[str], env: Mapping[str, str] | None = None, **options: Any) -> subprocess.Popen[Any]:
        """Start a program on the laptop: its network, its processes, its /dev/shm, this machine's files. It is a child of this
        process, so signals reach it as they would any."""
        return popen_in(self._laptop, command, env, **options)

    def run(self, command: Sequence[str], timeout_s: float = 60.0, **options: Any) -> subprocess.CompletedProcess[str]:
        """Run a program on the laptop to its end; text, captured unless told otherwise. Raises subprocess.TimeoutExpired."""
        options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True} | options
        text_in = options.pop("input", None)
        options.setdefault("stdin", subprocess.DEVNULL if text_in is None else subprocess.PIPE)
        process = self.popen(command, **options)
        try:
            stdout, stderr = process.communicate(text_in, timeout=timeout_s)
        except BaseException:
            process.kill()
            process.communicate()
            raise
        return subprocess.CompletedProcess(command, process.returncode, stdout, stderr)

    def ssh_command(self, *command: str, robot: Robot | None = None, link: str = "eth0") -> list[str]:
        """OpenSSH's command line for a robot, to be run on the laptop."""
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
        """Run a shell command as mirte on a robot, the first one where none is named, over SSH."""
        return self.run(self.ssh_command("-o", "BatchMode=yes", command, robot=robot), **options)

    def serve_ntp(self, mode: str = "serving") -> None:
        """The laptop's clock server: "serving", "refusing", or "off" as a host starts. It never touches a clock itself."""
        self.ask("ntp", mode=mode)

    # -- its life

    def ask(self, verb: str, **details: Any) -> Any:
        """One request to the keeper. Raises HostError."""
        with self._connection() as connection:
            connection.sendall(json.dumps({"do": verb, **details}).encode() + b"\n")
            line = connection.makefile("rb").readline()
        if not line:
            raise HostError(f"the keeper of host {self.name!r} ended: {self.last_words()}")
        reply = json.loads(line)
        if "error" in reply:
            raise HostError(reply["error"])
        return reply.get("value")

    def end(self) -> None:
        """Pull every plug, and leave nothing behind."""
        keeping = state.read(self.folder)
        with suppress(HostError, OSError):  # it is gone already, or will be by force
            self.ask("end")
        deadline = time.monotonic() + END_LIMIT_S
        if self._process is not None:
            try:
                self._process.wait(END_LIMIT_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout):
                if pipe is not None:
                    pipe.close()
        while keeping is not None and keeping.alive:
            if time.monotonic() > deadline:
                os.kill(keeping.pid, 9)
            time.sleep(0.01)
        for fd in self._laptop.values():
            os.close(fd)
        self._laptop = {}
        state.remove_cgroups(self.name)
        shutil.rmtree(self.folder, ignore_errors=True)

    def last_words(self) -> str:
        """The end of what robots and keeper printed."""
        texts = []
        for path in sorted(self.folder.glob("*.console")) if self.folder.is_dir() else ():
            texts.append(f"{path.name}: {path.read_text(errors='replace')[-500:].strip()}")
        return "; ".join(texts) or "it said nothing"

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
                f"the keeper of host {self.name!r} does not answer ({error.strerror}): lupin sim host status"
            ) from None
        return connection

    def _ask_for_laptop(self) -> dict[str, int]:
        with self._connection() as connection:
            connection.sendall(b'{"do": "laptop"}\n')
            message, fds, _, _ = socket.recv_fds(connection, 4096, len(NEW_FLAGS))
        for fd in fds:
            os.set_inheritable(fd, False)
        return dict(zip(json.loads(message)["value"], fds))

    def _write_known_hosts(self) -> None:
        lines = []
        for robot in self.robots:
            for public in sorted(keys().glob("ssh_host_*_key.pub")):
                lines.append(f"{robot.eth0},{robot.wlan0} {' '.join(public.read_text().split()[:2])}\n")
        self.known_hosts.write_text("".join(lines))


def _start_keeper(folder: Path, root: Path, settings: dict[str, Any]) -> subprocess.Popen[str]:
    """Start the keeper as the first process of its own namespaces, and wait until it holds the control socket."""
    command = ["unshare", "--mount", "--propagation", "private", "--pid", "--fork", "--kill-child=SIGKILL", "--mount-proc"]
    command += [sys.executable, "-m", "lupin_sim.host.keeper", str(folder), str(root), json.dumps(settings)]
    with (folder / "keeper.console").open("w") as log:
        process = subprocess.Popen(
            command,
            cwd=PROJECT,
            stdin=subprocess.PIPE if settings["lifeline"] else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            start_new_session=True,  # a Ctrl-C in the terminal is this process's matter
        )
    state.write(folder, process.pid)
    assert process.stdout is not None
    patient_s = START_LIMIT_S + PER_ROBOT_LIMIT_S * settings["robots"]
    said, _, _ = select.select([process.stdout], [], [], patient_s)
    line = process.stdout.readline().strip() if said else f"the keeper said nothing for {patient_s:g} s"
    if line != "up":
        process.kill()
        with process:  # closes its pipes, and waits for its end
            pass
        log_text = (folder / "keeper.console").read_text()[-800:].strip()
        raise HostError(f"the host did not start: {line or log_text}")
    return process
