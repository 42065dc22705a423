"""For which address, network and WiFi `lupin deploy laptop` sets up this machine."""

from __future__ import annotations

from ipaddress import IPv4Network
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lupin_cli.app import app
from lupin_cli.commands.deploy import _laptop_variables
from lupin_cli.connection.inventory import ConfigError, Robot
from lupin_cli.link.laptop_variables import choose_variables

CABLE, AP, LAN = map(IPv4Network, ("10.42.0.0/24", "192.168.42.0/24", "172.20.0.0/16"))
BOTH = {"wired": "10.42.0.1:2222", "ap": "192.168.42.1"}


@pytest.mark.parametrize(
    ("robot", "networks", "wifi", "expected"),
    [
        (Robot("pot", BOTH), [CABLE, AP], [], {"robot_ip": "10.42.0.1", "network": "10.42.0.0/24"}),
        (Robot("pot", BOTH), [LAN, AP], [], {"robot_ip": "192.168.42.1", "network": "192.168.42.0/24"}),
        (Robot("pot", BOTH, transport="ap"), [CABLE], [], {"robot_ip": "192.168.42.1", "network": "192.168.42.0/24"}),
        (Robot("pot", {"router": "172.20.3.4"}), [LAN], [], {"robot_ip": "172.20.3.4", "network": "172.20.0.0/16"}),
        (Robot("pot", BOTH), [], ["Mirte-7", "home"], {"robot_ip": "10.42.0.1", "network": "10.42.0.0/24", "ssid": "Mirte-7"}),
        (Robot("pot", BOTH), [], ["Mirte-7", "Mirte-8"], {"robot_ip": "10.42.0.1", "network": "10.42.0.0/24"}),
        (Robot("pot", BOTH, ssid="Pot"), [], ["Mirte-7"], {"robot_ip": "10.42.0.1", "network": "10.42.0.0/24", "ssid": "Pot"}),
    ],
)
def test_variables_are_those_of_the_robot(
    robot: Robot, networks: list[IPv4Network], wifi: list[str], expected: dict[str, str]
) -> None:
    assert choose_variables(robot, networks, wifi) == expected


def test_robot_without_address_is_refused_with_the_variable() -> None:
    with pytest.raises(ConfigError, match="-v robot_ip=ADDRESS"):
        choose_variables(Robot("pot", {"wired": "pot.local"}), [CABLE], [])


def test_robot_is_chosen_as_by_every_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lupin_cli.link.laptop_variables.own_networks", lambda: [CABLE])
    monkeypatch.setattr("lupin_cli.link.laptop_variables.saved_wifi", list)
    path = tmp_path / "lupin.toml"
    path.write_text("")
    assert _laptop_variables(None, path, False, {}) == ("", {})
    assert _laptop_variables(None, path, False, {"robot_ip": "10.42.0.9"})[1]["network"] == "10.42.0.0/24"
    path.write_text('[robots.pot]\naddresses = { ap = "192.168.42.1" }\n[robots.tin]\naddresses = { wired = "10.42.0.7" }\n')
    with pytest.raises(ConfigError, match="which robot"):
        _laptop_variables(None, path, False, {})
    assert _laptop_variables(None, path, True, {}) == ("", {})
    path.write_text(f'default_robot = "tin"\n{path.read_text()}')
    assert _laptop_variables(None, path, False, {})[1]["robot_ip"] == "10.42.0.7"
    name, chosen = _laptop_variables(["pot"], path, False, {"network": "192.168.0.0/16"})
    assert (name, chosen) == ("pot", {"robot_ip": "192.168.42.1", "network": "192.168.0.0/16"})
    with pytest.raises(ConfigError, match="one robot"):
        _laptop_variables(["pot", "tin"], path, False, {})


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("-v", "robotip=10.9.9.9"), "'deploy-laptop' has no variable 'robotip'; did you mean 'robot_ip'"),
        (("-v", "robotip=10.9.9.9", "--remove"), "'remove-laptop' has no variable 'robotip'"),
        (("-v", "robot_ip=a b"), "-v robot_ip: expected an IPv4 address such as 10.42.0.1, found 'a b'"),
        (("-v", "robot_ip=pot.local"), "-v robot_ip: expected an IPv4 address such as 10.42.0.1, found 'pot.local'"),
        (("-v", "network=10.42.0.0/33"), "-v network: expected an IPv4 network such as 10.42.0.0/24"),
        (("-v", "robot_ip"), "a variable must be given as name=value"),
    ],
)
def test_wrong_variable_is_a_usage_error(words: tuple[str, ...], message: str, tmp_path: Path) -> None:
    (tmp_path / "lupin.toml").write_text("")
    config = ["--config", str(tmp_path / "lupin.toml")]
    done = CliRunner().invoke(app, ["deploy", "laptop", "--dry-run", *words, *config])
    assert done.exit_code == 2 and done.output.startswith("lupin deploy laptop: ") and message in done.output, done.output


def test_unwritable_journal_is_a_usage_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lupin.toml").write_text("")
    (tmp_path / "state").write_text("a file where the journal's folder should be")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    done = CliRunner().invoke(app, ["deploy", "laptop", "--config", str(tmp_path / "lupin.toml")])
    assert done.exit_code == 2 and "journal" in done.output, (done.output, done.exception)
