"""Which keys a login offers, against a real sshd and real agents; the message names the agent, the file or the passphrase."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli.connection.base import AuthenticationFailed, PrivateKeyMissing, PrivateKeyUnusable, Unreachable
from lupin_cli.connection.ssh import SshTarget
from tests.lupin_cli.connection.conftest import start_sshd
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from tests.lupin_cli.connection.conftest import Sshd

AgentOf = Callable[..., Path]


@pytest.fixture(autouse=True)
def no_agent(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Neither an agent nor a key of the user who runs the tests."""
    monkeypatch.delenv("SSH_AUTH_SOCK", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))


@pytest.fixture
def agent_of(tmp_path: Path) -> Iterator[AgentOf]:
    """Yield a function that starts an agent with these keys and returns its socket."""
    started: list[subprocess.Popen[bytes]] = []

    def start(*keys: Path) -> Path:
        path = tmp_path / f"agent-{len(started)}"
        started.append(subprocess.Popen(["ssh-agent", "-D", "-a", str(path)], stdout=subprocess.DEVNULL))
        wait_until(path.exists, "the agent's socket")
        for key in keys:
            command = ["ssh-add", "-q", str(key)]
            subprocess.run(command, check=True, timeout=60, env={"SSH_AUTH_SOCK": str(path), "PATH": "/usr/bin:/bin"})
        return path

    yield start
    for process in started:
        process.terminate()
        process.wait(60)


def make_key(path: Path, passphrase: str = "", kind: str = "ed25519") -> Path:
    subprocess.run(["ssh-keygen", "-q", "-t", kind, "-N", passphrase, "-f", str(path)], check=True, timeout=60)
    return path


def own_key(sshd: Sshd) -> Path:
    """Return the private key that the server accepts."""
    return sshd.directory / "id_ed25519"


def copy_encrypted(sshd: Sshd, path: Path) -> Path:
    shutil.copy(own_key(sshd), path)
    path.chmod(0o600)
    command = ["ssh-keygen", "-q", "-p", "-P", "", "-N", "a phrase", "-f", str(path)]
    subprocess.run(command, check=True, timeout=60, capture_output=True)
    return path


def log_in(sshd: Sshd, **fields: Any) -> None:
    """Log in with these fields of the destination. Raises TargetError."""
    fields = {"identity_files": (), "identities_only": False, **fields}
    with contextlib.closing(SshTarget("pot", replace(sshd.destination, **fields), sshd.known_hosts("pot"))) as target:
        target.connect()


@pytest.mark.parametrize("only", [True, False])
def test_public_file_chooses_the_key_of_the_agent(sshd: Sshd, tmp_path: Path, agent_of: AgentOf, only: bool) -> None:
    # An sshd gives up after six keys: the seventh is offered first.
    public = shutil.copy(own_key(sshd).with_suffix(".pub"), tmp_path / "pot.pub")
    socket = agent_of(*(make_key(tmp_path / f"other-{number}") for number in range(7)), own_key(sshd))
    log_in(sshd, identity_agent=str(socket), identity_files=(str(public),), identities_only=only)
    log_in(sshd, identity_agent=str(socket), identity_files=(str(tmp_path / "pot"),), identities_only=only)


def test_identities_only_restricts_the_agent(sshd: Sshd, tmp_path: Path, agent_of: AgentOf) -> None:
    key = make_key(tmp_path / "other")
    socket = agent_of(own_key(sshd))
    with pytest.raises(AuthenticationFailed, match="accepts none of this user's keys"):
        log_in(sshd, identity_agent=str(socket), identity_files=(str(key),), identities_only=True)
    log_in(sshd, identity_agent=str(socket), identity_files=(str(key),))


