"""A real sshd on loopback, which accepts a key of the user who runs the tests."""

from __future__ import annotations

import getpass
import os
import shutil
import signal
import socket
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from lupin_cli.connection.destination import Destination
from lupin_cli.connection.host_keys import KnownHosts
from tests.support.waiting import wait_until


@dataclass
class Sshd:
    """A running sshd. `directory` holds its keys, its log and the user's key."""

    port: int
    directory: Path
    host_key: str  # "ssh-ed25519 AAAA..."

    @property
    def destination(self) -> Destination:
        return Destination(
            "127.0.0.1", self.port, getpass.getuser(), (str(self.directory / "id_ed25519"),), identities_only=True
        )

    def known_hosts(self, name: str = "robot") -> KnownHosts:
        """Return a store in which this server's key is accepted for the robot `name`."""
        path = self.directory / f"known-{name}"
        path.write_text(f"{name} {self.host_key}\n")
        return KnownHosts(path, user_file=self.directory / "absent")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def start_sshd(directory: Path, port: int = 0, extra: str = "") -> tuple[subprocess.Popen[bytes], Sshd]:
    """Start an sshd and wait until it listens. Its keys are in `directory` and are created if missing.

    Lines of `extra` override the defaults.
    """
    program = shutil.which("sshd", path=f"{os.environ.get('PATH', '')}:/usr/sbin")
    if program is None:
        pytest.skip("needs sshd: apt install openssh-server")
    if os.geteuid() == 0:
        Path("/run/sshd").mkdir(mode=0o755, exist_ok=True)  # sshd's privilege separation directory
    for name in ("host_ed25519", "id_ed25519"):
        if not (directory / name).exists():
            command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(directory / name)]
            subprocess.run(command, check=True, timeout=60)
    (directory / "authorized_keys").write_text((directory / "id_ed25519.pub").read_text())
    port = port or free_port()
    config = directory / f"sshd_config_{port}"
    config.write_text(
        f"ListenAddress 127.0.0.1:{port}\nHostKey {directory}/host_ed25519\nAuthorizedKeysFile {directory}/authorized_keys\n"
        f"PidFile none\n{extra}UsePAM no\nPasswordAuthentication no\nStrictModes no\nPermitRootLogin yes\nMaxStartups 100\n"
        f"Subsystem sftp internal-sftp\nUseDNS no\n"
    )
    with (directory / "sshd.log").open("ab") as log:
        process = subprocess.Popen([program, "-D", "-e", "-f", str(config)], stdin=subprocess.DEVNULL, stderr=log)

    def listens() -> bool:
        assert process.poll() is None, (directory / "sshd.log").read_text()
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", port)) == 0

    try:
        wait_until(listens, "sshd", interval_s=0.02)
    except BaseException:
        process.kill()
        process.wait(60)
        raise
    key = " ".join((directory / "host_ed25519.pub").read_text().split()[:2])
    return process, Sshd(port, directory, key)


@pytest.fixture(scope="session")
def sshd(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Sshd]:
    process, server = start_sshd(tmp_path_factory.mktemp("sshd"))
    yield server
    process.terminate()
    process.wait(60)


@pytest.fixture
def own_sshd(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[bytes], Sshd]]:
    """Yield an sshd for one test, which may stop or kill it."""
    process, server = start_sshd(tmp_path)
    yield process, server
    process.send_signal(signal.SIGCONT)
    process.terminate()
    process.wait(60)
