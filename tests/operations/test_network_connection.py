"""Connections of NetworkManager, against a stand-in of its `nmcli` that keeps connections as files: it does not run here."""

from __future__ import annotations

from pathlib import Path

import pytest
from cycle import there_and_back

from lupin_cli.operations import OperationError
from lupin_cli.operations.network_connection import NetworkConnection
from lupin_cli.target.local import LocalTarget

# The few words of nmcli(1) that are used, with its exit statuses: 10 for what isn't there, 8 where NetworkManager doesn't run.
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


def saved(connections: Path, name: str, **values: str) -> Path:
    folder = connections / name
    folder.mkdir()
    for key, value in {"connection.id": name, **values}.items():
        (folder / key).write_text(f"{value}\n")
    return folder


def test_a_saved_connection_is_pinned_and_let_go(connections: Path, here: LocalTarget) -> None:
    folder = saved(connections, "Mirte-247264", **{"connection.autoconnect-priority": "0", "connection.autoconnect": "yes"})
    settings = {"connection.autoconnect-priority": "100", "connection.autoconnect": "true"}
    operation = NetworkConnection(connection="Mirte-247264", settings=settings)
    difference = there_and_back(operation, here)
    assert difference.diff == "-connection.autoconnect-priority 0\n+connection.autoconnect-priority 100"
    assert (folder / "connection.autoconnect-priority").read_text() == "0\n"


def test_a_connection_is_made_brought_up_and_removed(connections: Path, here: LocalTarget) -> None:
    settings = {"ipv4.addresses": "10.42.0.2/24", "ipv4.never-default": "yes"}
    there_and_back(
        NetworkConnection(connection="lupin wired", type="ethernet", interface="enx0", settings=settings, up=True), here
    )
    assert list(connections.iterdir()) == []
    saved(connections, "lupin wired")
    there_and_back(NetworkConnection(connection="lupin wired", up=True), here)


def test_a_secret_is_written_and_neither_read_nor_shown(connections: Path, here: LocalTarget) -> None:
    settings = {"802-11-wireless.ssid": "travel", "802-11-wireless-security.psk": "correct-horse"}
    operation = NetworkConnection(connection="r", type="wifi", interface="wlan0", settings=settings)
    difference = operation.differs(here)
    assert difference is not None and "correct-horse" not in str(difference)
    operation.change(here, difference)
    assert (connections / "r" / "802-11-wireless-security.psk").read_text() == "correct-horse\n"
    assert operation.differs(here) is None


def test_what_is_not_there_is_said(connections: Path, here: LocalTarget) -> None:
    with pytest.raises(OperationError, match="no saved connection 'none'"):
        NetworkConnection(connection="none", up=True).differs(here)
    connections.rmdir()
    with pytest.raises(OperationError, match="NetworkManager does not run"):
        NetworkConnection(connection="none", up=True).differs(here)
