"""Servers that misbehave: each kind of failure is reported as such, and none blocks the caller."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from subprocess import Popen
from typing import TYPE_CHECKING, Any

import psutil
import pytest

from lupin_cli.connection.base import (
    AuthenticationFailed,
    PrivateKeyMissing,
    PrivateKeyUnusable,
    Script,
    TargetError,
    Unreachable,
)
from lupin_cli.connection.connect import first_reachable
from lupin_cli.connection.destination import Destination
from lupin_cli.connection.host_keys import KnownHosts
from lupin_cli.connection.ssh import SshTarget
from tests.support.waiting import wait_until

from .conftest import start_sshd

if TYPE_CHECKING:
    from .conftest import Sshd

Behavior = Callable[[socket.socket], None]


@contextlib.contextmanager
def server(behave: Behavior) -> Iterator[int]:
    """Run a TCP server on loopback that calls `behave` with each connection; yield its port."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            with contextlib.suppress(OSError):
                while True:
                    threading.Thread(target=_guarded, args=(behave, listener.accept()[0]), daemon=True).start()

        threading.Thread(target=serve, daemon=True).start()
        yield listener.getsockname()[1]
        listener.shutdown(socket.SHUT_RDWR)


def _guarded(behave: Behavior, connection: socket.socket) -> None:
    with connection, contextlib.suppress(OSError):
        behave(connection)


def reset(connection: socket.socket) -> None:
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


def wait_for_end(connection: socket.socket) -> None:
    while connection.recv(4096):
        pass


def silent(connection: socket.socket) -> None:
    wait_for_end(connection)


def hangs_up(connection: socket.socket) -> None:
    connection.close()


def resets_in_banner(connection: socket.socket) -> None:
    connection.sendall(b"SSH-2.0-Open")
    time.sleep(0.1)
    reset(connection)


def resets_at_once(connection: socket.socket) -> None:
    reset(connection)


def hangs_after_banner(connection: socket.socket) -> None:
    connection.sendall(b"SSH-2.0-OpenSSH_9.0\r\n")
    wait_for_end(connection)


def speaks_http(connection: socket.socket) -> None:
    connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")


def target_at(port: int, tmp_path: Path, **more: float) -> SshTarget:
    known_hosts = KnownHosts(tmp_path / "own", tmp_path / "users", confirm=lambda _: True)
    return SshTarget(
        "robot",
        Destination("127.0.0.1", port, "mirte", identities_only=True),
        known_hosts,
        connect_timeout_s=1.0,
        **more,  # type: ignore[arg-type]
    )


@pytest.mark.parametrize(
    ("behave", "kind"),
    [
        (silent, "silent"),
        (hangs_up, "lost"),
        (resets_in_banner, "lost"),
        (resets_at_once, "lost"),
        (speaks_http, "lost"),
    ],
)
def test_server_without_ssh_banner_is_classified(behave: Behavior, kind: str, tmp_path: Path) -> None:
    with server(behave) as port, pytest.raises(Unreachable) as caught:
        target_at(port, tmp_path).connect()
    assert caught.value.kind == kind


def test_server_that_hangs_after_its_banner_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lupin_cli.connection.login.HANDSHAKE_TIMEOUT_S", 1.0)
    with server(hangs_after_banner) as port, pytest.raises(Unreachable) as caught:
        target_at(port, tmp_path).connect()
    assert caught.value.kind in ("silent", "lost")


