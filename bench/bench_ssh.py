"""Forty scripts over SSH: one batch of Lupin, compared with a paramiko exec request or an ssh process for each script.

All use the same sshd (on loopback, with its own port and keys), run the same forty scripts and must get the same outputs.
`batch` opens a connection in each round, as a command of Lupin does, and so does `ssh_shared_each`, whose ssh processes share
it. `paramiko_exec_each` has the advantage of a connection that stays open; `ssh_each` has the disadvantage of opening forty.
The baseline, `local_baseline`, runs the forty scripts in parallel in local shells, without SSH and without time limits.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import paramiko

from bench.runner import Figures, Rounds, benchmark
from lupin_cli.connection.base import Script
from lupin_cli.connection.destination import Destination
from lupin_cli.connection.host_keys import KnownHosts
from lupin_cli.connection.ssh import SshTarget

SCRIPTS = (
    "cat /proc/loadavg | wc -w",
    "cut -d: -f1 /etc/passwd | head -n 3",
    "uname -m",
    "grep -c processor /proc/cpuinfo",
    "ls /proc/self/fd >/dev/null && echo yes",
)


@contextlib.contextmanager
def sshd(directory: Path) -> Iterator[int]:
    """Run an sshd on loopback that accepts the key `directory`/id of this user; yield its port."""
    program = shutil.which("sshd", path=f"{os.environ.get('PATH', '')}:/usr/sbin")
    if program is None:
        raise SystemExit("not measured: sshd is not installed; apt install openssh-server")
    for name in ("host", "id"):
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(directory / name)], check=True)
    (directory / "authorized").write_text((directory / "id.pub").read_text())
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = int(free.getsockname()[1])
    if os.geteuid() == 0:
        Path("/run/sshd").mkdir(mode=0o755, exist_ok=True)
    (directory / "config").write_text(
        f"ListenAddress 127.0.0.1:{port}\nHostKey {directory}/host\nAuthorizedKeysFile {directory}/authorized\nPidFile none\n"
        "UsePAM no\nStrictModes no\nPermitRootLogin yes\nUseDNS no\nMaxStartups 100\n"
    )
    key = " ".join((directory / "host.pub").read_text().split()[:2])
    (directory / "known").write_text(f"[127.0.0.1]:{port} {key}\nrobot {key}\n")
    process = subprocess.Popen([program, "-D", "-f", str(directory / "config")], stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 20
        while time.monotonic() < deadline:
            with socket.socket() as client:
                if client.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.02)
        yield port
    finally:
        process.terminate()
        process.wait(10)


class Methods:
    """Different methods to run the same scripts; each returns the outputs in the order of the scripts."""

    def __init__(self, directory: Path, port: int, scripts: list[str]) -> None:
        self._directory, self._scripts = directory, scripts
        user = os.environ.get("USER") or "root"
        self._destination = Destination("127.0.0.1", port, user, (str(directory / "id"),), identities_only=True)
        known = f"UserKnownHostsFile={directory}/known"
        self._ssh = ["ssh", "-F", "none", "-o", "BatchMode=yes"]
        self._login = [
            "-o",
            known,
            "-o",
            "IdentitiesOnly=yes",
            "-i",
            str(directory / "id"),
            "-p",
            str(port),
            f"{user}@127.0.0.1",
        ]
        self._client = paramiko.SSHClient()
        self._client.load_host_keys(str(directory / "known"))
        self._client.connect(
            "127.0.0.1", port, user, key_filename=str(directory / "id"), allow_agent=False, look_for_keys=False
        )

    def batch(self) -> list[str]:
        """Connect with Lupin, run one batch, and close."""
        target = SshTarget("robot", self._destination, KnownHosts(self._directory / "known", self._directory / "none"))
        try:
            outputs = target.batch([Script(str(n), text) for n, text in enumerate(self._scripts)], timeout_s=60.0)
        finally:
            target.close()
        return [outputs[str(n)].stdout for n in range(len(self._scripts))]

    def paramiko_exec_each(self) -> list[str]:
        """Run one exec_command of paramiko after the other, with its defaults, over an open connection."""
        outputs = []
        for text in self._scripts:
            _, stdout, _ = self._client.exec_command(text, timeout=60)
            outputs.append(stdout.read().decode())
        return outputs

    def ssh_each(self) -> list[str]:
        """Run an ssh process with its own connection for each script."""
        return [self._run_ssh(text, []) for text in self._scripts]

    def ssh_shared_each(self) -> list[str]:
        """Open a shared connection, and run an ssh process over it for each script."""
        control = ["-o", f"ControlPath={self._directory}/mux"]
        # The master keeps its standard streams open: a reader of a pipe would wait for it.
        null = subprocess.DEVNULL
        master = subprocess.Popen([*self._ssh, *control, "-M", "-N", *self._login], stdin=null, stdout=null, stderr=null)
        deadline = time.monotonic() + 30
        while not (self._directory / "mux").exists() and time.monotonic() < deadline:
            time.sleep(0.005)
        outputs = [self._run_ssh(text, control) for text in self._scripts]
        master.terminate()
        master.wait(30)
        return outputs

    def _run_ssh(self, text: str, options: list[str]) -> str:
        command = [*self._ssh, *options, *self._login, text]
        null, pipe = subprocess.DEVNULL, subprocess.PIPE
        return subprocess.run(command, stdin=null, stdout=pipe, stderr=null, text=True, timeout=60, check=True).stdout

    def local_baseline(self) -> list[str]:
        """Run the scripts in parallel, without SSH."""
        running = [subprocess.Popen(["sh", "-c", text], stdout=subprocess.PIPE, text=True) for text in self._scripts]
        return [process.communicate(timeout=60)[0] for process in running]

    def close(self) -> None:
        """Close paramiko's connection."""
        self._client.close()


@benchmark()
def main(probes: Annotated[int, "run this many scripts"] = 40, rounds: Rounds = 5) -> Figures:
    """Time all methods, and return the medians."""
    scripts = [SCRIPTS[n % len(SCRIPTS)] for n in range(probes)]
    with tempfile.TemporaryDirectory() as name, sshd(Path(name)) as port:
        methods = Methods(Path(name), port, scripts)
        timed: list[Callable[[], list[str]]] = [
            methods.batch,
            methods.paramiko_exec_each,
            methods.ssh_shared_each,
            methods.ssh_each,
            methods.local_baseline,
        ]
        expected = methods.local_baseline()
        times_s: dict[str, list[float]] = {method.__name__: [] for method in timed}
        for _ in range(rounds):  # round-robin, so that other load of this machine affects all methods alike
            for method in timed:
                start = time.perf_counter()
                outputs = method()
                times_s[method.__name__].append(time.perf_counter() - start)
                if outputs != expected:
                    raise SystemExit(f"{method.__name__} returned different outputs")
        methods.close()
    median_s = {name: statistics.median(each) for name, each in times_s.items()}
    rows = {name: {"median_s": value, "speedup_of_batch": value / median_s["batch"]} for name, value in median_s.items()}
    return {"probes": probes, "rounds": rounds, "methods": rows}


if __name__ == "__main__":
    sys.exit(main())
