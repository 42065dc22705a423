"""The commands that errors print are pasted into a shell as they are, in the situation that printed them."""

from __future__ import annotations

import os
import shlex
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from .conftest import Sshd

PLAYBOOK = """name: {name}
description: A test.
steps:
- name: write a file
  on: laptop
  file: {{path: "{root}/{name}", content: x}}
"""
Shell = Callable[[str], subprocess.CompletedProcess[str]]


@pytest.fixture
def home(sshd: Sshd, tmp_path: Path) -> Path:
    """An operator's home folder, whose inventory has the robot `pot`, an address that refuses and one without a name."""
    (tmp_path / ".ssh").mkdir(mode=0o700)
    (tmp_path / ".ssh" / "config").write_text(
        f"Host pot\n  HostName 127.0.0.1\n  Port {sshd.port}\n  User {sshd.destination.user}\n"
        f"  IdentityFile {sshd.directory}/id_ed25519\n  IdentitiesOnly yes\n"
    )
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        port = closed.getsockname()[1]
    inventory = tmp_path / ".config" / "lupin" / "lupin.toml"
    inventory.parent.mkdir(parents=True)
    addresses = {"pot": "pot", "closed": f"127.0.0.1:{port}", "nameless": "nowhere.invalid"}
    inventory.write_text("".join(f'[robots.{name}.addresses]\nwired = "{at}"\n' for name, at in addresses.items()))
    (inventory.parent / "known_hosts").write_text(f"pot {sshd.host_key}\n")
    for name in ("mine", "other"):
        (tmp_path / f"{name}.yaml").write_text(PLAYBOOK.format(name=name, root=tmp_path))
    return tmp_path


@pytest.fixture
def shell(home: Path) -> Shell:
    """A function that runs a line as it is pasted into bash, where `lupin` is in the PATH."""
    programs = home / "bin"
    programs.mkdir()
    (programs / "lupin").write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m lupin_cli.app "$@"\n')
    (programs / "lupin").chmod(0o755)
    hidden = ("XDG_CONFIG_HOME", "XDG_STATE_HOME", "LUPIN_CONFIG", "SSH_AUTH_SOCK")
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    environment |= {"HOME": str(home), "PATH": f"{programs}:{os.environ['PATH']}"}

    def run(line: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["bash", "-c", line],
            env=environment,
            cwd=home,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=90,
        )

    return run


def printed_command(done: subprocess.CompletedProcess[str]) -> str:
    """Return the command after `next:`, which is on a line of its own."""
    commands = [line.partition("next: ")[2] for line in done.stderr.splitlines() if line.startswith("  next: ")]
    assert len(commands) == 1, done.stderr
    return commands[0]


@pytest.mark.parametrize(
    ("typed", "status"),
    [
        ("lupin robots check closed", 3),
        ("lupin robots check nameless", 3),
        ("lupin deploy robot --robot closed --no-check", 3),
        ("lupin robots list --config new/lupin.toml", 2),
        ("lupin play mine.yaml --undo latest", 2),
        ("lupin play mine.yaml && lupin play other.yaml && lupin play mine.yaml --undo $(date +%Y)", 2),
        ("lupin journal show nothing", 2),
        ("lupin wait free --robot closed --timeout 0", 1),
    ],
)
def test_printed_command_works_where_it_is_printed(typed: str, status: int, shell: Shell) -> None:
    failed = shell(typed)
    assert failed.returncode == status, failed.stderr
    command = printed_command(failed)
    if command.startswith("ping ") and shutil.which("ping") is None:  # a minimal system; an operator's has it
        assert command == "ping -c 3 127.0.0.1"
        return
    pasted = shell(command)
    # A doctor that finds the fault exits with its status; what matters is that the command ran and said something.
    accepted = (0, 3) if command.startswith("lupin doctor ") else (0,)
    assert pasted.returncode in accepted, f"{command}: {pasted.stdout}{pasted.stderr}"


def test_printed_command_repeats_the_named_inventory(shell: Shell, home: Path) -> None:
    """Its robot is in no other inventory, and its known_hosts file is beside it."""
    (home / "my robots").mkdir()
    (home / "my robots" / "lupin.toml").write_text('[robots.mine.addresses]\nwired = "pot"\n')
    refused = shell("lupin robots check mine --config 'my robots/lupin.toml'")
    assert refused.returncode == 3
    accepted = shell(printed_command(refused))
    assert accepted.returncode == 0, accepted.stderr
    assert (home / "my robots" / "known_hosts").read_text().startswith("mine ")


def test_undo_of_another_playbooks_run_names_its_command(shell: Shell, home: Path) -> None:
    assert shell("lupin play mine.yaml").returncode == shell("lupin play other.yaml").returncode == 0
    run = shell("lupin journal list").stdout.split()[0]
    refused = shell(f"lupin play mine.yaml --undo {run} --yes")
    assert refused.returncode == 2 and "is a run of other, not of mine" in refused.stderr
    pasted = shell(f"{printed_command(refused)} --yes")
    assert pasted.returncode == 0, pasted.stderr
    assert (home / "mine").exists() and not (home / "other").exists()
