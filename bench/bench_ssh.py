"""Forty probes of a robot in one batch over one connection, against one paramiko exec each, and one ssh process each.

All ask the same sshd (this machine's, on loopback, a port and keys of its own) the same forty questions and must get the same
answers. `batch` opens its connection anew every time, as a command of Lupin's does; the peers are given theirs: paramiko one
connection that is open already, ssh a fresh one each, and ssh with a shared master connection. The limit is the forty scripts
run by a local shell, side by side, with no SSH and no bounds.

    python -m bench.bench_ssh [--probes N] [--rounds N] [--json]
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import socket
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import paramiko

from lupin_cli.target.base import Script
from lupin_cli.target.destination import Destination
from lupin_cli.target.ssh import SshTarget
from lupin_cli.target.trust import Trust

QUESTIONS = (
    "cat /proc/loadavg | wc -w",
    "cut -d: -f1 /etc/passwd | head -n 3",
    "uname -m",
    "grep -c processor /proc/cpuinfo",
    "ls /proc/self/fd >/dev/null && echo yes",
)


@contextlib.contextmanager
def sshd(directory: Path) -> Iterator[int]:
    """An sshd on loopback that lets this user in with `directory`/id; gives its port."""
    program = shutil.which("sshd", path=f"{os.environ.get('PATH', '')}:/usr/sbin")
    if program is None:
        raise SystemExit("needs sshd: apt install openssh-server")
    for name in ("host", "id"):
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(directory / name)], check=True)
    (directory / "authorized").write_text((directory / "id.pub").read_text())
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
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
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.02)
        yield port
    finally:
        process.terminate()
        process.wait(10)


class Contest:
    """The ways to ask `questions`; each gives the answers in their order."""

    def __init__(self, directory: Path, port: int, questions: list[str]) -> None:
        self._directory, self._port, self._questions = directory, port, questions
        user = os.environ.get("USER") or "root"
        self._place = Destination("127.0.0.1", port, user, (str(directory / "id"),), identities_only=True)
        known = f"UserKnownHostsFile={directory}/known"
        common = ["-o", known, "-o", "IdentitiesOnly=yes", "-i", str(directory / "id"), "-p", str(port), f"{user}@127.0.0.1"]
        self._ssh = ["ssh", "-F", "none", "-o", "BatchMode=yes"]
        self._to = common
        self._client = self._connect()

    def _connect(self) -> paramiko.SSHClient:
        client = paramiko.SSHClient()
        client.load_host_keys(str(self._directory / "known"))
        files = self._place.identity_files[0]
        client.connect("127.0.0.1", self._port, self._place.user, key_filename=files, allow_agent=False, look_for_keys=False)
        return client

    def batch(self) -> list[str]:
        """Ours: connect, one batch, close."""
        target = SshTarget("robot", self._place, Trust(self._directory / "known", self._directory / "none"))
        try:
            outputs = target.batch([Script(str(n), text) for n, text in enumerate(self._questions)], bound_s=60.0)
        finally:
            target.close()
        return [outputs[str(n)].stdout for n in range(len(self._questions))]

    def exec_each(self) -> list[str]:
        """paramiko as it comes, one exec_command after the other over an open connection."""
        answers = []
        for text in self._questions:
            _, stdout, _ = self._client.exec_command(text, timeout=60)
            answers.append(stdout.read().decode())
        return answers

    def ssh_each(self) -> list[str]:
        """One ssh process and connection a question."""
        return [self._ask_by_ssh(text, []) for text in self._questions]

    def ssh_shared(self) -> list[str]:
        """One ssh process a question over a shared connection, which is opened first."""
        control = ["-o", f"ControlPath={self._directory}/mux"]
        # The master keeps what it was given for as long as it lives: nobody may wait for the end of it.
        null = subprocess.DEVNULL
        master = subprocess.Popen([*self._ssh, *control, "-M", "-N", *self._to], stdin=null, stdout=null, stderr=null)
        deadline = time.monotonic() + 30
        while not (self._directory / "mux").exists() and time.monotonic() < deadline:
            time.sleep(0.005)
        answers = [self._ask_by_ssh(text, control) for text in self._questions]
        master.terminate()
        master.wait(30)
        return answers

    def _ask_by_ssh(self, text: str, options: list[str]) -> str:
        command = [*self._ssh, *options, *self._to, text]
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            timeout=60,
            check=True,
        )
        return done.stdout

    def local(self) -> list[str]:
        """The limit: the scripts side by side with nothing around them."""
        running = [subprocess.Popen(["sh", "-c", text], stdout=subprocess.PIPE, text=True) for text in self._questions]
        return [process.communicate(timeout=60)[0] for process in running]

    def close(self) -> None:
        self._client.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--probes", type=int, default=40)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    questions = [QUESTIONS[n % len(QUESTIONS)] for n in range(options.probes)]
    with tempfile.TemporaryDirectory() as name, sshd(Path(name)) as port:
        contest = Contest(Path(name), port, questions)
        ways: dict[str, Callable[[], list[str]]] = {
            "batch": contest.batch,
            "paramiko_exec_each": contest.exec_each,
            "ssh_shared_each": contest.ssh_shared,
            "ssh_each": contest.ssh_each,
            "local_limit": contest.local,
        }
        expected = contest.local()
        taken: dict[str, list[float]] = {way: [] for way in ways}
        for _ in range(options.rounds):  # in turns: whatever else this machine does hits all of them
            for way, ask in ways.items():
                start = time.perf_counter()
                answers = ask()
                taken[way].append(time.perf_counter() - start)
                if answers != expected:
                    raise SystemExit(f"{way} got other answers")
        contest.close()
    median = {way: statistics.median(times) for way, times in taken.items()}
    result = {
        "probes": options.probes,
        "rounds": options.rounds,
        "median_s": {way: round(value, 3) for way, value in median.items()},
        "batch_is_faster_by": {way: round(value / median["batch"], 1) for way, value in median.items() if way != "batch"},
    }
    if options.json:
        print(json.dumps(result))
        return
    for way, value in median.items():
        print(f"{way:20} {value:7.3f} s   {value / median['batch']:6.1f} x")


if __name__ == "__main__":
    main()
