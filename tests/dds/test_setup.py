"""What `lupin dds` writes, and how it takes it back."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.dds_setup import (
    MARK,
    Places,
    check_exports,
    check_hook,
    check_profile,
    exports,
    hook_line,
    hooks,
    misplaced,
    profile_xml,
    read_exports,
    valid_ip,
    with_hook,
    without_hook,
)
from lupin_runtime.stack.dds import robot_environment

PLACES = Places(Path("/home/op"), Path("/home/op/.config/lupin"))
SETUP = "source /opt/ros/humble/setup.bash\n"


@given(st.text(alphabet=st.sampled_from("ab# \n\r\té")) | st.none())
def test_the_hook_goes_in_once_and_leaves_the_same_bytes(text: str | None) -> None:
    hooked = with_hook(text, PLACES)
    assert len(hooks(hooked)) == 1 and hooked.endswith(hook_line(PLACES) + "\n")
    assert with_hook(hooked, PLACES) == hooked
    assert without_hook(hooked) == text


@given(st.text(alphabet=st.sampled_from("ab#\n")), st.text(alphabet=st.sampled_from("cd#\n"), min_size=1))
def test_lines_written_below_the_hook_survive_it_as_lines(before: str, below: str) -> None:
    rest = without_hook(with_hook(before, PLACES) + below)
    assert rest is not None and rest.endswith(below) and rest.startswith(before)
    assert not before or rest.splitlines()[: len(before.splitlines())] == before.splitlines()


def test_a_hook_before_a_workspace_moves_behind_it() -> None:
    wrong = with_hook("alias ll='ls -l'\n", PLACES) + SETUP
    assert misplaced(wrong) == [SETUP.strip()]
    right = with_hook(wrong, PLACES)
    assert not misplaced(right) and right.index(SETUP) < right.index(MARK) and len(hooks(right)) == 1
    assert without_hook(right) == "alias ll='ls -l'\n" + SETUP


@pytest.mark.parametrize(
    "line",
    [
        ". ~/ros2_ws/install/setup.bash",
        "  [ -f x ] && source ~/mirte_ws/install/local_setup.bash",
        "source /opt/ros/humble/setup.zsh",
        "export ROS_DISCOVERY_SERVER=",
        "unset ROS_DISCOVERY_SERVER",
        "RMW_IMPLEMENTATION=rmw_cyclonedds_cpp",
    ],
)
def test_what_undoes_the_hook_is_seen_after_it_and_only_there(line: str) -> None:
    assert misplaced(with_hook("", PLACES) + line + "\n") == [line.strip()]
    assert misplaced(with_hook(line + "\n", PLACES)) == []
    assert misplaced(with_hook("", PLACES) + f"# {line}\n") == []


def test_the_exports_are_three_lines_and_what_lupin_up_reads() -> None:
    text = exports("10.42.0.1", PLACES)
    assert len(text.splitlines()) == 3 and all(line.startswith("export ") for line in text.splitlines())
    found, others = read_exports(text, PLACES.home)
    assert others == [] and found == {
        "FASTRTPS_DEFAULT_PROFILES_FILE": "/home/op/.config/lupin/fastdds_super_client.xml",
        "ROS_DISCOVERY_SERVER": "10.42.0.1:11811",
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    }


def test_lupin_up_and_a_shell_read_the_same_from_the_file(tmp_path: Path) -> None:
    places = Places(tmp_path, tmp_path / ".config" / "lupin")
    places.directory.mkdir(parents=True)
    places.exports.write_text(exports("10.42.0.1", places))
    applied, names = robot_environment({"HOME": str(tmp_path)})
    command = ["sh", "-c", f". {places.exports}; env"]
    said = subprocess.run(command, env={"HOME": str(tmp_path)}, capture_output=True, text=True, check=True).stdout
    shell = dict(line.split("=", 1) for line in said.splitlines())
    assert len(names) == 3
    assert {name: applied[name] for name in names} == {name: shell[name] for name in names}


@pytest.mark.parametrize(
    "text", ["", "robot", "10.42.0", "10.42.0.1:11811", "0.0.0.0", "224.0.0.1", "::1", "10.42.0.1; rm -rf /"]
)
def test_what_is_no_robots_address_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="is no"):
        valid_ip(text)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("SUPER_CLIENT<", "CLIENT<", "discoveryProtocol is CLIENT, not SUPER_CLIENT"),
        ("44.53.00", "44.53.01", "prefix is 44.53.01"),
        (' is_default_profile="true"', "", "not the default profile"),
        ("10.42.0.1", "192.168.42.1", "names the server at 192.168.42.1, ros-env.sh the one at 10.42.0.1"),
        ("11811", "11812", "port is 11812"),
        ("</dds>", "", "not well-formed"),
    ],
)
def test_each_fault_of_the_profile_is_named(old: str, new: str, says: str) -> None:
    assert check_profile(profile_xml("10.42.0.1"), "10.42.0.1", PLACES, "fix").problem == ""
    item = check_profile(profile_xml("10.42.0.1").replace(old, new), "10.42.0.1", PLACES, "fix")
    assert says in item.problem and item.fix == "fix"


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("export RMW_IMPLEMENTATION=rmw_fastrtps_cpp\n", "", "RMW_IMPLEMENTATION is missing"),
        ("rmw_fastrtps_cpp", "rmw_cyclonedds_cpp", "reads neither"),
        ("10.42.0.1:11811", "", "not ADDRESS:11811"),
        ("10.42.0.1:11811", "10.42.0.1", "not ADDRESS:11811"),
        ("fastdds_super", "other", "not /home/op/.config/lupin/fastdds_super_client.xml"),
        ("export RMW", "pkill -f ros2cli\nexport RMW", "it does more than export: pkill"),
        ("export RMW", "export ROS_DOMAIN_ID=3\nexport RMW", "exports ROS_DOMAIN_ID as well"),
    ],
)
def test_each_fault_of_the_exports_is_named(old: str, new: str, says: str) -> None:
    assert check_exports(exports("10.42.0.1", PLACES), PLACES, "fix").problem == ""
    assert says in check_exports(exports("10.42.0.1", PLACES).replace(old, new), PLACES, "fix").problem


def test_each_fault_of_the_start_file_is_named() -> None:
    right = with_hook(SETUP, PLACES)

    def problem(text: str | None) -> str:
        return check_hook(text, Path(".bashrc"), PLACES, "fix").problem

    assert problem(right) == ""
    assert "does not read" in problem(SETUP) and "does not read" in problem(None)
    assert "2 times" in problem(right + f"\n{MARK}\n{hook_line(PLACES)}\n")
    assert "undoes it: source" in problem(right + SETUP)
    assert "another file" in problem(right.replace("lupin/ros-env", "elsewhere/ros-env"))


# -- the command, by its real entry


@pytest.fixture
def home(tmp_path: Path) -> Path:
    (tmp_path / ".bashrc").write_bytes(b"alias ll='ls -l'\nexport L\xe4=1  # no UTF-8, and no new line at the end")
    (tmp_path / ".bashrc").chmod(0o640)
    return tmp_path


def lupin(home: Path, *arguments: str, **more: str) -> subprocess.CompletedProcess[str]:
    hidden = {"XDG_CONFIG_HOME", "ROBOT_IP", "FASTRTPS_DEFAULT_PROFILES_FILE", "ROS_DISCOVERY_SERVER", "RMW_IMPLEMENTATION"}
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    environment |= {"HOME": str(home), "SHELL": "/bin/bash", **more}
    command = [sys.executable, "-m", "lupin_cli.app", "dds", *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)


def tree(home: Path) -> dict[str, bytes]:
    return {str(path.relative_to(home)): path.read_bytes() for path in home.rglob("*") if path.is_file()}


def test_setup_check_and_remove_leave_the_home_as_it_was(home: Path) -> None:
    before = tree(home)
    dry = lupin(home, "setup", "10.42.0.1", "--dry-run")
    assert dry.returncode == 0 and "+export ROS_DISCOVERY_SERVER" in dry.stdout and tree(home) == before
    assert lupin(home, "check").returncode == 1

    assert lupin(home, "setup", "10.42.0.1").returncode == 0
    assert (home / ".bashrc").stat().st_mode & 0o777 == 0o640
    after = tree(home)
    again = lupin(home, "setup", "10.42.0.1")
    assert "nothing to do" in again.stdout and tree(home) == after

    found, _ = read_exports((home / ".config/lupin/ros-env.sh").read_text(), home)
    checked = lupin(home, "check", "--json", **found)
    assert checked.returncode == 0, checked.stdout
    assert [item["name"] for item in json.loads(checked.stdout)] == [
        "profile",
        "exports",
        "hook",
        "new terminal",
        "this terminal",
    ]

    assert lupin(home, "remove").returncode == 0
    left = tree(home)
    assert left.pop(".bashrc.lupin-backup") == after[".bashrc"]
    assert left == before


def test_another_address_changes_both_files_and_not_the_start_file(home: Path) -> None:
    lupin(home, "setup", "10.42.0.1")
    before = tree(home)
    lupin(home, "setup", ROBOT_IP="192.168.42.1")
    after = tree(home)
    assert {name for name in after if after[name] != before[name]} == {
        ".config/lupin/fastdds_super_client.xml",
        ".config/lupin/ros-env.sh",
    }


def test_a_new_terminal_whose_variables_are_emptied_later_is_found_by_opening_one(home: Path) -> None:
    lupin(home, "setup", "10.42.0.1")
    (home / ".vendor").write_text("unset ROS_DISCOVERY_SERVER\n")
    with (home / ".bashrc").open("a") as file:
        file.write(". ~/.vendor\n")  # the name gives nothing away
    found, _ = read_exports((home / ".config/lupin/ros-env.sh").read_text(), home)
    items = {item["name"]: item["problem"] for item in json.loads(lupin(home, "check", "--json", **found).stdout)}
    assert items["hook"] == "" and "ROS_DISCOVERY_SERVER is not set" in items["new terminal"]
    items = {item["name"]: item["problem"] for item in json.loads(lupin(home, "check", "--json").stdout)}
    assert "RMW_IMPLEMENTATION is not set" in items["this terminal"]


def test_a_start_file_that_is_a_link_stays_one(home: Path) -> None:
    (home / ".bashrc").rename(home / "dotfiles")
    (home / ".bashrc").symlink_to("dotfiles")
    lupin(home, "setup", "10.42.0.1")
    assert (home / ".bashrc").is_symlink() and MARK in (home / "dotfiles").read_bytes().decode("latin-1")


def test_zsh_has_a_start_file_of_its_own_that_goes_again(home: Path) -> None:
    before = tree(home)
    assert lupin(home, "setup", "--shell", "zsh").returncode == 0
    assert (home / ".zshrc").exists()
    lupin(home, "remove")
    left = tree(home)
    left.pop(".zshrc.lupin-backup")
    assert left == before


@pytest.mark.parametrize("arguments", [("setup", "robot"), ("setup", "--shell", "fish"), ("check", "--shell", "fish")])
def test_what_can_not_be_meant_ends_in_two(home: Path, arguments: tuple[str, ...]) -> None:
    said = lupin(home, *arguments)
    assert said.returncode == 2 and said.stderr.startswith("lupin dds: ") and len(said.stderr.splitlines()) == 1
