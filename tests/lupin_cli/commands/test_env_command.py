"""`lupin env`: a shell that evaluates its output has the variables of the run's graph, and no others."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from lupin_runtime.stack.runs import create_run

PROFILE = "/runs/it's here; $(touch owned)/fastdds.xml"


@pytest.fixture(autouse=True)
def live_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setenv("ROS_DISCOVERY_SERVER", "10.42.0.1:11811")
    run, lock = create_run()
    run.write_info({"environment": {"ROS_DOMAIN_ID": "57", "FASTRTPS_DEFAULT_PROFILES_FILE": PROFILE}})
    yield
    os.close(lock)


def env(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "lupin_cli.app", "env", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_evaluated_output_joins_the_graph(tmp_path: Path) -> None:
    program = f'eval "$({sys.executable} -m lupin_cli.app env)"; env -0'
    done = subprocess.run(["sh", "-c", program], capture_output=True, text=True, timeout=60, check=True)
    variables = dict(line.split("=", 1) for line in done.stdout.split("\0") if line)
    assert (variables["ROS_DOMAIN_ID"], variables["FASTRTPS_DEFAULT_PROFILES_FILE"]) == ("57", PROFILE)
    assert "ROS_DISCOVERY_SERVER" not in variables, "it would take the shell out of the graph"
    assert not (tmp_path / "owned").exists()


def test_other_forms_of_the_environment() -> None:
    assert json.loads(env("--json").stdout)["unset"] == ["ROS_DISCOVERY_SERVER"]
    assert env("--shell", "fish").stdout.splitlines()[0] == "set -gx ROS_DOMAIN_ID 57"
    assert env("--shell", "tcsh").returncode == 2


def test_nothing_is_printed_for_eval_without_a_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "none"))
    done = env()
    assert (done.returncode, done.stdout) == (3, "") and "lupin up" in done.stderr
