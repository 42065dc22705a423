"""The way to a robot that is gone beside other work."""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest

from lupin_cli.config import Config, Robot
from lupin_cli.robot_options import Way
from lupin_cli.target.base import HostKeyUnknown, Script, TargetError, Unreachable


@pytest.fixture
def config(sshd, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Config:
    """An operator whose ssh has the key, and whose inventory lies beside the accepted keys."""
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / ".ssh").mkdir()
    (tmp_path / ".ssh/config").write_text(f"Host *\n  IdentityFile {sshd.directory}/id_ed25519\n  IdentitiesOnly yes\n")
    (tmp_path / "known_hosts").write_text(f"robot {sshd.host_key}\n")
    return Config(tmp_path / "lupin.toml")


def _robot(sshd, name: str = "robot") -> Robot:
    return Robot(name, {"wired": f"127.0.0.1:{sshd.port}"}, sshd.destination.user)


def test_at_its_end_stands_a_target_whose_shell_is_ready(sshd, config: Config) -> None:
    way = Way(_robot(sshd), config)
    way.wait()
    with contextlib.closing(way.target()) as target:
        transport = target.connect()
        assert target.batch([Script("one", "echo one")])["one"].stdout == "one\n"
        assert target.connect() is transport


def test_one_that_nobody_goes_to_the_end_leaves_no_connection(sshd, config: Config) -> None:
    way = Way(_robot(sshd), config)
    way.wait()
    transport = way.target().connect()
    assert transport.is_active()
    way.forget()
    assert not transport.is_active()


@pytest.mark.parametrize(
    ("robot", "error"),
    [
        (Robot("robot", {"wired": "127.0.0.1:1"}), Unreachable),
        (Robot("robot", {"wired": "nowhere.invalid"}), Unreachable),
        (None, HostKeyUnknown),
    ],
    ids=["refused", "no address", "a key that nobody knows"],
)
def test_why_it_leads_nowhere_is_told_to_whoever_waits(sshd, config: Config, robot: Robot | None, error: type) -> None:
    way = Way(robot or _robot(sshd, "stranger"), config)
    assert way.target().name in ("robot", "stranger")  # what it leads to is there all the same, to be tried again
    with pytest.raises(error):
        way.wait()
    way.forget()


@pytest.mark.parametrize("line", ["Match nonsense", "nonsense"], ids=["before it is knocked", "after"])
def test_what_can_not_be_opened_at_all_is_told_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / ".ssh").mkdir()
    (tmp_path / ".ssh/config").write_text(f"{line}\n")
    way = Way(Robot("robot", {"wired": "127.0.0.1:1"}), Config(tmp_path / "lupin.toml"))
    for told in (way.target, way.wait):
        with pytest.raises(TargetError):
            told()
    way.forget()
