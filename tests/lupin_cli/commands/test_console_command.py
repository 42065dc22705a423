"""`lupin console` and its subcommands: what they show and change, and their exit status."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from lupin_runtime.console.authority import Role
from lupin_runtime.console.description import ConsoleDescription
from lupin_runtime.console.sessions import Sessions, sessions_file
from lupin_runtime.stack.runs import Run, create_run


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of all state."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path / "lupin"


@pytest.fixture
def run() -> Iterator[Run]:
    """Yield a run that is up."""
    created, lock = create_run()
    yield created
    os.close(lock)


def lupin(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "lupin_cli.app", "console", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_list_without_paired_browsers_creates_no_file(state: Path) -> None:
    shown = lupin("sessions")
    assert shown.returncode == 0 and "no browser is paired" in shown.stdout
    assert lupin("sessions", "--json").stdout == "[]\n"
    assert not state.exists(), "it only reads"


def test_sessions_are_listed_and_revoked() -> None:
    stored = Sessions(sessions_file())
    _, phone = stored.add("phone", Role.OPERATOR)
    _, tablet = stored.add("tablet", Role.VIEWER)
    rows = json.loads(lupin("sessions", "--json").stdout)
    assert {(row["name"], row["role"]) for row in rows} == {("phone-1", "operator"), ("tablet-1", "viewer")}
    assert phone not in lupin("sessions").stdout

    would = lupin("revoke", "phone-1", "--dry-run")
    assert would.returncode == 0 and would.stdout == "would revoke phone-1\n"
    assert stored.find(phone) is not None
    assert lupin("revoke", "phone-1").stdout == "revoked phone-1\n"
    assert stored.find(phone) is None and stored.find(tablet) is not None
    assert lupin("revoke", "--all").returncode == 0
    assert stored.all() == []


@pytest.mark.parametrize("arguments", [(), ("phone-7",), ("phone-1", "--all")])
def test_ambiguous_revoke_is_a_usage_error(arguments: tuple[str, ...]) -> None:
    Sessions(sessions_file()).add("phone", Role.OPERATOR)
    refused = lupin("revoke", *arguments)
    assert refused.returncode == 2 and "phone-1" in refused.stderr
    assert len(Sessions(sessions_file()).all()) == 1


def test_damaged_file_is_named(state: Path) -> None:
    (state / "console").mkdir(parents=True)
    (state / "console" / "sessions.json").write_text("{")
    for arguments in (("sessions",), ("revoke", "phone-1")):
        refused = lupin(*arguments)
        assert refused.returncode == 2 and "sessions.json" in refused.stderr and "Traceback" not in refused.stderr


def test_codes_of_the_running_console_are_shown(run: Run) -> None:
    absent = lupin("code")
    assert absent.returncode == 3 and "lupin console" in absent.stderr
    codes = {"operator": "ABCDEFGH", "viewer": "23456789"}
    ConsoleDescription(1, "127.0.0.1", 8090, 9090, codes).write(run.path)
    shown = lupin("code")
    assert "http://127.0.0.1:8090/" in shown.stdout and "ABCD-EFGH pairs one browser as operator" in shown.stdout
    assert json.loads(lupin("code", "--json").stdout)["codes"] == codes


def test_without_a_run_there_is_no_code() -> None:
    refused = lupin("code")
    assert refused.returncode == 3 and "lupin up" in refused.stderr


@pytest.mark.graph
def test_page_is_served_while_the_rosbridge_port_is_in_use() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        taken = other.getsockname()[1]
        command = [sys.executable, "-m", "lupin_cli.app", "console", "--port", "0", "--rosbridge-port", str(taken)]
        process = subprocess.Popen(
            [*command, "--host", "127.0.0.1"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        try:
            assert process.stdout is not None
            port = next(found[1] for line in process.stdout if (found := re.search(r"http://localhost:(\d+)", line)))
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/_api/session", timeout=60) as answer:
                assert answer.status == 200
        finally:
            os.killpg(process.pid, signal.SIGINT)
            banner, errors = process.communicate(timeout=60)
    assert process.returncode == 0
    assert errors.count(f"port {taken} is in use by process {os.getpid()} (") == 1 and "--rosbridge-port" in errors
    assert "rosbridge" not in banner, "it lists only what it serves"


def test_page_port_in_use_is_refused_with_its_owner() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        taken = other.getsockname()[1]
        for host in ("", "127.0.0.1"):
            refused = lupin("--port", str(taken), "--host", host)
            assert refused.returncode == 2
            assert f"port {taken} is in use by process {os.getpid()} (" in refused.stderr and "--port" in refused.stderr


def test_address_of_another_computer_is_refused() -> None:
    refused = lupin("--port", "0", "--host", "192.0.2.7")
    assert refused.returncode == 2 and "cannot listen on 192.0.2.7" in refused.stderr
