"""What `lupin dds` writes, checks and removes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.link.dds_check import check_exports, check_hook, check_profile, read_exports
from lupin_cli.link.dds_setup import (
    MARK,
    SetupPaths,
    add_hook,
    exports_text,
    find_hooks,
    hook_line,
    lines_undoing_hook,
    parse_robot_ip,
    profile_xml,
    remove_hook,
)
from lupin_runtime.stack.dds import robot_environment

PATHS = SetupPaths(Path("/home/op"), Path("/home/op/.config/lupin"))
SETUP = "source /opt/ros/humble/setup.bash\n"


@given(st.text(alphabet=st.sampled_from("ab# \n\r\té")) | st.none())
def test_adding_and_removing_hook_restores_bytes(text: str | None) -> None:
    hooked = add_hook(text, PATHS)
    assert len(find_hooks(hooked)) == 1 and hooked.endswith(hook_line(PATHS) + "\n")
    assert add_hook(hooked, PATHS) == hooked
    assert remove_hook(hooked) == text


@given(st.text(alphabet=st.sampled_from("ab#\n")), st.text(alphabet=st.sampled_from("cd#\n"), min_size=1))
def test_lines_below_removed_hook_stay_separate(before: str, below: str) -> None:
    rest = remove_hook(add_hook(before, PATHS) + below)
    assert rest is not None and rest.endswith(below) and rest.startswith(before)
    assert not before or rest.splitlines()[: len(before.splitlines())] == before.splitlines()


def test_hook_is_moved_after_workspace_setup() -> None:
    wrong = add_hook("alias ll='ls -l'\n", PATHS) + SETUP
    assert lines_undoing_hook(wrong) == [SETUP.strip()]
    right = add_hook(wrong, PATHS)
    assert not lines_undoing_hook(right) and right.index(SETUP) < right.index(MARK) and len(find_hooks(right)) == 1
    assert remove_hook(right) == "alias ll='ls -l'\n" + SETUP


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
def test_line_undoing_hook_is_found_only_after_it(line: str) -> None:
    assert lines_undoing_hook(add_hook("", PATHS) + line + "\n") == [line.strip()]
    assert lines_undoing_hook(add_hook(line + "\n", PATHS)) == []
    assert lines_undoing_hook(add_hook("", PATHS) + f"# {line}\n") == []


def test_exports_are_three_variables() -> None:
    text = exports_text("10.42.0.1", PATHS)
    assert len(text.splitlines()) == 3 and all(line.startswith("export ") for line in text.splitlines())
    found, others = read_exports(text, PATHS.home)
    assert others == [] and found == {
        "FASTRTPS_DEFAULT_PROFILES_FILE": "/home/op/.config/lupin/fastdds_super_client.xml",
        "ROS_DISCOVERY_SERVER": "10.42.0.1:11811",
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    }


def test_lupin_up_and_shell_read_same_exports(tmp_path: Path) -> None:
    paths = SetupPaths(tmp_path, tmp_path / ".config" / "lupin")
    paths.directory.mkdir(parents=True)
    paths.exports.write_text(exports_text("10.42.0.1", paths))
    applied, names = robot_environment({"HOME": str(tmp_path)})
    command = ["sh", "-c", f". {paths.exports}; env"]
    output = subprocess.run(command, env={"HOME": str(tmp_path)}, capture_output=True, text=True, check=True).stdout
    shell = dict(line.split("=", 1) for line in output.splitlines())
    assert len(names) == 3
    assert {name: applied[name] for name in names} == {name: shell[name] for name in names}


@pytest.mark.parametrize(
    "text", ["", "robot", "10.42.0", "10.42.0.1:11811", "0.0.0.0", "224.0.0.1", "::1", "10.42.0.1; rm -rf /"]
)
def test_invalid_robot_address_is_rejected(text: str) -> None:
    with pytest.raises(ValueError, match=r"is not an IPv4 address|cannot be the address"):
        parse_robot_ip(text)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("SUPER_CLIENT<", "CLIENT<", "discoveryProtocol is CLIENT, not SUPER_CLIENT"),
        ("44.53.00", "44.53.01", "prefix is 44.53.01"),
        (' is_default_profile="true"', "", "not the default profile"),
        ("10.42.0.1", "192.168.42.1", "names the server at 192.168.42.1, ros-env.sh the one at 10.42.0.1"),
        ("11811", "11812", "port is 11812"),
        ("</dds>", "", "not well-formed"),
    ],
)
def test_each_fault_of_profile_is_named(old: str, new: str, problem: str) -> None:
    assert check_profile(profile_xml("10.42.0.1"), "10.42.0.1", PATHS, "fix").problem == ""
    item = check_profile(profile_xml("10.42.0.1").replace(old, new), "10.42.0.1", PATHS, "fix")
    assert problem in item.problem and item.fix == "fix"


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("export RMW_IMPLEMENTATION=rmw_fastrtps_cpp\n", "", "RMW_IMPLEMENTATION is missing"),
        ("rmw_fastrtps_cpp", "rmw_cyclonedds_cpp", "ignores the other two"),
        ("10.42.0.1:11811", "", "not ADDRESS:11811"),
        ("10.42.0.1:11811", "10.42.0.1", "not ADDRESS:11811"),
        ("fastdds_super", "other", "not /home/op/.config/lupin/fastdds_super_client.xml"),
        ("export RMW", "pkill -f ros2cli\nexport RMW", "must only export variables, but has: pkill"),
        ("export RMW", "export ROS_DOMAIN_ID=3\nexport RMW", "exports ROS_DOMAIN_ID as well"),
    ],
)
def test_each_fault_of_exports_is_named(old: str, new: str, problem: str) -> None:
    assert check_exports(exports_text("10.42.0.1", PATHS), PATHS, "fix").problem == ""
    assert problem in check_exports(exports_text("10.42.0.1", PATHS).replace(old, new), PATHS, "fix").problem


def test_each_fault_of_start_file_is_named() -> None:
    right = add_hook(SETUP, PATHS)

    def problem(text: str | None) -> str:
        return check_hook(text, Path(".bashrc"), PATHS, "fix").problem

    assert problem(right) == ""
    assert "does not source" in problem(SETUP) and "does not source" in problem(None)
    assert "2 times" in problem(right + f"\n{MARK}\n{hook_line(PATHS)}\n")
    assert "undoes it: source" in problem(right + SETUP)
    assert "another file" in problem(right.replace("lupin/ros-env", "elsewhere/ros-env"))


# -- the command


@pytest.fixture
def home(tmp_path: Path) -> Path:
    (tmp_path / ".bashrc").write_bytes(b"alias ll='ls -l'\nexport L\xe4=1  # invalid UTF-8, and no final newline")
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


def test_setup_and_remove_restore_home(home: Path) -> None:
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
    remaining = tree(home)
    assert remaining.pop(".bashrc.lupin-backup") == after[".bashrc"]
    assert remaining == before


def test_new_address_changes_profile_and_exports_only(home: Path) -> None:
    lupin(home, "setup", "10.42.0.1")
    before = tree(home)
    lupin(home, "setup", ROBOT_IP="192.168.42.1")
    after = tree(home)
    assert {name for name in after if after[name] != before[name]} == {
        ".config/lupin/fastdds_super_client.xml",
        ".config/lupin/ros-env.sh",
    }


def test_check_finds_new_terminal_with_unset_variables(home: Path) -> None:
    lupin(home, "setup", "10.42.0.1")
    (home / ".vendor").write_text("unset ROS_DISCOVERY_SERVER\n")
    with (home / ".bashrc").open("a") as file:
        file.write(". ~/.vendor\n")  # the line alone does not show that it unsets a variable
    found, _ = read_exports((home / ".config/lupin/ros-env.sh").read_text(), home)
    items = {item["name"]: item["problem"] for item in json.loads(lupin(home, "check", "--json", **found).stdout)}
    assert items["hook"] == "" and "ROS_DISCOVERY_SERVER is not set" in items["new terminal"]
    items = {item["name"]: item["problem"] for item in json.loads(lupin(home, "check", "--json").stdout)}
    assert "RMW_IMPLEMENTATION is not set" in items["this terminal"]


def test_symlinked_start_file_stays_a_symlink(home: Path) -> None:
    (home / ".bashrc").rename(home / "dotfiles")
    (home / ".bashrc").symlink_to("dotfiles")
    lupin(home, "setup", "10.42.0.1")
    assert (home / ".bashrc").is_symlink() and MARK in (home / "dotfiles").read_bytes().decode("latin-1")


def test_zsh_start_file_is_created_and_removed(home: Path) -> None:
    before = tree(home)
    assert lupin(home, "setup", "--shell", "zsh").returncode == 0
    assert (home / ".zshrc").exists()
    lupin(home, "remove")
    remaining = tree(home)
    remaining.pop(".zshrc.lupin-backup")
    assert remaining == before


@pytest.mark.parametrize("arguments", [("setup", "robot"), ("setup", "--shell", "fish"), ("check", "--shell", "fish")])
def test_usage_error_exits_with_2_and_one_line(home: Path, arguments: tuple[str, ...]) -> None:
    done = lupin(home, *arguments)
    assert done.returncode == 2 and done.stderr.startswith("lupin dds: ") and len(done.stderr.splitlines()) == 1