def test_closed_port_is_refused(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(Unreachable) as caught:
        target_at(port, tmp_path).connect()
    assert caught.value.kind == "refused"


def test_unknown_host_name_is_reported(tmp_path: Path) -> None:
    target = SshTarget("robot", Destination("no-such-host.invalid", 22, "mirte"), KnownHosts(tmp_path / "o", tmp_path / "u"))
    with pytest.raises(Unreachable) as caught:
        target.connect()
    assert caught.value.kind == "name"


def make_namespace(name: str) -> None:
    """Create a network namespace, or skip: in some containers and chroots that is not allowed."""
    for command in (["add", name], ["exec", name, "true"]):
        done = subprocess.run(["ip", "netns", *command], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            subprocess.run(["ip", "netns", "delete", name], capture_output=True, check=False)
            pytest.skip(f"no network namespaces here: {done.stderr.strip()}")


@pytest.fixture
def own_namespace() -> Iterator[Callable[[Callable[[], None]], None]]:
    """Yield a function that runs another one on a thread in a new network namespace: one interface, no default route."""
    if os.geteuid() != 0:
        pytest.skip("needs root: it creates a network namespace")
    name = f"lupin-reach-{os.getpid()}"
    make_namespace(name)
    ip_in_namespace = ["ip", "netns", "exec", name, "ip"]
    for command in (["link", "add", "br0", "type", "bridge"], ["addr", "add", "10.42.0.2/24", "dev", "br0"]):
        subprocess.run([*ip_in_namespace, *command], check=True)
    subprocess.run([*ip_in_namespace, "link", "set", "br0", "up"], check=True)

    def enter(function: Callable[[], None]) -> None:
        failures: list[BaseException] = []

        def body() -> None:
            from pyroute2 import netns

            try:
                netns.setns(name)
                function()
            except BaseException as error:  # handed to the test
                failures.append(error)

        thread = threading.Thread(target=body)
        thread.start()
        thread.join(60)
        assert not thread.is_alive()
        if failures:
            raise failures[0]

    yield enter
    subprocess.run(["ip", "netns", "delete", name], check=True)


def test_lost_link_is_no_route_and_unused_address_timeout(own_namespace: Callable[..., Any], tmp_path: Path) -> None:
    kinds = {}

    def attempt(host: str) -> None:
        known_hosts = KnownHosts(tmp_path / "own", tmp_path / "users")
        target = SshTarget("robot", Destination(host, 22, "mirte"), known_hosts, connect_timeout_s=1.0)
        with pytest.raises(Unreachable) as caught:
            target.connect()
        kinds[host] = caught.value.kind

    own_namespace(lambda: attempt("192.168.42.1"))  # no route to that network, as after roaming
    own_namespace(lambda: attempt("10.42.0.77"))  # a route, but no machine at the address
    assert kinds == {"192.168.42.1": "no-route", "10.42.0.77": "timeout"}


def test_wrong_key_error_names_ssh_copy_id(sshd: Sshd, tmp_path: Path) -> None:
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(tmp_path / "id")], check=True)
    target = SshTarget("robot", replace(sshd.destination, identity_files=(str(tmp_path / "id"),)), sshd.known_hosts())
    with pytest.raises(AuthenticationFailed) as caught:
        target.connect()
    assert caught.value.next_command == (
        f"ssh-copy-id -i {tmp_path}/id -p {sshd.port} {sshd.destination.user}@{sshd.destination.host}"
    )


