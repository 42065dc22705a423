"""`lupin robots` against a real sshd. The next commands that errors name are executed as printed."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from typer.testing import CliRunner

from lupin_cli.app import app
from lupin_cli.commands import robots
from lupin_cli.commands.robots import CheckResult, _with_address
from lupin_cli.connection import options
from lupin_cli.connection.inventory import Robot, parse
from tests.lupin_cli.connection.conftest import start_sshd

if TYPE_CHECKING:
    from tests.lupin_cli.connection.conftest import Sshd


@pytest.fixture
def home(sshd: Sshd, tmp_path: Path) -> Path:
    (tmp_path / ".ssh").mkdir(mode=0o700)
    (tmp_path / ".ssh" / "config").write_text(
        f"Host pot\n  HostName 127.0.0.1\n  Port {sshd.port}\n  User {sshd.destination.user}\n"
        f"  IdentityFile {sshd.directory}/id_ed25519\n  IdentitiesOnly yes\n"
    )
    return tmp_path


def lupin(home: Path, *words: str) -> subprocess.CompletedProcess[str]:
    hidden = ("XDG_CONFIG_HOME", "LUPIN_CONFIG", "SSH_AUTH_SOCK")
    environment = {name: value for name, value in os.environ.items() if name not in hidden} | {"HOME": str(home)}
    command = [sys.executable, "-m", "lupin_cli.app", *words]
    return subprocess.run(command, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=90)


def next_command(done: subprocess.CompletedProcess[str]) -> list[str]:
    line = done.stderr.splitlines()[-1].strip()
    assert line.startswith("next: lupin "), done.stderr
    return shlex.split(line.removeprefix("next: lupin "))


def test_robot_is_added_checked_forgotten_and_removed(home: Path) -> None:
    assert lupin(home, "robots", "add", "pot-1", "pot").returncode == 0
    again = lupin(home, "robots", "add", "pot-1", "pot")
    assert again.returncode == 2 and "already" in again.stderr

    first = lupin(home, "robots", "check")
    assert first.returncode == 3 and "which was not accepted yet" in first.stderr
    accepted = lupin(home, *next_command(first), "--json")
    assert accepted.returncode == 0, accepted.stderr
    (answer,) = json.loads(accepted.stdout)
    assert answer["reached"] and answer["transport"] == "wired" and answer["root"] and answer["rtt_ms"] > 0.0
    assert lupin(home, "robots", "check", "pot-1").returncode == 0
    assert json.loads(lupin(home, "robots", "list", "--json").stdout)["robots"][0]["host_key_accepted"]

    assert "forgot pot-1" in lupin(home, "robots", "forget", "pot-1").stdout
    assert lupin(home, "robots", "check").returncode == 3
    assert lupin(home, *next_command(lupin(home, "robots", "check"))).returncode == 0

    inventory = home / ".config" / "lupin" / "lupin.toml"
    inventory.write_text(f'default_robot = "pot-1"  # ours\n{inventory.read_text()}')
    renamed = lupin(home, "robots", "rename", "pot-1", "greenhouse")
    assert renamed.returncode == 0 and "its host key stays accepted" in renamed.stdout
    assert inventory.read_text().startswith('default_robot = "greenhouse"  # ours\n') and "pot-1" not in inventory.read_text()
    assert lupin(home, "robots", "check").returncode == 0
    assert lupin(home, "robots", "rename", "pot-1", "other").returncode == 2

    assert "greenhouse" not in lupin(home, "robots", "remove", "greenhouse", "--dry-run").stdout
    assert "greenhouse" in inventory.read_text(), "a dry run writes nothing"
    removed = lupin(home, "robots", "remove", "greenhouse")
    assert "forgot [robots.greenhouse]" in removed.stdout and "forgot greenhouse in" in removed.stdout
    assert "greenhouse" not in inventory.read_text() + (home / ".config" / "lupin" / "known_hosts").read_text()


def test_check_all_reports_each_robot(home: Path, sshd: Sshd) -> None:
    (home / ".config" / "lupin").mkdir(parents=True)
    (home / ".config" / "lupin" / "known_hosts").write_text(f"pot-1 {sshd.host_key}\npot-2 {sshd.host_key}\n")
    text = "".join(
        f'[robots.{name}.addresses]\nwired = "{address}"\n'
        for name, address in (("pot-1", "pot"), ("pot-2", "pot"), ("pot-3", "nowhere.invalid"))
    )
    (home / ".config" / "lupin" / "lupin.toml").write_text(text)
    done = lupin(home, "robots", "check", "--all", "--json")
    assert done.returncode == 3
    assert {answer["robot"]: answer["reached"] for answer in json.loads(done.stdout)} == {
        "pot-1": True,
        "pot-2": True,
        "pot-3": False,
    }
    assert lupin(home, "robots", "check", "--all", "--limit", "pot-[12]").returncode == 0


@pytest.mark.parametrize(
    ("program", "problem"), [("kill -9 $PPID", "the connection was lost"), ("exit 0", "does not run commands")]
)
def test_check_of_a_robot_that_fails_after_the_login(home: Path, tmp_path: Path, program: str, problem: str) -> None:
    """It was reached: that is not the status of a robot that nothing can be asked."""
    process, server = start_sshd(tmp_path, extra=f"ForceCommand {program}\n")
    try:
        key = f"IdentityFile {server.directory}/id_ed25519"
        alias = f"Host dying\n  HostName 127.0.0.1\n  Port {server.port}\n  User {server.destination.user}\n  {key}\n"
        (home / ".ssh" / "config").write_text(alias)
        (home / ".config" / "lupin").mkdir(parents=True)
        (home / ".config" / "lupin" / "known_hosts").write_text(f"dying {server.host_key}\n")
        (home / ".config" / "lupin" / "lupin.toml").write_text('[robots.dying.addresses]\nwired = "dying"\n')
        done = lupin(home, "robots", "check", "--json")
    finally:
        process.terminate()
        process.wait(60)
    assert done.returncode == 1, done.stderr
    (answer,) = json.loads(done.stdout)
    assert answer["reached"] and problem in answer["error"] and answer["next_command"]


def test_inventory_error_exits_with_usage_code(home: Path) -> None:
    (home / "my.toml").write_text('[robots.pot-1]\nuser = "pi"\nadresses = {wired = "10.0.0.1"}\n')
    done = lupin(home, "robots", "list", "--config", str(home / "my.toml"))
    assert done.returncode == 2
    assert f"{home}/my.toml:3: " in done.stderr and "did you mean 'addresses'" in done.stderr


INVENTORY = """\
default_robot = "pot"  # ours
[robots.pot]
user = "pi"  # not mirte
transport = "wired"
[robots.pot.addresses]  # of both
wired = "10.0.0.1"  # the yellow cable
[robots.tin]
transport = "wired"
addresses = { wired = "10.0.0.2" }
"""


@pytest.mark.parametrize("name", ["pot", "tin"])
def test_second_address_keeps_the_rest_of_the_inventory(name: str, tmp_path: Path) -> None:
    path = tmp_path / "lupin.toml"
    after = _with_address(INVENTORY, path, name, "127.0.0.1:3", "router")
    assert after.startswith('default_robot = "pot"  # ours\n')
    before, found = parse(INVENTORY, path), parse(after, path)
    both = {**before.robots[name].addresses, "router": "127.0.0.1:3"}
    assert found == replace(before, robots={**before.robots, name: replace(before.robots[name], addresses=both)})
    if name == "pot":
        assert after.replace('router = "127.0.0.1:3"\n', "") == INVENTORY


def test_second_address_with_another_user_keeps_settings(tmp_path: Path) -> None:
    found = parse(_with_address(INVENTORY, tmp_path, "pot", "ada@127.0.0.1:3", "ap"), tmp_path)
    pot = found.robots["pot"]
    assert (found.default_robot, pot.user, pot.transport, list(pot.addresses)) == ("pot", "ada", "wired", ["wired", "ap"])


def test_each_robot_gets_its_own_sudo_password(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "lupin.toml"
    path.write_text(INVENTORY)
    asked: list[str] = []
    got: dict[str, str | None] = {}

    def check(robot: Robot, _config: object, _accept: str, password: str | None) -> CheckResult:
        got[robot.name] = password
        return CheckResult(robot.name, True, rtt_ms=1.0)

    monkeypatch.setattr(options, "is_interactive", lambda: True)
    monkeypatch.setattr(
        "getpass.getpass",
        lambda prompt: asked.append(prompt) or f"secret {len(asked)}",  # type: ignore[func-returns-value]
    )
    monkeypatch.setattr(robots, "_check", check)
    done = CliRunner().invoke(app, ["robots", "check", "--all", "-K", "--config", str(path)])
    assert done.exit_code == 0, done.output
    assert asked == ["sudo password on pot: ", "sudo password on tin: "]
    assert got == {"pot": "secret 1", "tin": "secret 2"}
