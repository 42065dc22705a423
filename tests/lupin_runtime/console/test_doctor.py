"""The doctor in a browser: a real examination, and a fix that is previewed and then played."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.support.console_browser import Browser
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

TIMEOUT_S = 90.0


@pytest.fixture
def browser(graph_host: GraphHost, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Browser]:
    from lupin_runtime.console.node import Console

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    node: Console = graph_host.add(Console({"port": 0, "rosbridge_port": 0, "folder": str(tmp_path)}))
    yield Browser(node.port)
    node.before_shutdown()


@pytest.fixture
def orphan() -> Iterator[Path]:
    """A shared-memory segment with its lock, left by a killed process."""
    segment = Path(f"/dev/shm/fastrtps_{os.urandom(8).hex()}")
    lock = segment.with_name(f"{segment.name}_el")
    segment.write_bytes(bytes(1000))
    lock.touch()
    # The doctor ignores files that were created just now.
    for path in (segment, lock):
        os.utime(path, (time.time() - 3600, time.time() - 3600))
    yield segment
    segment.unlink(missing_ok=True)
    lock.unlink(missing_ok=True)


def examined(browser: Browser, after_s: float = 0.0) -> dict[str, Any]:
    """Return the state after an examination that ended later than `after_s`."""

    def find() -> dict[str, Any] | None:
        state: dict[str, Any] = browser.get("/_api/doctor")
        assert not state["problem"]
        return state if not state["busy"] and (state["examined_s"] or 0) > after_s else None

    return wait_until(find, lambda: f"an examination: {browser.get('/_api/doctor')}", TIMEOUT_S)


def test_finding_is_listed_previewed_and_fixed(browser: Browser, orphan: Path) -> None:
    assert browser.get("/_api/doctor")["diagnosis"] is None
    assert browser.post("/_api/doctor/examination")["busy"] == "examining"
    browser.post("/_api/doctor/examination")  # one is already running
    state = examined(browser)
    finding = next(row for row in state["diagnosis"]["findings"] if row["id"] == "shared-memory-orphans")
    assert finding["fix"]["playbook"] == "sweep"

    preview = browser.post("/_api/doctor/fix", finding=finding["id"], confirmed=False)
    assert preview["dry_run"] and str(orphan) in preview["steps"][0]["diff"]
    assert orphan.exists()
    played = browser.post("/_api/doctor/fix", finding=finding["id"], confirmed=True)
    assert played["state"] == "done" and not orphan.exists()
    after = examined(browser, state["examined_s"])
    assert str(orphan) not in str(after["diagnosis"])


def test_fix_needs_control_and_a_finding(browser: Browser, tmp_path: Path) -> None:
    status, answer = browser.request("POST", "/_api/doctor/fix", {"finding": "shared-memory-orphans", "confirmed": True})
    assert status == 409 and "examine again" in answer["error"]
    for body in ({}, {"finding": 3, "confirmed": True}, {"finding": "x", "confirmed": "yes"}):
        assert browser.request("POST", "/_api/doctor/fix", body)[0] == 400
    viewer = Browser(browser.port, proxied=True)
    viewer.post("/_api/pair", code=json.loads((tmp_path / "console.json").read_text())["codes"]["viewer"])
    status, answer = viewer.request("POST", "/_api/doctor/fix", {"finding": "x", "confirmed": False})
    assert status == 403 and "is a viewer" in answer["error"]
