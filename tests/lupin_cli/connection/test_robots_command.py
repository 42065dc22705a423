"""`lupin robots` against a real sshd. The next commands that errors name are executed as printed."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

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
    assert first.returncode == 3 and "that nobody has accepted yet" in first.stderr
    accepted = lupin(home, *next_command(first), "--json")
    assert accepted.returncode == 0, accepted.stderr
    (answer,) = json.loads(accepted.stdout)
    assert answer["reached"] and answer["transport"] == "wired" and answer["root"] and answer["rtt_ms"] > 0.0
    assert lupin(home, "robots", "check", "pot-1").returncode == 0
    assert json.loads(lupin(home, "robots", "list", "--json").stdout)["robots"][0]["host_key_accepted"]

    assert "forgot pot-1" in lupin(home, "robots", "forget", "pot-1").stdout
    assert lupin(home, "robots", "check").returncode == 3
    lupin(home, "robots", "forget", "pot-1", "--remove")
    assert "pot-1" not in (home / ".config" / "lupin" / "lupin.toml").read_text()


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


def test_inventory_error_exits_with_usage_code(home: Path) -> None:
    (home / "my.toml").write_text('[robots.pot-1]\nuser = "pi"\nadresses = {wired = "10.0.0.1"}\n')
    done = lupin(home, "robots", "list", "--config", str(home / "my.toml"))
    assert done.returncode == 2
    assert f"{home}/my.toml:3: " in done.stderr and "did you mean 'addresses'" in done.stderr
