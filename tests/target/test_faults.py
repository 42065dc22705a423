"""Servers that misbehave for real: each way of failing is told from the others, and none hangs."""

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

import pytest

from lupin_cli.target.base import AuthenticationFailed, Script, TargetError, Unreachable
from lupin_cli.target.destination import Destination
from lupin_cli.target.reach import best_of
from lupin_cli.target.ssh import SshTarget
from lupin_cli.target.trust import Trust

Behaviour = Callable[[socket.socket], None]


@contextlib.contextmanager
def server(behave: Behaviour) -> Iterator[int]:
    """A TCP server on loopback that treats each connection as `behave` does."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            with contextlib.suppress(OSError):
                while True:
                    threading.Thread(target=_guarded, args=(behave, listener.accept()[0]), daemon=True).start()

        threading.Thread(target=serve, daemon=True).start()
        yield listener.getsockname()[1]
        listener.shutdown(socket.SHUT_RDWR)


def _guarded(behave: Behaviour, connection: socket.socket) -> None:
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


def resets_in_greeting(connection: socket.socket) -> None:
    connection.sendall(b"SSH-2.0-Open")
    time.sleep(0.1)
    reset(connection)


def resets_at_once(connection: socket.socket) -> None:
    reset(connection)


def stops_after_greeting(connection: socket.socket) -> None:
    connection.sendall(b"SSH-2.0-OpenSSH_9.0\r\n")
    wait_for_end(connection)


def speaks_http(connection: socket.socket) -> None:
    connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")


def target_at(port: int, tmp_path: Path, **more: float) -> SshTarget:
    trust = Trust(tmp_path / "own", tmp_path / "users", ask=lambda _: True)
    return SshTarget(
        "robot", Destination("127.0.0.1", port, "mirte", identities_only=True), trust, connect_timeout_s=1.0, **more
    )


@pytest.mark.parametrize(
    ("behave", "kind"),
    [
        (silent, "silent"),
        (hangs_up, "lost"),
        (resets_in_greeting, "lost"),
        (resets_at_once, "lost"),
        (speaks_http, "lost"),
    ],
)
def test_a_server_that_never_gets_to_ssh_is_told_by_how(behave: Behaviour, kind: str, tmp_path: Path) -> None:
    start = time.monotonic()
    with server(behave) as port, pytest.raises(Unreachable) as caught:
        target_at(port, tmp_path).connect()
    assert caught.value.kind == kind
    assert time.monotonic() - start < 25


def test_a_server_that_stops_after_its_greeting_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lupin_cli.target.ssh._HANDSHAKE_S", 1.0)
    with server(stops_after_greeting) as port, pytest.raises(Unreachable) as caught:
        target_at(port, tmp_path).connect()
    assert caught.value.kind in ("silent", "lost")


def test_a_closed_port_is_refused(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(Unreachable) as caught:
        target_at(port, tmp_path).connect()
    assert caught.value.kind == "refused"


def test_a_name_that_nobody_knows_is_a_name(tmp_path: Path) -> None:
    target = SshTarget("robot", Destination("no-such-host.invalid", 22, "mirte"), Trust(tmp_path / "o", tmp_path / "u"))
    with pytest.raises(Unreachable) as caught:
        target.connect()
    assert caught.value.kind == "name"


def make_namespace(name: str) -> None:
    """Make it, or skip where this machine lets nobody in: a chroot has no mount to start from."""
    for command in (["add", name], ["exec", name, "true"]):
        done = subprocess.run(["ip", "netns", *command], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            subprocess.run(["ip", "netns", "delete", name], capture_output=True, check=False)
            pytest.skip(f"no network namespaces here: {done.stderr.strip()}")


@pytest.fixture
def own_namespace() -> Iterator[Callable[[Callable[[], None]], None]]:
    """Runs a function on a thread in a network namespace of the test's own: one interface, no way further."""
    if os.geteuid() != 0:
        pytest.skip("needs root: it makes a network namespace")
    name = f"lupin-reach-{os.getpid()}"
    make_namespace(name)
    inside = ["ip", "netns", "exec", name, "ip"]
    for command in (["link", "add", "br0", "type", "bridge"], ["addr", "add", "10.42.0.2/24", "dev", "br0"]):
        subprocess.run([*inside, *command], check=True)
    subprocess.run([*inside, "link", "set", "br0", "up"], check=True)

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


def test_a_lost_link_is_no_route_and_an_empty_address_no_answer(own_namespace, tmp_path: Path) -> None:
    kinds = {}

    def attempt(host: str) -> None:
        trust = Trust(tmp_path / "own", tmp_path / "users")
        target = SshTarget("robot", Destination(host, 22, "mirte"), trust, connect_timeout_s=1.0)
        with pytest.raises(Unreachable) as caught:
            target.connect()
        kinds[host] = caught.value.kind

    own_namespace(lambda: attempt("192.168.42.1"))  # no route to that network: the laptop roamed
    own_namespace(lambda: attempt("10.42.0.77"))  # the network is there, and nobody at the address
    assert kinds == {"192.168.42.1": "no-route", "10.42.0.77": "timeout"}


def test_a_user_with_the_wrong_key_is_told_how_to_give_a_right_one(sshd, tmp_path: Path) -> None:
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(tmp_path / "id")], check=True)
    target = SshTarget("robot", replace(sshd.destination, identity_files=(str(tmp_path / "id"),)), sshd.trust())
    with pytest.raises(AuthenticationFailed) as caught:
        target.connect()
    assert caught.value.next_command.startswith(f"ssh-copy-id -p {sshd.port}")


