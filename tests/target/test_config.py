"""lupin.toml: what is read, and how what can't be is refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.config import ROS_SETUP, Config, ConfigError, Robot, load, parse, with_robot, without_robot
from lupin_cli.robot_options import STOCK, named, on_each, select
from lupin_cli.target.base import TargetError

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


def test_a_whole_file_is_read_with_the_best_transport_first() -> None:
    config = parse(WHOLE, PATH)
    assert config.default_robot == "greenhouse"
    assert config.robots["greenhouse"] == Robot(
        "greenhouse", {"wired": "10.42.0.1:2222", "ap": "192.168.42.1"}, "mirte", "", ("source /opt/ros/humble/setup.bash",)
    )
    assert list(config.robots["greenhouse"].addresses) == ["wired", "ap"]
    assert config.robots["spare"].transport == "router" and config.robots["spare"].ros_setup == ROS_SETUP


@pytest.mark.parametrize(
    ("old", "new", "line", "says"),
    [
        ("[robots.greenhouse.addresses]", "[robots.greenhouse.adresses]", 7, "did you mean 'addresses'"),
        ("user =", "usr =", 4, "did you mean 'user'"),
        ('"mirte"', "7", 4, "robots.greenhouse.user must be a text in quotes; it is 7"),
        ('["source /opt/ros/humble/setup.bash"]', '"source x"', 5, "must be a list of lines"),
        ('ap = "192.168.42.1"', 'app = "192.168.42.1"', 8, "did you mean 'ap'"),
        ('"10.42.0.1:2222"', '"10.42.0.1:99999"', 9, "must be an address"),
        ('"10.42.0.1:2222"', '"mirte@10.42.0.1"', 9, "without a user"),
        ('"router"', '"rooter"', 12, "did you mean 'router'"),
        ('"router"', '"ap"', 12, "no address for the transport ap"),
        ('router = "spare.local"', 'rotuer = "spare.local"', 13, "did you mean 'router'"),
        ('= "greenhouse"', '= "greenhuose"', 1, "did you mean 'greenhouse'"),
        ("default_robot", "defualt_robot", 1, "did you mean 'default_robot'"),
        ("[robots.spare]", "[robots.spare", 11, "no TOML"),
        ("[robots.spare]", '[robots."spare one"]', 11, "no name for a robot"),
        ('addresses = { router = "spare.local", wired = "10.42.0.1" }', "", 11, "no address"),
        ("[robots.spare]", "[robot.spare]", 11, "did you mean 'robots'"),
    ],
)
def test_a_mistake_is_named_with_its_line_and_what_was_meant(old: str, new: str, line: int, says: str) -> None:
    assert old in WHOLE
    with pytest.raises(ConfigError) as caught:
        parse(WHOLE.replace(old, new, 1), PATH)
    message = str(caught.value)
    assert message.startswith(f"lupin.toml:{line}: ") and says in message


@given(st.text())
def test_no_text_is_a_defect(text: str) -> None:
    try:
        parse(text, PATH)
    except ConfigError as error:
        assert str(error).startswith("lupin.toml:")


def test_a_robot_is_added_and_taken_out_without_touching_the_rest() -> None:
    new = Robot("third", {"wired": "10.42.0.1"}, "pi")
    added = with_robot(WHOLE, new)
    assert added.startswith(WHOLE) and parse(added, PATH).robots["third"] == new
    assert without_robot(added, "third").rstrip() == WHOLE.rstrip()
    rest = without_robot(WHOLE, "greenhouse")
    assert list(parse(rest, PATH).robots) == ["spare"]


def test_the_file_is_the_named_one_the_variables_or_the_users(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_the_robots_that_were_meant_are_chosen() -> None:
    config = parse(WHOLE, PATH)
    assert [robot.name for robot in select(config, None)] == ["greenhouse"]
    assert [robot.name for robot in select(config, ["spare", "spare"])] == ["spare"]
    assert [robot.name for robot in select(config, None, every=True)] == ["greenhouse", "spare"]
    assert [robot.name for robot in select(config, None, every=True, limit="s*")] == ["spare"]
    assert select(Config(PATH), None) == [STOCK]
    assert select(Config(PATH), [STOCK.name]) == [STOCK]
    adhoc = select(config, ["pi@10.0.0.9:2222"])[0]
    assert (adhoc.user, dict(adhoc.addresses)) == ("pi", {"": "10.0.0.9:2222"})


@pytest.mark.parametrize(
    ("names", "every", "limit", "says"),
    [
        (["greenhuose"], False, None, "did you mean greenhouse"),
        (["spare"], True, None, "exclude each other"),
        (None, False, "s*", "goes with --all"),
        (None, True, "x*", "fits --limit"),
    ],
)
def test_a_choice_that_means_nothing_is_refused(names: list[str] | None, every: bool, limit: str | None, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        select(parse(WHOLE, PATH), names, every=every, limit=limit)


def test_without_a_default_among_several_robots_one_must_be_named() -> None:
    with pytest.raises(ConfigError, match="which robot"):
        select(parse(WHOLE.replace('default_robot = "greenhouse"', ""), PATH), None)
    assert named(parse(WHOLE, PATH), "spare").name == "spare"


def test_a_robot_that_fails_disturbs_no_other() -> None:
    def action(robot: Robot) -> str:
        if robot.name == "spare":
            raise TargetError("it is away")
        return robot.name

    results = on_each(list(parse(WHOLE, PATH).robots.values()), action)
    assert results["greenhouse"] == "greenhouse" and isinstance(results["spare"], TargetError)