@pytest.mark.parametrize("name", ["SSH_AUTH_SOCK", "$MY_AGENT", "${MY_AGENT}", ""])
def test_agent_is_named_by_a_variable(sshd: Sshd, agent_of: AgentOf, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MY_AGENT" if "MY" in name else "SSH_AUTH_SOCK", str(agent_of(own_key(sshd))))
    log_in(sshd, identity_agent=name)


def test_agent_none_is_not_asked(sshd: Sshd, agent_of: AgentOf, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SSH_AUTH_SOCK", str(agent_of(own_key(sshd))))
    with pytest.raises(PrivateKeyMissing, match="no private key"):
        log_in(sshd, identity_agent="none")


def test_encrypted_file_is_used_through_the_agent(sshd: Sshd, tmp_path: Path, agent_of: AgentOf) -> None:
    file = copy_encrypted(sshd, tmp_path / "pot")
    log_in(sshd, identity_agent=str(agent_of(own_key(sshd))), identity_files=(str(file),), identities_only=True)


def test_passphrase_without_agent_is_named(sshd: Sshd, tmp_path: Path) -> None:
    file = copy_encrypted(sshd, tmp_path / "pot")
    with pytest.raises(
        AuthenticationFailed, match=f"{file} is encrypted with a passphrase, and no agent has its key"
    ) as caught:
        log_in(sshd, identity_files=(str(file),))
    assert caught.value.next_command == f"ssh-add {file}"


def test_key_that_the_agent_lacks_is_named_with_both(sshd: Sshd, tmp_path: Path, agent_of: AgentOf) -> None:
    public = shutil.copy(own_key(sshd).with_suffix(".pub"), tmp_path / "pot.pub")
    socket = agent_of(make_key(tmp_path / "other"))
    expected = f"{public} is a public key, and the agent at {socket} does not have its key"
    with pytest.raises(AuthenticationFailed, match=expected) as caught:
        log_in(sshd, identity_agent=str(socket), identity_files=(str(public),), identities_only=True)
    assert caught.value.next_command == f"ssh-add {tmp_path}/pot"


def test_agent_that_does_not_answer_is_named(sshd: Sshd, tmp_path: Path) -> None:
    with pytest.raises(AuthenticationFailed, match=f"the agent at {tmp_path}/none does not answer: .*No such file"):
        log_in(sshd, identity_agent=str(tmp_path / "none"))
    log_in(sshd, identity_agent=str(tmp_path / "none"), identity_files=(str(own_key(sshd)),))


def test_absent_identity_file_is_named(sshd: Sshd, tmp_path: Path) -> None:
    with pytest.raises(PrivateKeyMissing, match=f"{tmp_path}/gone, an IdentityFile, does not exist"):
        log_in(sshd, identity_files=(str(tmp_path / "gone"),))


@pytest.fixture
def certified(tmp_path: Path) -> Iterator[tuple[Sshd, Path]]:
    """Yield an sshd that accepts certificates of an authority, and no plain key; and a key with such a certificate."""
    key = make_key(tmp_path / "signed", kind="rsa")
    authority = make_key(tmp_path / "authority")
    subprocess.run(
        ["ssh-keygen", "-q", "-s", str(authority), "-I", "pot", "-n", "root,mirte", f"{key}.pub"], check=True, timeout=60
    )
    process, server = start_sshd(tmp_path, extra=f"TrustedUserCAKeys {authority}.pub\nAuthorizedKeysFile none\n")
    subprocess.run(
        ["ssh-keygen", "-q", "-s", str(authority), "-I", "pot", "-n", server.destination.user, f"{key}.pub"], check=True
    )
    yield server, key
    process.terminate()
    process.wait(60)


def test_certificate_logs_in(certified: tuple[Sshd, Path], agent_of: AgentOf, tmp_path: Path) -> None:
    server, key = certified
    log_in(server, identity_files=(str(key),))  # KEY-cert.pub is found by its name
    moved = shutil.move(f"{key}-cert.pub", tmp_path / "moved.pub")
    with pytest.raises(AuthenticationFailed, match="accepts none"):
        log_in(server, identity_files=(str(key),))
    log_in(server, identity_files=(str(key),), certificate_files=(str(moved),))
    log_in(server, identity_agent=str(agent_of(key)), certificate_files=(str(moved),), identities_only=True)
    with pytest.raises(AuthenticationFailed, match=f"the private key of the certificate {moved} is neither in"):
        log_in(server, certificate_files=(str(moved),))


@pytest.mark.parametrize("name", ["certificate", "key"])
def test_damaged_file_is_named(sshd: Sshd, tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    file.write_text("ssh-ed25519 AAAA\n" if name == "certificate" else "nonsense\n")
    fields = {"certificate_files" if name == "certificate" else "identity_files": (str(file),)}
    with pytest.raises(PrivateKeyUnusable, match=f"{file} is no"):
        log_in(sshd, **fields)


RELAY = """exec python3 -c '
import os, socket, sys, threading
s = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
def up():
    while data := os.read(0, 65536):
        s.sendall(data)
threading.Thread(target=up, daemon=True).start()
while data := s.recv(65536):
    os.write(1, data)
' "$1"
"""


def test_proxy_command_is_started_by_a_shell(sshd: Sshd, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a relay").write_text(RELAY)
    monkeypatch.setenv("RELAYS", str(tmp_path))
    monkeypatch.setenv("SHELL", "/bin/sh")
    command = f'sh "$RELAYS/a relay" {sshd.port} 2>~/errors'
    log_in(sshd, host="nowhere.invalid", identity_files=(str(own_key(sshd)),), proxy_command=command)
    assert (tmp_path / "errors").exists()


@pytest.mark.parametrize(
    ("command", "complaint"),
    [
        ("/nowhere/relay x", "its ProxyCommand cannot be started: /nowhere/relay x .*(not found|No such file)"),
        ("sh -c 'relay", "its ProxyCommand cannot be started: sh -c 'relay .*(nterminated|unexpected EOF)"),
        ("/etc/passwd", "its ProxyCommand cannot be started: /etc/passwd .*ermission denied"),
        ("sh -c 'echo no route >&2; exit 3'", r"its ProxyCommand does not work: .*status 3: no route"),
        ("echo HTTP/1.1 400", "its ProxyCommand does not work: echo HTTP"),
        ("sleep 60", "its ProxyCommand does not work: sleep 60"),
    ],
)
def test_proxy_command_that_fails_is_named(sshd: Sshd, command: str, complaint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lupin_cli.connection.login.HANDSHAKE_TIMEOUT_S", 2.0)
    with pytest.raises(Unreachable, match=f"pot: {complaint}") as caught:
        log_in(sshd, identity_files=(str(own_key(sshd)),), proxy_command=command)
    assert caught.value.kind == "jump"
