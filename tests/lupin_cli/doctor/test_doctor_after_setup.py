"""`lupin dds setup` writes what `lupin doctor` accepts as a healthy laptop."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SERVER = "10.42.0.1"
LUPIN = (sys.executable, "-m", "lupin_cli.app")


def run_lupin(home: Path, *words: str, **variables: str) -> subprocess.CompletedProcess[str]:
    dds = ("ROS_", "RMW_", "FASTRTPS_", "FASTDDS_", "XDG_")
    environment = {name: value for name, value in os.environ.items() if not name.startswith(dds)}
    environment.update(HOME=str(home), SHELL="/bin/bash", **variables)
    return subprocess.run([*LUPIN, *words], env=environment, capture_output=True, text=True, timeout=120, check=False)


def sourced(home: Path) -> dict[str, str]:
    """Return the ROS variables of a new shell that has read ~/.bashrc."""
    program = ". ~/.bashrc; env -0"
    bare = {"HOME": str(home), "PATH": os.environ["PATH"], "PS1": "$ "}
    done = subprocess.run(["bash", "-c", program], env=bare, capture_output=True, text=True, timeout=60, check=True)
    found = dict(line.split("=", 1) for line in done.stdout.split("\0") if "=" in line)
    return {name: value for name, value in found.items() if name.startswith(("ROS_", "RMW_", "FASTRTPS_"))}


@pytest.fixture
def home(tmp_path: Path) -> Path:
    (tmp_path / ".bashrc").write_text("# the operator's settings\n")
    done = run_lupin(tmp_path, "dds", "setup", SERVER, "--shell", "bash")
    assert done.returncode == 0, done.stderr
    return tmp_path


def root_causes(home: Path, **variables: str) -> list[str]:
    """Return the root causes in shell and profile; the robot need not answer."""
    options = ("--host", "127.0.0.1:1", "--only", "dds.shell", "--only", "dds.profiles")
    done = run_lupin(home, "doctor", *options, "--json", **variables)
    report = json.loads(done.stdout)
    assert report["unknown"] == []
    return [finding["id"] for finding in report["findings"]]


def test_new_shell_after_setup_is_healthy(home: Path) -> None:
    variables = sourced(home)
    assert variables["ROS_DISCOVERY_SERVER"] == f"{SERVER}:11811"
    assert root_causes(home, **variables) == []


def test_shell_older_than_setup_is_named(home: Path) -> None:
    assert root_causes(home) == ["shell-multicast-only"]


def test_removed_setup_is_named_as_missing(home: Path) -> None:
    assert run_lupin(home, "dds", "remove", "--shell", "bash").returncode == 0
    assert root_causes(home) == ["dds-not-set-up"]
