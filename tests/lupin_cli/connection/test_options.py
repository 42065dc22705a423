"""From a robot's name to an open connection."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from lupin_cli.connection.base import HostKeyUnknown, Script, TargetError, Unreachable
from lupin_cli.connection.inventory import Config, Robot
from lupin_cli.connection.options import connect

if TYPE_CHECKING:
    from tests.lupin_cli.connection.conftest import Sshd


@pytest.fixture
def config(sshd: Sshd, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Config:
    """Return the inventory of a user whose ~/.ssh/config names the key, with the server's host key accepted for `robot`."""
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / ".ssh").mkdir()
    (tmp_path / ".ssh/config").write_text(f"Host *\n  IdentityFile {sshd.directory}/id_ed25519\n  IdentitiesOnly yes\n")
    (tmp_path / "known_hosts").write_text(f"robot {sshd.host_key}\n")
    return Config(tmp_path / "lupin.toml")


def _robot(sshd: Sshd, name: str = "robot") -> Robot:
    return Robot(name, {"wired": f"127.0.0.1:{sshd.port}"}, sshd.destination.user)


def test_connect_yields_open_target_and_closes_it(sshd: Sshd, config: Config) -> None:
    with connect(_robot(sshd), config) as target:
        transport = target.connect()
        assert target.batch([Script("one", "echo one")])["one"].stdout == "one\n"
        assert target.connect() is transport
        assert target.transport_name == "wired"
    assert not transport.is_active()


@pytest.mark.parametrize(
    ("robot", "error"),
    [
        (Robot("robot", {"wired": "127.0.0.1:1"}), Unreachable),
        (Robot("robot", {"wired": "nowhere.invalid"}), Unreachable),
        (None, HostKeyUnknown),
    ],
    ids=["refused", "no address", "unknown host key"],
)
def test_connect_raises_why_robot_is_not_reached(
    sshd: Sshd, config: Config, robot: Robot | None, error: type[TargetError]
) -> None:
    with pytest.raises(error), connect(robot or _robot(sshd, "stranger"), config):
        pass


@pytest.mark.parametrize("line", ["Match nonsense", "nonsense"])
def test_connect_raises_for_unreadable_ssh_config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / ".ssh").mkdir()
    (tmp_path / ".ssh/config").write_text(f"{line}\n")
    with (
        pytest.raises(TargetError, match=r"\.ssh/config"),
        connect(Robot("robot", {"wired": "127.0.0.1:1"}), Config(tmp_path / "lupin.toml")),
    ):
        pass
