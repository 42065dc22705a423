"""lupin.toml: how it is read, and how errors in it are reported."""

from __future__ import annotations

import socket
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.connection.base import TargetError
from lupin_cli.connection.inventory import ROS_SETUP, Config, ConfigError, Robot, load, parse
from lupin_cli.connection.inventory_text import with_robot, without_robot
from lupin_cli.connection.options import STOCK_ROBOT, find_robot, for_each_robot, select_robots

WHOLE = """\
default_robot = "greenhouse"   # the one with the flowers

[robots.greenhouse]
user = "mirte"
ros_setup = ["source /opt/ros/humble/setup.bash"]

[robots.greenhouse.addresses]
ap = "192.168.42.1"
wired = "10.42.0.1:2222"

[robots.spare]
transport = "router"
addresses = { router = "spare.local", wired = "10.42.0.1" }
"""
PATH = Path("lupin.toml")


def test_inventory_is_read_with_best_transport_first() -> None:
    config = parse(WHOLE, PATH)
    assert config.default_robot == "greenhouse"
    assert config.robots["greenhouse"] == Robot(
        "greenhouse", {"wired": "10.42.0.1:2222", "ap": "192.168.42.1"}, "mirte", "", ("source /opt/ros/humble/setup.bash",)
    )
    assert list(config.robots["greenhouse"].addresses) == ["wired", "ap"]
    assert config.robots["spare"].transport == "router" and config.robots["spare"].ros_setup == ROS_SETUP


@pytest.mark.parametrize(
    ("old", "new", "line", "message_part"),
    [
        ("[robots.greenhouse.addresses]", "[robots.greenhouse.adresses]", 7, "did you mean 'addresses'"),
        ("user =", "usr =", 4, "did you mean 'user'"),
        ('"mirte"', "7", 4, "robots.greenhouse.user must be a string in quotes; it is 7"),
        ('["source /opt/ros/humble/setup.bash"]', '"source x"', 5, "must be a list of lines"),
        ('ap = "192.168.42.1"', 'app = "192.168.42.1"', 8, "did you mean 'ap'"),
        ('"10.42.0.1:2222"', '"10.42.0.1:99999"', 9, "must be an address"),
        ('"10.42.0.1:2222"', '"mirte@10.42.0.1"', 9, "without a user"),
        ('"router"', '"rooter"', 12, "did you mean 'router'"),
        ('"router"', '"ap"', 12, "no address for the transport ap"),
        ('router = "spare.local"', 'rotuer = "spare.local"', 13, "did you mean 'router'"),
        ('= "greenhouse"', '= "greenhuose"', 1, "did you mean 'greenhouse'"),
        ("default_robot", "defualt_robot", 1, "did you mean 'default_robot'"),
        ("[robots.spare]", "[robots.spare", 11, "not valid TOML"),
        ("[robots.spare]", '[robots."spare one"]', 11, "is not a robot's name"),
        ('addresses = { router = "spare.local", wired = "10.42.0.1" }', "", 11, "no address"),
        ("[robots.spare]", "[robot.spare]", 11, "did you mean 'robots'"),
    ],
)
def test_inventory_error_names_line_and_nearest_word(old: str, new: str, line: int, message_part: str) -> None:
    assert old in WHOLE
    with pytest.raises(ConfigError) as caught:
        parse(WHOLE.replace(old, new, 1), PATH)
    message = str(caught.value)
    assert message.startswith(f"lupin.toml:{line}: ") and message_part in message


@given(st.text())
def test_parse_raises_only_config_errors(text: str) -> None:
    try:
        parse(text, PATH)
    except ConfigError as error:
        assert str(error).startswith("lupin.toml:")


def test_robot_is_added_and_removed_without_other_changes() -> None:
    new = Robot("third", {"wired": "10.42.0.1"}, "pi")
    added = with_robot(WHOLE, new)
    assert added.startswith(WHOLE) and parse(added, PATH).robots["third"] == new
    assert without_robot(added, "third").rstrip() == WHOLE.rstrip()
    rest = without_robot(WHOLE, "greenhouse")
    assert list(parse(rest, PATH).robots) == ["spare"]