class Cable:
    """A relay to an sshd that can be cut, as a cable is: silence both ways, or a reset as of a rebooting host."""

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
        for end in self._sockets:
            with contextlib.suppress(OSError):  # it has ended by itself
                reset(end)
                end.shutdown(socket.SHUT_RDWR)
            end.close()


def test_a_robot_that_goes_down_in_mid_batch_leaves_what_was_heard_and_is_found_again(sshd) -> None:
    cable = Cable(sshd.port)
    with server(cable.carry) as port:
        target = SshTarget("robot", replace(sshd.destination, port=port), sshd.trust())
        target.connect()
        threading.Timer(4.0, cable.reset).start()
        start = time.monotonic()
        outputs = target.batch([Script("quick", "echo heard"), Script("slow", "sleep 30", 40.0)], bound_s=50)
        assert time.monotonic() - start < 29
        assert outputs["quick"].stdout == "heard\n" and outputs["slow"].status is None
        assert "link" in outputs["slow"].stderr
        assert target.batch([Script("again", "echo back")])["again"].stdout == "back\n"
        target.close()


def test_a_half_open_connection_is_given_up_at_the_bound(sshd) -> None:
    cable = Cable(sshd.port)
    with server(cable.carry) as port:
        target = SshTarget("robot", replace(sshd.destination, port=port), sshd.trust(), connect_timeout_s=1.0)
        target.connect()
        cable.cut()
        for attempt in (
            lambda: target.batch([Script("a", "echo a")], bound_s=1.0)["a"].status,
            lambda: target.run("echo a", bound_s=1.0).status,
        ):
            start = time.monotonic()
            try:
                assert attempt() is None
            except Unreachable as error:  # a new connection through the cut cable
                assert error.kind == "silent"
            assert time.monotonic() - start < 20
        target.close()
        cable.heal()


def _exists(path: Path, limit_s: float = 30.0) -> None:
    deadline = time.monotonic() + limit_s
    while not path.exists() and time.monotonic() < deadline:
        time.sleep(0.02)


@pytest.mark.parametrize("what", ["run", "batch"])
def test_a_connection_that_answers_nothing_is_given_up_long_before_a_long_steps_bound(
    sshd, what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lupin_cli.target.keepalive.ASK_AFTER_S", 0.3)
    monkeypatch.setattr("lupin_cli.target.keepalive.ANSWER_S", 1.5)
    cable = Cable(sshd.port)
    with server(cable.carry) as port:
        target = SshTarget("robot", replace(sshd.destination, port=port), sshd.trust(), connect_timeout_s=1.0)
        target.connect()
        begun = tmp_path / "begun"
        threading.Thread(target=lambda: (_exists(begun), cable.cut())).start()
        start = time.monotonic()
        try:
            if what == "run":
                said = target.run(f"touch {begun}; sleep 300", bound_s=300).stderr
            else:
                said = target.batch([Script("slow", f"touch {begun}; sleep 300", 300.0)], bound_s=300)["slow"].stderr
        except Unreachable as error:  # of a batch that was not heard of yet
            said = str(error)
        assert time.monotonic() - start < 60
        assert "has answered nothing for 1.5 s" in said
        cable.heal()
        target.close()


def test_a_silent_script_on_a_connection_that_answers_is_waited_for(sshd, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lupin_cli.target.keepalive.ASK_AFTER_S", 0.1)
    monkeypatch.setattr("lupin_cli.target.keepalive.ANSWER_S", 1.5)
    target = SshTarget("robot", sshd.destination, sshd.trust())
    assert target.run("sleep 2.5; echo there", bound_s=60).stdout == "there\n"
    target.close()


@pytest.mark.parametrize("after_s", [0.0, 0.05, 0.3])
def test_a_link_that_is_cut_while_a_file_is_written_leaves_the_old_one_whole(sshd, tmp_path: Path, after_s: float) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"old")
    new = os.urandom(1 << 20) * 24
    cable = Cable(sshd.port)
    with server(cable.carry) as port:
        target = SshTarget("robot", replace(sshd.destination, port=port), sshd.trust())
        target.connect()
        threading.Timer(after_s, cable.reset).start()
        try:
            target.put(str(path), new, root=True, bound_s=20)
        except TargetError:
            assert path.read_bytes() in (b"old", new)  # the last word may be lost after the deed
        else:
            assert path.read_bytes() == new
        target.close()


def test_a_hung_sshd_is_silent(own_sshd) -> None:
    process, hung = own_sshd
    process.send_signal(signal.SIGSTOP)
    with pytest.raises(Unreachable) as caught:
        SshTarget("robot", hung.destination, hung.trust(), connect_timeout_s=1.0).connect()
    assert caught.value.kind == "silent"


def test_of_several_addresses_the_best_that_answers_is_used(sshd) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        dead = listener.getsockname()[1]
    places = {
        "wired": replace(sshd.destination, port=dead),
        "router": sshd.destination,
        "ap": sshd.destination,
    }
    assert best_of(places)[0] == "router"
    assert best_of({"wired": places["ap"], **{k: places[k] for k in ("router", "ap")}})[0] == "wired"
    # Where none answers, the first is tried again, to say why.
    assert best_of({"wired": places["wired"], "ap": places["wired"]})[0] == "wired"
