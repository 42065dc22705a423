"""The scripts that start and stop a discovery server, with a program of its name, and files that another user prepared."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from lupin_cli.connection.local import LocalTarget
from lupin_cli.operations.base import Difference
from lupin_cli.operations.discovery_server import DiscoveryServer
from tests.support.waiting import wait_until

STATE = Path(".local/state/lupin")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The home of the robot's user, whose PATH has a discovery server."""
    programs = tmp_path / "bin"
    programs.mkdir()
    program = programs / "fast-discovery-server"
    program.write_text('#!/bin/sh\necho "started with $*"\nwhile :; do sleep 1; done\n')
    program.chmod(0o755)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("PATH", f"{programs}:{os.environ['PATH']}")
    return tmp_path


@pytest.fixture
def server(home: Path, target: LocalTarget) -> Iterator[int]:
    """The PID of a server that the operation started."""
    DiscoveryServer(port=11899).change(target, Difference("start"))
    pid_file = home / STATE / "discovery-server.log.pid"
    wait_until(lambda: pid_file.exists() and pid_file.read_text().strip().isdigit(), "the server's PID")
    pid = int(pid_file.read_text())
    comm = Path(f"/proc/{pid}/comm")
    wait_until(lambda: comm.read_text() == "fast-discovery-\n", "the server")
    yield pid
    pid_file.write_text(f"{pid}\n")
    DiscoveryServer().undo(target, {})
    assert not comm.exists()


@pytest.mark.usefixtures("server")
def test_log_is_in_a_folder_of_its_user_only(home: Path) -> None:
    assert (home / STATE).stat().st_mode & 0o777 == 0o700
    log = home / STATE / "discovery-server.log"
    wait_until(lambda: log.read_text() == "started with -i 0 -l 0.0.0.0 -p 11899\n", "the server's log")


def test_undo_terminates_the_server(server: int, home: Path, target: LocalTarget) -> None:
    DiscoveryServer().undo(target, {})
    assert not Path(f"/proc/{server}").exists()
    assert not (home / STATE / "discovery-server.log.pid").exists()


def test_undo_signals_nothing_but_a_server(server: int, home: Path, target: LocalTarget) -> None:
    with subprocess.Popen(["sleep", "60"]) as other:
        for written in ("-1", "0", "", "1", "self", "../proc/1", "$(touch evil)", str(other.pid)):
            (home / STATE / "discovery-server.log.pid").write_text(f"{written}\n")
            DiscoveryServer().undo(target, {})
            assert other.poll() is None
            assert Path(f"/proc/{server}").exists()
        other.kill()
