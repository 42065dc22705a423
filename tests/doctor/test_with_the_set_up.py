"""What `lupin dds setup` writes is what the doctor takes for a healthy laptop."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SERVER = "10.42.0.1"
LUPIN = (sys.executable, "-m", "lupin_cli.app")


def lupin(home: Path, *words: str, **variables: str) -> subprocess.CompletedProcess[str]:
    dds = ("ROS_", "RMW_", "FASTRTPS_", "FASTDDS_", "XDG_")
    environment = {name: value for name, value in os.environ.items() if not name.startswith(dds)}
    environment.update(HOME=str(home), SHELL="/bin/bash", **variables)
    return subprocess.run([*LUPIN, *words], env=environment, capture_output=True, text=True, timeout=120, check=False)


def sourced(home: Path) -> dict[str, str]:
    """The graph's variables in a shell that read its start file."""
    program = ". ~/.bashrc; env -0"
    bare = {"HOME": str(home), "PATH": os.environ["PATH"], "PS1": "$ "}
    done = subprocess.run(["bash", "-c", program], env=bare, capture_output=True, text=True, timeout=30, check=True)
    found = dict(line.split("=", 1) for line in done.stdout.split("\0") if "=" in line)
    return {name: value for name, value in found.items() if name.startswith(("ROS_", "RMW_", "FASTRTPS_"))}


@pytest.fixture
def home(tmp_path: Path) -> Path:
    (tmp_path / ".bashrc").write_text("# a shell\n")
    done = lupin(tmp_path, "dds", "setup", SERVER, "--shell", "bash")
    assert done.returncode == 0, done.stderr
    return tmp_path


def causes(home: Path, **variables: str) -> list[str]:
    """What is wrong with shell and profile, for a robot that need not answer."""
    where = ("--host", "127.0.0.1:1", "--only", "dds.shell", "--only", "dds.profiles")
    done = lupin(home, "doctor", *where, "--json", **variables)
    told = json.loads(done.stdout)
    assert told["unknown"] == []
    return [finding["id"] for finding in told["findings"]]


def test_a_new_shell_after_the_set_up_is_healthy(home: Path) -> None:
    variables = sourced(home)
    assert variables["ROS_DISCOVERY_SERVER"] == f"{SERVER}:11811"
    assert causes(home, **variables) == []


def test_a_shell_that_is_older_than_the_set_up_is_named(home: Path) -> None:
    assert causes(home) == ["shell-multicast-only"]


def test_a_machine_whose_set_up_was_taken_back_is_named_as_never_set_up(home: Path) -> None:
    assert lupin(home, "dds", "remove", "--shell", "bash").returncode == 0
    assert causes(home) == ["dds-not-set-up"]
