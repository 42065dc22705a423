"""Connections of NetworkManager, against a fake `nmcli` that keeps connections as files."""

from __future__ import annotations

from pathlib import Path

import pytest

from lupin_cli.connection.local import LocalTarget
from lupin_cli.operations import OperationError
from lupin_cli.operations.network_connection import NetworkConnection
from tests.support.operation_cycle import apply_and_undo, examine

# The subcommands of nmcli(1) that are used, with its exit statuses: 10 no such connection, 8 NetworkManager is not running.
NMCLI = r"""#!/bin/bash
cd "$(dirname "$0")/connections" || exit 8
while [[ $1 == -* ]]; do case $1 in -g) fields=$2; shift 2 ;; --wait) shift 2 ;; *) shift ;; esac; done
[ "$1" = connection ] || exit 2
verb=$2; shift 2
if [ "$verb" = add ]; then
  while [ "$1" != con-name ]; do shift 2; done
  name=$2; shift 2; mkdir "$name"; echo "$name" >"$name/connection.id"
else
  [ "$1" = id ] && shift
  name=$1; shift
  [ -d "$name" ] || exit 10
fi
case $verb in
  add | modify) while [ $# -gt 1 ]; do echo "$2" >"$name/$1"; shift 2; done ;;
  show) case $fields in *.psk) echo '<hidden>' ;; *) cat "$name/$fields" 2>/dev/null || echo ;; esac ;;
  up) echo activated >"$name/GENERAL.STATE" ;;
  down) rm -f "$name/GENERAL.STATE" ;;
  delete) rm -r "$name" ;;
esac
exit 0
"""


@pytest.fixture
def connections(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    program = tmp_path / "nmcli"
    program.write_text(NMCLI)
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    (tmp_path / "connections").mkdir()
    return tmp_path / "connections"


def save_connection(connections: Path, name: str, **values: str) -> Path:
    folder = connections / name
    folder.mkdir()
    for key, value in {"connection.id": name, **values}.items():
        (folder / key).write_text(f"{value}\n")
    return folder


def test_saved_connection_is_changed_and_restored(connections: Path, target: LocalTarget) -> None:
    folder = save_connection(
        connections, "Mirte-247264", **{"connection.autoconnect-priority": "0", "connection.autoconnect": "yes"}
    )
    settings = {"connection.autoconnect-priority": "100", "connection.autoconnect": "true"}
    operation = NetworkConnection(connection="Mirte-247264", settings=settings)
    difference = apply_and_undo(operation, target)
    assert difference.diff == "-connection.autoconnect-priority 0\n+connection.autoconnect-priority 100"
    assert (folder / "connection.autoconnect-priority").read_text() == "0\n"


def test_connection_is_created_activated_and_removed(connections: Path, target: LocalTarget) -> None:
    settings = {"ipv4.addresses": "10.42.0.2/24", "ipv4.never-default": "yes"}
    apply_and_undo(
        NetworkConnection(connection="lupin wired", type="ethernet", interface="enx0", settings=settings, up=True), target
    )
    assert list(connections.iterdir()) == []
    save_connection(connections, "lupin wired")
    apply_and_undo(NetworkConnection(connection="lupin wired", up=True), target)


def test_secret_is_written_and_never_shown(connections: Path, target: LocalTarget) -> None:
    settings = {"802-11-wireless.ssid": "travel", "802-11-wireless-security.psk": "correct-horse"}
    operation = NetworkConnection(connection="r", type="wifi", interface="wlan0", settings=settings)
    difference = examine(operation, target)
    assert difference is not None and "correct-horse" not in str(difference)
    operation.change(target, difference)
    assert (connections / "r" / "802-11-wireless-security.psk").read_text() == "correct-horse\n"
    assert examine(operation, target) is None


def test_missing_connection_and_networkmanager_are_errors(connections: Path, target: LocalTarget) -> None:
    with pytest.raises(OperationError, match="no saved connection 'none'"):
        examine(NetworkConnection(connection="none", up=True), target)
    connections.rmdir()
    with pytest.raises(OperationError, match="NetworkManager does not run"):
        examine(NetworkConnection(connection="none", up=True), target)
