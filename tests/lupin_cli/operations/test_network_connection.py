"""Connections of NetworkManager, against a fake `nmcli` that keeps connections as files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from lupin_cli.connection.base import Output
from lupin_cli.connection.local import LocalTarget
from lupin_cli.operations import OperationError
from lupin_cli.operations.network_connection import NetworkConnection
from lupin_cli.operations.restored_state import read_digests
from tests.support.operation_cycle import apply_and_undo, examine, require_difference

# The subcommands of nmcli(1) that are used, with its exit statuses: 10 no such connection, 8 NetworkManager is not running.
NMCLI = r"""#!/bin/bash
cd "$(dirname "$0")/connections" || exit 8
echo "$*" >>../arguments
while [[ $1 == -* ]]; do
  case $1 in -g) fields=$2; shift 2 ;; --wait | --escape) shift 2 ;; --show-secrets) shown=yes; shift ;; *) shift ;; esac
done
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
  edit) while read -r word key value; do
    [ "$word" = set ] && new=$value && changed=$key
    [ "$word" = save ] && [ ${#new} -ge 8 ] && echo "$new" >"$name/$changed"
    echo "nmcli> $word $key $value"
  done ;;
  show)
    case $shown$fields in
      yes*) cat "$name/$fields" ;;
      *.psk) echo '<hidden>' ;;
      *) cat "$name/$fields" 2>/dev/null || echo ;;
    esac ;;
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


def test_only_settings_count_as_changed_by_somebody_else(connections: Path, target: LocalTarget) -> None:
    folder = save_connection(connections, "hall", **{"connection.autoconnect-priority": "100"})
    operation = NetworkConnection(connection="hall", settings={"connection.autoconnect-priority": "100"}, up=True)
    left = read_digests(operation, target)
    (folder / "GENERAL.STATE").write_text("activated\n")
    assert read_digests(operation, target) == left, "a link that went down or up is nothing that an undo overwrites"
    (folder / "connection.autoconnect-priority").write_text("5\n")
    assert read_digests(operation, target) != left


def test_secret_is_written_and_never_shown(connections: Path, target: LocalTarget) -> None:
    secret = """it's "$HOME" a `key` \\n;:"""
    settings = {"802-11-wireless.ssid": "travel", "802-11-wireless-security.psk": secret}
    operation = NetworkConnection(connection="r", type="wifi", interface="wlan0", settings=settings)
    difference = examine(operation, target)
    assert difference is not None and secret not in str(difference)
    printed: list[str] = []

    class Recording(LocalTarget):
        def run(self, script: str, **options: Any) -> Output:
            output = super().run(script, **options)
            printed.extend([output.stdout, output.stderr])
            return output

    operation.change(Recording("robot"), difference)
    assert (connections / "r" / "802-11-wireless-security.psk").read_text() == f"{secret}\n"
    assert (connections / "r" / "connection.autoconnect").read_text() == "yes\n"
    assert examine(operation, target) is None
    arguments = (connections.parent / "arguments").read_text()
    assert "connection edit id r" in arguments and "a `key`" not in arguments + "".join(printed)


def test_secret_of_a_saved_connection_is_replaced(connections: Path, target: LocalTarget) -> None:
    save_connection(connections, "r", **{"802-11-wireless-security.psk": "the old one", "connection.autoconnect": "no"})
    settings = {"802-11-wireless-security.psk": "the new one", "802-11-wireless.ssid": "travel"}
    operation = NetworkConnection(connection="r", settings=settings)
    operation.change(target, require_difference(operation, target))
    assert (connections / "r" / "802-11-wireless-security.psk").read_text() == "the new one\n"
    assert (connections / "r" / "connection.autoconnect").read_text() == "no\n"


def test_secret_that_is_not_saved_is_an_error_without_it(connections: Path, target: LocalTarget) -> None:
    settings = {"802-11-wireless-security.psk": "short"}  # which nmcli's editor refuses, and exits with 0
    operation = NetworkConnection(connection="r", type="wifi", interface="wlan0", settings=settings)
    with pytest.raises(OperationError, match=r"did not save 802-11-wireless-security\.psk") as caught:
        operation.change(target, require_difference(operation, target))
    assert "short" not in str(caught.value)
    assert (connections / "r" / "connection.autoconnect").read_text() == "no\n"


@pytest.mark.parametrize("secret", ["one\nset connection.id other", " blank", "blank\t", "a\rb", "a\x85b"])
def test_secret_of_several_lines_is_refused(secret: str) -> None:
    with pytest.raises(ValueError, match="must be one line") as caught:
        NetworkConnection(connection="r", settings={"802-1x.password": secret})
    assert repr(secret) not in str(caught.value) and "other" not in str(caught.value)


def test_missing_connection_and_networkmanager_are_errors(connections: Path, target: LocalTarget) -> None:
    with pytest.raises(OperationError, match="no saved connection 'none'"):
        examine(NetworkConnection(connection="none", up=True), target)
    connections.rmdir()
    with pytest.raises(OperationError, match="NetworkManager does not run"):
        examine(NetworkConnection(connection="none", up=True), target)
