"""Approach overrides that browsers draw are in the file that the mission reads."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime.console import approaches
from lupin_runtime.mission.overrides import Override, load_overrides
from tests.support.console_browser import Browser

if TYPE_CHECKING:
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

POSE = {"x": 1.5, "y": -2.0, "yaw": 0.5}


@pytest.fixture
def overrides(tmp_path: Path) -> Path:
    """The file of a run whose operator gave a standoff for tag 41."""
    path = tmp_path / "overrides.yaml"
    path.write_text('overrides:\n  "41": {standoff: 0.6}\n')
    return path


@pytest.fixture
def browser(graph_host: GraphHost, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Browser]:
    from lupin_runtime.console.node import Console

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    node: Console = graph_host.add(Console({"port": 0, "rosbridge_port": 0, "folder": str(tmp_path)}))
    yield Browser(node.port)
    node.before_shutdown()


def test_drawn_approach_is_stored_shared_and_removed(browser: Browser, overrides: Path, tmp_path: Path) -> None:
    assert browser.get("/_api/approaches") == {"41": {"standoff": 0.6}}
    events = browser.socket("/_api/events")
    drawn = {"goal_x": 1.5, "goal_y": -2.0, "yaw": 0.5, "standoff": 0.6}
    assert browser.post("/_api/approaches", tag="41", pose=POSE) == {"41": drawn}
    events.wait(lambda event: event["event"] == "approaches" and event["value"] == {"41": drawn})
    events.close()
    assert browser.post("/_api/approaches", tag="7", pose={**POSE, "yaw": 7.0})["7"]["yaw"] == pytest.approx(
        7.0 - 6.283185, abs=1e-5
    )
    assert load_overrides(overrides)["41"] == Override(1.5, -2.0, 0.5, 0.6)
    assert browser.post("/_api/approaches", tag="41", pose=None).keys() == {"7"}
    assert browser.post("/_api/approaches", tag="41", pose=None).keys() == {"7"}
    rows = [json.loads(line)["what"] for line in (tmp_path / "console_commands.jsonl").read_text().splitlines()]
    assert "save approach of tag 41" in rows and "remove approach of tag 41" in rows


@pytest.mark.parametrize(
    ("tag", "pose"),
    [
        (7, POSE),
        ("", POSE),
        ("a" * 65, POSE),
        ("a\nb", POSE),
        (None, None),
        ("7", {"x": 1.0}),
        ("7", {**POSE, "y": 1e9}),
        ("7", []),
    ],
)
def test_malformed_approach_is_refused(browser: Browser, overrides: Path, tag: Any, pose: Any) -> None:
    before = overrides.read_bytes()
    assert browser.request("POST", "/_api/approaches", {"tag": tag, "pose": pose})[0] == 400
    assert overrides.read_bytes() == before


def test_approach_that_no_mission_would_read_is_refused(browser: Browser) -> None:
    assert browser.get("/_api/approaches") == {}
    status, answer = browser.request("POST", "/_api/approaches", {"tag": "7", "pose": POSE})
    assert status == 409 and "lupin up" in answer


def test_damaged_file_is_reported_and_kept(browser: Browser, overrides: Path) -> None:
    overrides.write_text("overrides: [1]\n")
    for status, answer in (
        browser.request("GET", "/_api/approaches"),
        browser.request("POST", "/_api/approaches", {"tag": "7", "pose": POSE}),
    ):
        assert status == 409 and "overrides.yaml:1" in answer
    assert overrides.read_text() == "overrides: [1]\n"


def test_approaches_are_limited(browser: Browser, overrides: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(approaches, "MAX_APPROACHES", 1)
    assert browser.request("POST", "/_api/approaches", {"tag": "41", "pose": POSE})[0] == 200
    assert browser.request("POST", "/_api/approaches", {"tag": "7", "pose": POSE})[0] == 409
    assert load_overrides(overrides).keys() == {"41"}