def test_user_without_any_key_is_told_to_create_one(sshd: Sshd, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("SSH_AUTH_SOCK", raising=False)
    target = SshTarget("robot", replace(sshd.destination, identity_files=()), sshd.known_hosts())
    with pytest.raises(AuthenticationFailed) as caught:
        target.connect()
    assert caught.value.next_command.startswith(f"ssh-keygen -t ed25519 && ssh-copy-id -p {sshd.port} ")


@pytest.fixture
def impatient_sshd(tmp_path: Path) -> Iterator[tuple[Sshd, Callable[[], None]]]:
    """Yield an sshd that closes a connection a second after it was opened without a login, and a wait for that."""
    process, server = start_sshd(tmp_path, extra="LoginGraceTime 1\nPasswordAuthentication yes\n")
    parent = psutil.Process(process.pid)

    def wait_for_close() -> None:
        assert parent.children()
        wait_until(lambda: not parent.children(), "the end of the connection's process")

    yield server, wait_for_close
    process.terminate()
    process.wait(60)


def test_login_succeeds_after_a_host_key_question_of_minutes(
    impatient_sshd: tuple[Sshd, Callable[[], None]], tmp_path: Path
) -> None:
    server, wait_for_close = impatient_sshd
    questions: list[str] = []

    def answer_late(question: str) -> bool:
        questions.append(question)
        wait_for_close()
        return True

    known_hosts = KnownHosts(tmp_path / "own", tmp_path / "users", confirm=answer_late)
    target = SshTarget("robot", server.destination, known_hosts)
    assert target.batch([Script("one", "echo one")])["one"].stdout == "one\n"
    target.close()
    assert len(questions) == 1


def test_password_is_tried_after_a_question_of_minutes(impatient_sshd: tuple[Sshd, Callable[[], None]]) -> None:
    server, wait_for_close = impatient_sshd
    questions: list[str] = []

    def answer_late(question: str) -> str:
        questions.append(question)
        wait_for_close()
        return "not the password"

    destination = replace(server.destination, identity_files=())
    target = SshTarget("robot", destination, server.known_hosts(), ask_password=answer_late)
    with pytest.raises(AuthenticationFailed, match="nor the password"):
        target.connect()
    assert len(questions) == 1


@pytest.mark.parametrize(
    "text", ["garbage", "-----BEGIN OPENSSH PRIVATE KEY-----\nbm90IGEga2V5\n-----END OPENSSH PRIVATE KEY-----\n"]
)
def test_damaged_private_key_is_named_with_its_file(sshd: Sshd, tmp_path: Path, text: str) -> None:
    key = tmp_path / "id"
    key.write_text(text)
    target = SshTarget("robot", replace(sshd.destination, identity_files=(str(key),)), sshd.known_hosts())
    with pytest.raises(PrivateKeyUnusable, match=str(key)) as caught:
        target.connect()
    assert caught.value.next_command == f"ssh-keygen -y -f {key}"
    assert subprocess.run(caught.value.next_command.split(), capture_output=True).returncode != 0


def test_user_without_any_key_is_no_fault_of_the_robot(sshd: Sshd, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SSH_AUTH_SOCK", raising=False)
    destination = replace(sshd.destination, identity_files=("/nowhere/id",), identities_only=True)
    with pytest.raises(PrivateKeyMissing, match="no private key"):
        SshTarget("robot", destination, sshd.known_hosts()).connect()


def test_dead_proxy_command_is_not_the_robot(sshd: Sshd) -> None:
    destination = replace(sshd.destination, proxy_command="false")
    with (
        contextlib.closing(SshTarget("robot", destination, sshd.known_hosts())) as target,
        pytest.raises(Unreachable, match=r"its ProxyCommand does not work: false .*status 1") as caught,
    ):
        target.connect()
    assert caught.value.kind == "jump"


def test_dead_jump_host_is_not_the_robot(sshd: Sshd) -> None:
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = unused.getsockname()[1]
    jump = replace(sshd.destination, port=port)
    target = SshTarget("robot", replace(sshd.destination, jumps=(jump,)), sshd.known_hosts())
    with pytest.raises(Unreachable, match="jump host") as caught:
        target.connect()
    assert caught.value.kind == "jump" and f":{port}" in str(caught.value)


class Relay:
    """A relay to an sshd that can be cut like a cable (silence in both directions) or reset like a rebooting host."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._open = threading.Event()
        self._open.set()
        self._sockets: list[socket.socket] = []

    def carry(self, near: socket.socket) -> None:
        with socket.create_connection(("127.0.0.1", self._port)) as far:
            self._sockets += [near, far]
            other = threading.Thread(target=self._pump, args=(far, near), daemon=True)
            other.start()
            self._pump(near, far)
            other.join()

    def _pump(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                self._open.wait()
                sink.sendall(data)
            sink.shutdown(socket.SHUT_WR)

    def cut(self) -> None:
        self._open.clear()

    def heal(self) -> None:
        self._open.set()

    def reset(self) -> None:
        # A client that sees the first reset may connect again at once: its new connection must not be reset.
        sockets, self._sockets = self._sockets, []
        for each in sockets:
            with contextlib.suppress(OSError):  # closed already
                reset(each)
                each.shutdown(socket.SHUT_RDWR)
            each.close()


def test_reset_during_batch_keeps_output_and_reconnects(sshd: Sshd) -> None:
    relay = Relay(sshd.port)
    with server(relay.carry) as port:
        target = SshTarget("robot", replace(sshd.destination, port=port), sshd.known_hosts())
        target.connect()
        threading.Timer(4.0, relay.reset).start()
        outputs = target.batch([Script("quick", "echo heard"), Script("slow", "sleep 130", 140.0)], timeout_s=150)
        assert outputs["quick"].stdout == "heard\n" and outputs["slow"].status is None
        assert "link" in outputs["slow"].stderr
        assert target.batch([Script("again", "echo back")])["again"].stdout == "back\n"
        target.close()


def test_half_open_connection_is_given_up_at_the_timeout(sshd: Sshd) -> None:
    relay = Relay(sshd.port)
    with server(relay.carry) as port:
        target = SshTarget("robot", replace(sshd.destination, port=port), sshd.known_hosts(), connect_timeout_s=1.0)
        target.connect()
        relay.cut()
        for attempt in (
            lambda: target.batch([Script("a", "echo a")], timeout_s=1.0)["a"].status,
            lambda: target.run("echo a", timeout_s=1.0).status,
        ):
            try:
                assert attempt() is None  # type: ignore[no-untyped-call]
            except Unreachable as error:  # a new connection through the cut relay
                assert error.kind == "silent"
        target.close()
        relay.heal()


@pytest.mark.parametrize("what", ["run", "batch"])
def test_silent_connection_is_given_up_before_a_long_timeout(
    sshd: Sshd, what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lupin_cli.connection.keepalive.KEEPALIVE_AFTER_S", 0.3)
    monkeypatch.setattr("lupin_cli.connection.keepalive.ANSWER_TIMEOUT_S", 1.5)
    relay = Relay(sshd.port)
    with server(relay.carry) as port:
        target = SshTarget("robot", replace(sshd.destination, port=port), sshd.known_hosts(), connect_timeout_s=1.0)
        target.connect()
        begun = tmp_path / "begun"
        threading.Thread(target=lambda: (wait_until(begun.exists, "the command"), relay.cut())).start()  # type: ignore[func-returns-value]
        try:
            if what == "run":
                reason = target.run(f"touch {begun}; sleep 300", timeout_s=300).stderr
            else:
                reason = target.batch([Script("slow", f"touch {begun}; sleep 300", 300.0)], timeout_s=300)["slow"].stderr
        except Unreachable as error:  # a batch of which nothing had arrived
            reason = str(error)
        assert "has not replied for 1.5 s" in reason
        relay.heal()
        target.close()


def test_silent_script_on_answering_connection_is_awaited(sshd: Sshd, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lupin_cli.connection.keepalive.KEEPALIVE_AFTER_S", 0.1)
    monkeypatch.setattr("lupin_cli.connection.keepalive.ANSWER_TIMEOUT_S", 1.5)
    target = SshTarget("robot", sshd.destination, sshd.known_hosts())
    assert target.run("sleep 2.5; echo there", timeout_s=60).stdout == "there\n"
    target.close()


@pytest.mark.parametrize("after_s", [0.0, 0.05, 0.3])
def test_link_cut_during_write_keeps_old_or_new_file(sshd: Sshd, tmp_path: Path, after_s: float) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"old")
    new = os.urandom(1 << 20) * 24
    relay = Relay(sshd.port)
    with server(relay.carry) as port:
        target = SshTarget("robot", replace(sshd.destination, port=port), sshd.known_hosts())
        target.connect()
        threading.Timer(after_s, relay.reset).start()
        try:
            target.put(str(path), new, root=True, timeout_s=20)
        except TargetError:
            assert path.read_bytes() in (b"old", new)  # the answer may be lost after the rename
        else:
            assert path.read_bytes() == new
        target.close()


def test_hung_sshd_is_reported_as_silent(own_sshd: tuple[Popen[str], Sshd]) -> None:
    process, hung = own_sshd
    process.send_signal(signal.SIGSTOP)
    with pytest.raises(Unreachable) as caught:
        SshTarget("robot", hung.destination, hung.known_hosts(), connect_timeout_s=1.0).connect()
    assert caught.value.kind == "silent"


def test_first_reachable_returns_best_address_that_answers(sshd: Sshd) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        dead = listener.getsockname()[1]
    choices = {
        "wired": replace(sshd.destination, port=dead),
        "router": sshd.destination,
        "ap": sshd.destination,
    }
    assert first_reachable(choices) == "router"
    assert first_reachable({"wired": choices["ap"], **{k: choices[k] for k in ("router", "ap")}}) == "wired"
    # If none answers it is the first, so that connecting to it reports the reason.
    assert first_reachable({"wired": choices["wired"], "ap": choices["wired"]}) == "wired"
