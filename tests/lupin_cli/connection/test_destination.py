"""~/.ssh/config is read as ssh itself reads it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from lupin_cli.connection.base import Script, SshConfigUnusable
from lupin_cli.connection.connect import unreachable
from lupin_cli.connection.destination import Destination, parse_destination, resolve
from lupin_cli.connection.ssh import SshTarget
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from tests.lupin_cli.connection.conftest import Sshd

CONFIG = """\
Include more/*.conf
Host lupin-wired
    HostName 10.42.0.1
    User mirte
    Port 2222
    IdentityFile ~/.ssh/robot_key
    IdentitiesOnly yes
Host behind
    HostName 192.168.42.1
    ProxyJump gate,operator@lupin-wired
Host *
    User somebody
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "gate.conf").write_text("Host gate\n  HostName gate.example\n  Port 22022\n\nHost *\n")
    path = tmp_path / "config"
    path.write_text(CONFIG)
    return path


@pytest.mark.parametrize("host", ["lupin-wired", "behind", "gate", "10.9.9.9"])
def test_resolve_agrees_with_ssh(config: Path, host: str) -> None:
    if shutil.which("ssh") is None:
        pytest.skip("needs ssh: apt install openssh-client")
    # ssh searches relative includes in ~/.ssh, so it gets the same file with absolute paths.
    config.with_name("absolute").write_text(CONFIG.replace("more/", f"{config.parent}/more/"))
    printed = subprocess.run(
        ["ssh", "-F", str(config.with_name("absolute")), "-G", host], capture_output=True, text=True, check=True
    ).stdout
    expected = dict(line.split(" ", 1) for line in printed.splitlines() if " " in line)
    found = resolve(host, config_path=config)
    assert (found.host, found.user, str(found.port)) == (expected["hostname"], expected["user"], expected["port"])
    assert found.identities_only == (expected["identitiesonly"] == "yes")


def test_jumps_are_resolved_in_order(config: Path) -> None:
    found = resolve("behind", config_path=config)
    assert [str(hop) for hop in found.jumps] == ["somebody@gate.example:22022", "operator@10.42.0.1:2222"]


def test_user_and_port_of_inventory_override_ssh_config(config: Path) -> None:
    found = resolve("lupin-wired", user="root", port=22, config_path=config)
    assert (found.user, found.port) == ("root", 22)


def test_default_user_is_used_if_no_user_is_named(tmp_path: Path) -> None:
    assert resolve("10.42.0.1", default_user="mirte", config_path=tmp_path / "none").user == "mirte"


def test_circular_proxy_jump_is_refused(tmp_path: Path) -> None:
    (tmp_path / "config").write_text("Host a\n ProxyJump b\nHost b\n ProxyJump a\n")
    with pytest.raises(SshConfigUnusable, match="circle"):
        resolve("a", config_path=tmp_path / "config")


def test_jump_of_every_host_jumps_in_a_circle(tmp_path: Path) -> None:
    (tmp_path / "config").write_text("Host *\n  ProxyJump nobody@10.42.0.138\n")
    with pytest.raises(SshConfigUnusable, match=r"config: jumphost loop via 10\.42\.0\.138"):
        resolve("10.42.0.1", config_path=tmp_path / "config")


def test_config_that_includes_itself_is_refused(tmp_path: Path) -> None:
    (tmp_path / "config").write_text(f"Include {tmp_path}/config\nHost a\n Port 7\n")
    with pytest.raises(SshConfigUnusable, match="config: Too many recursive"):
        resolve("a", config_path=tmp_path / "config")


DIRECTIVES = st.sampled_from(
    [
        "Host *",
        "Host pot-?",
        "Host pot-1 pot-2",
        "# HostName elsewhere",
        "",
        "IdentitiesOnly yes",
        "IdentityFile ~/.ssh/pot",
        "HostName 10.0.0.9",
        "hostname=10.0.0.9",
        "  Port 2222",
        "User root",
        "\tproxyjump gate",
        "ProxyCommand nc %h %p",
        "Match host pot-1",
        "ServerAliveInterval 5",
        "Compression yes",
        "Include {folder}/more",
    ]
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(DIRECTIVES, max_size=6), st.lists(DIRECTIVES.filter(lambda line: "Include" not in line), max_size=3))
def test_resolve_changes_only_what_directives_name(tmp_path: Path, lines: list[str], more: list[str]) -> None:
    (tmp_path / "more").write_text("\n".join(more))
    config = tmp_path / "config"
    config.write_text("\n".join(lines).format(folder=tmp_path))
    read = [*lines, *(more if any("Include" in line for line in lines) else ())]
    assume("\tproxyjump gate" not in read)  # the gate would jump through itself
    found = resolve("pot-1", "mirte", 22022, config_path=config)
    assert (found.user, found.port, found.original_host) == ("mirte", 22022, "pot-1")  # arguments win over the file
    if not any(line.strip().lower().startswith(("hostname", "proxy", "match")) for line in read):
        assert (found.host, found.jumps, found.proxy_command) == ("pot-1", (), "")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("10.42.0.1", ("", "10.42.0.1", 0)),
        ("mirte@10.42.0.1:2222", ("mirte", "10.42.0.1", 2222)),
        ("mirte@[fe80::1%eth0]:22", ("mirte", "fe80::1%eth0", 22)),
        ("lupin-wired", ("", "lupin-wired", 0)),
    ],
)
def test_destination_is_parsed(text: str, expected: tuple[str, str, int]) -> None:
    assert parse_destination(text) == expected


@pytest.mark.parametrize("text", ["mirte@10.42.0.1", "mirte@10.42.0.1:2222", "mirte@[fe80::1%eth0]", "mirte@[::1]:1"])
def test_destination_is_written_as_it_is_parsed(text: str) -> None:
    user, host, port = parse_destination(text)
    assert str(Destination(host, port or 22, user)) == text
    assert unreachable(text, "timeout").next_command == f"ping -c 3 {host}"


@pytest.mark.parametrize("text", ["", "a b", "host:0", "host:65536", "host:x", "@host", "a@b@c", "[fe80::1"])
def test_malformed_destination_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="expected"):
        parse_destination(text)


def test_robot_is_reached_through_jump_host(sshd: Sshd) -> None:
    jump = replace(sshd.destination, original_host="robot")
    target = SshTarget("robot", replace(sshd.destination, host="localhost", jumps=(jump,)), sshd.known_hosts())
    assert target.batch([Script("who", "echo $SSH_CONNECTION")])["who"].stdout.startswith(("127.0.0.1 ", "::1 "))
    target.close()


def test_robot_is_reached_through_proxy_command(sshd: Sshd) -> None:
    # A relay in sh would need nc, which not every machine has.
    relay = sshd.directory / "relay.py"
    relay.write_text(
        "import os, socket, sys, threading\n"
        f"s = socket.create_connection(('127.0.0.1', {sshd.port}))\n"
        "def up():\n"
        "    while data := os.read(0, 65536):\n"
        "        s.sendall(data)\n"
        "threading.Thread(target=up, daemon=True).start()\n"
        "while data := s.recv(65536):\n"
        "    os.write(1, data)\n"
    )
    command = f"{sys.executable} {relay}"
    target = SshTarget("robot", replace(sshd.destination, host="nowhere.invalid", proxy_command=command), sshd.known_hosts())
    assert target.batch([Script("hello", "echo hello")])["hello"].stdout == "hello\n"
    target.close()


def test_key_of_the_agent_logs_in(sshd: Sshd, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    agent = subprocess.Popen(["ssh-agent", "-D", "-a", str(tmp_path / "agent")], stdout=subprocess.DEVNULL)
    try:
        monkeypatch.setenv("SSH_AUTH_SOCK", str(tmp_path / "agent"))
        wait_until((tmp_path / "agent").exists, "the agent's socket")
        subprocess.run(["ssh-add", "-q", str(sshd.directory / "id_ed25519")], check=True, timeout=60)
        destination = replace(sshd.destination, identity_files=(), identities_only=False)
        target = SshTarget("robot", destination, sshd.known_hosts())
        assert target.batch([Script("hello", "echo hello")])["hello"].stdout == "hello\n"
        target.close()
    finally:
        agent.terminate()
        agent.wait(60)


@pytest.mark.parametrize(("command", "host"), [("true", "10.9.8.7"), ("false", "robot")])
def test_match_exec_line_is_obeyed(tmp_path: Path, command: str, host: str) -> None:
    (tmp_path / "config").write_text(f'Match host robot exec "{command}"\n  HostName 10.9.8.7\n')
    argument = f"config_path=Path({str(tmp_path / 'config')!r})"
    program = "from pathlib import Path; from lupin_cli.connection.destination import resolve"
    program += f"; print(resolve('robot', user='u', {argument}).host)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == host