def test_inventory_path_is_option_then_variable_then_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "xdg"))
    monkeypatch.delenv("LUPIN_CONFIG", raising=False)
    assert load() == Config(tmp_path / "xdg" / "lupin" / "lupin.toml")
    (tmp_path / "a.toml").write_text('[robots.a.addresses]\nwired = "1.1.1.1"\n')
    (tmp_path / "b.toml").write_text('[robots.b.addresses]\nwired = "1.1.1.1"\n')
    monkeypatch.setenv("LUPIN_CONFIG", str(tmp_path / "a.toml"))
    assert list(load().robots) == ["a"]
    assert list(load(tmp_path / "b.toml").robots) == ["b"]
    monkeypatch.setenv("LUPIN_CONFIG", str(tmp_path / "none.toml"))
    with pytest.raises(ConfigError, match="no such file"):
        load()


def test_select_robots_returns_chosen_robots() -> None:
    config = parse(WHOLE, PATH)
    assert [robot.name for robot in select_robots(config, None)] == ["greenhouse"]
    assert [robot.name for robot in select_robots(config, ["spare", "spare"])] == ["spare"]
    assert [robot.name for robot in select_robots(config, None, every=True)] == ["greenhouse", "spare"]
    assert [robot.name for robot in select_robots(config, None, every=True, limit="s*")] == ["spare"]
    assert select_robots(Config(PATH), [STOCK_ROBOT.name]) == [STOCK_ROBOT]
    adhoc = select_robots(config, ["pi@10.0.0.9:2222"])[0]
    assert (adhoc.user, dict(adhoc.addresses)) == ("pi", {"": "10.0.0.9:2222"})


@pytest.mark.parametrize(
    ("own", "expected"),
    [
        (("10.42.0.2",), {"wired": "10.42.0.1"}),
        (("172.16.0.9", "192.168.42.17"), {"ap": "192.168.42.1"}),
        (("192.168.42.17", "10.42.0.2"), {"wired": "10.42.0.1", "ap": "192.168.42.1"}),
    ],
)
def test_robot_as_delivered_is_tried_on_its_networks(
    monkeypatch: pytest.MonkeyPatch, own: tuple[str, ...], expected: dict[str, str]
) -> None:
    set_addresses(monkeypatch, *own)
    (robot,) = select_robots(Config(PATH), None)
    assert (robot.name, dict(robot.addresses)) == (STOCK_ROBOT.name, expected)


def test_without_inventory_and_network_the_robot_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    set_addresses(monkeypatch, "127.0.0.1", "172.16.0.9")
    with pytest.raises(ConfigError, match=r"no interface of this machine .* plug its cable in") as caught:
        select_robots(Config(PATH), None)
    assert caught.value.next_command == "lupin robots add greenhouse mirte@10.42.0.1"


def set_addresses(monkeypatch: pytest.MonkeyPatch, *addresses: str) -> None:
    """Give this machine an interface for each address, all with a prefix of 24 bits."""
    interface = SimpleNamespace(family=socket.AF_INET, netmask="255.255.255.0")
    found = {f"if{at}": [SimpleNamespace(**vars(interface), address=each)] for at, each in enumerate(addresses)}
    monkeypatch.setattr("psutil.net_if_addrs", lambda: found)


@pytest.mark.parametrize(
    ("names", "every", "limit", "message_part"),
    [
        (["greenhuose"], False, None, "did you mean greenhouse"),
        (["spare"], True, None, "exclude each other"),
        (None, False, "s*", "needs --all"),
        (None, True, "x*", "matches --limit"),
    ],
)
def test_select_robots_refuses_contradictory_options(
    names: list[str] | None, every: bool, limit: str | None, message_part: str
) -> None:
    with pytest.raises(ConfigError, match=message_part):
        select_robots(parse(WHOLE, PATH), names, every=every, limit=limit)


def test_robot_must_be_named_if_there_is_no_default() -> None:
    with pytest.raises(ConfigError, match="which robot"):
        select_robots(parse(WHOLE.replace('default_robot = "greenhouse"', ""), PATH), None)
    assert find_robot(parse(WHOLE, PATH), "spare").name == "spare"


def test_error_of_one_robot_leaves_the_others() -> None:
    def action(robot: Robot) -> str:
        if robot.name == "spare":
            raise TargetError("it is away")
        return robot.name

    results = for_each_robot(list(parse(WHOLE, PATH).robots.values()), action)
    assert results["greenhouse"] == "greenhouse" and isinstance(results["spare"], TargetError)
