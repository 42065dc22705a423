"""Playbook runs and deploys in the API, from journals as `lupin play` writes them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli.package_data import shipped_folder
from lupin_cli.playbook.journal import journal_folder
from tests.support.console_browser import Browser
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

PLAYBOOK = """
name: greet
description: Say hello.
vars:
  token: {type: secret, help: Never shown.}
steps:
  - name: Say hello
    command: {run: touch FILE, unless: "[ -e FILE ]"}
    on: laptop
"""


@pytest.fixture
def browser(graph_host: GraphHost, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Browser]:
    from lupin_runtime.console.node import Console

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    node: Console = graph_host.add(Console({"port": 0, "rosbridge_port": 0, "folder": str(tmp_path)}))
    yield Browser(node.port)
    node.before_shutdown()


def write_play(name: str, playbook: str, robot: str, end: str | None) -> None:
    """Write a journal with one step; without `end`, the run was cut off."""
    start = {
        "event": "start",
        "run": name,
        "playbook": playbook,
        "file": str(shipped_folder("playbooks") / f"{playbook}.yaml"),
        "robot": robot,
        "digest": "d",
        "started": name,
    }
    events: list[dict[str, Any]] = [start]
    if end is not None:
        events.append({"event": "end", "state": end})
    folder = journal_folder()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))


def test_playbook_runs_are_listed_and_shown_without_secrets(browser: Browser, tmp_path: Path) -> None:
    assert browser.get("/_api/plays") == [] and browser.get("/_api/deployments") == []
    file = tmp_path / "greet.yaml"
    file.write_text(PLAYBOOK.replace("FILE", str(tmp_path / "greeted")))
    command = [sys.executable, "-m", "lupin_cli.app", "play", str(file), "--yes", "--var", "token=s3cret", "--json"]
    done = subprocess.run(command, env=os.environ, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (play,) = wait_until(lambda: browser.get("/_api/plays"), "an answer that is not repeated")
    assert (play["playbook"], play["state"], play["resume"]) == ("greet", "done", "")
    shown = browser.get(f"/_api/plays/{play['run']}")
    assert [step["name"] for step in shown["steps"]] == ["Say hello"]
    assert "s3cret" not in json.dumps([play, shown]) and "path" not in play


def test_only_last_deploy_to_each_robot_is_listed(browser: Browser) -> None:
    for number, (robot, end) in enumerate((("mirte", "done"), ("other", "done"), ("mirte", None))):
        write_play(f"20260101-00000{number}-deploy-robot", "deploy-robot", robot, end)
    write_play("20260101-000009-sync-clock", "sync-clock", "mirte", "done")
    seen = {row["robot"]: (row["run"], row["state"], row["resume"]) for row in browser.get("/_api/deployments")}
    assert seen["other"] == ("20260101-000001-deploy-robot", "done", "")
    assert seen["mirte"][0] == "20260101-000002-deploy-robot" and seen["mirte"][1] != "done"
    assert seen["mirte"][2] == "lupin play deploy-robot --robot mirte --resume"


@pytest.mark.parametrize("name", ["nothing", "--help", "..%2f..%2fetc%2fpasswd", "a%00b", "%1b%5b31m", "x" * 300])
def test_unknown_playbook_run_is_not_found(browser: Browser, name: str) -> None:
    assert browser.request("GET", f"/_api/plays/{name}")[0] == 404
