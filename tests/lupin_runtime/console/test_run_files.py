"""The API serves runs, their files and saved maps, and no other files."""

from __future__ import annotations

import http.client
import json
import os
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_runtime.stack.runs import Run, create_run
from tests.support.console_browser import Browser

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph

RECORDING = bytes(range(256)) * 100


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Run]:
    """A live run with a state, a recording, logs, a report and commands."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    made, lock = create_run()
    made.write_info({"started": 1.8e9, "options": {"world": "demo"}, "environment": {"SECRET": "s3cret"}})
    made.write_state({"stages": [{"name": "nav", "phase": "up"}], "mission": {"lifecycle_state": "EXPLORING"}})
    made.recording.write_bytes(RECORDING)
    made.report.mkdir()
    (made.report / "report.html").write_text("<script>1</script>")
    (made.logs / "nav.log").write_bytes(b"x" * 300_000 + b"\xff the end\n")
    (tmp_path / "lupin" / "maps").mkdir()
    (tmp_path / "lupin" / "maps" / "demo.yaml").write_text("image: demo.pgm\n")
    (tmp_path / "lupin" / "maps" / "private.txt").write_text("no map")
    yield made
    os.close(lock)


@pytest.fixture
def browser(graph_host: GraphHost, run: Run) -> Iterator[Browser]:
    from lupin_runtime.console.node import Console

    node: Console = graph_host.add(Console({"port": 0, "rosbridge_port": 0, "folder": str(run.path)}))
    yield Browser(node.port)
    node.before_shutdown()


def test_runs_are_listed_with_their_state(browser: Browser, run: Run) -> None:
    (listed,) = browser.get("/_api/runs")
    assert (listed["id"], listed["state"], listed["kept"], listed["started_s"]) == (run.id, "up", False, 1.8e9)
    assert listed["size_bytes"] > len(RECORDING)
    one = browser.get(f"/_api/runs/{run.id}")
    assert (one["up"], one["options"], one["result"]) == (True, {"world": "demo"}, None)
    assert one["state"]["mission"]["lifecycle_state"] == "EXPLORING"
    assert "s3cret" not in json.dumps(one)


def test_state_of_the_run_is_pushed(browser: Browser, run: Run) -> None:
    events = browser.socket("/_api/events")
    try:
        events.wait(lambda event: event["event"] == "run" and event["value"]["mission"]["lifecycle_state"] == "EXPLORING")
        run.write_state({"mission": {"lifecycle_state": "DONE"}})
        events.wait(lambda event: event["event"] == "run" and event["value"]["mission"]["lifecycle_state"] == "DONE")
    finally:
        events.close()


def test_recording_is_served_in_ranges(browser: Browser, run: Run) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", browser.port, timeout=60)
    connection.request("GET", f"/_api/runs/{run.id}/recording", headers={"Range": "bytes=1000-1999"})
    answer = connection.getresponse()
    assert (answer.status, answer.read()) == (206, RECORDING[1000:2000])
    assert run.id in answer.getheader("Content-Disposition", "")
    connection.close()


def test_report_cannot_reach_the_console(browser: Browser, run: Run) -> None:
    assert browser.get(f"/_api/runs/{run.id}/report/report.html") == "<script>1</script>"
    policy = browser.response_headers["Content-Security-Policy"]
    assert "sandbox allow-scripts" in policy and "allow-same-origin" not in policy and "default-src 'none'" in policy
    status, text = browser.request("GET", f"/_api/runs/{run.id}/report/report.json")
    assert status == 404 and "no report yet" in text


def test_end_of_log_is_served_as_text(browser: Browser, run: Run) -> None:
    assert browser.get(f"/_api/runs/{run.id}/logs") == ["nav"]
    connection = http.client.HTTPConnection("127.0.0.1", browser.port, timeout=60)
    connection.request("GET", f"/_api/runs/{run.id}/logs/nav")
    answer = connection.getresponse()
    log = answer.read()
    connection.close()
    assert log.endswith(b"\xff the end\n") and len(log) == 256_000
    assert answer.getheader("Content-Type", "").startswith("text/plain")


def test_command_journal_is_served(browser: Browser, run: Run) -> None:
    browser.post("/_api/stop", engaged=True)
    with (run.path / "console_commands.jsonl").open("a") as file:
        file.write("{ cut")
    assert [row["what"] for row in browser.get(f"/_api/runs/{run.id}/commands")] == ["this computer stopped the robot"]


def test_maps_are_listed_and_read(browser: Browser) -> None:
    assert [each["name"] for each in browser.get("/_api/maps")["maps"]] == ["demo"]
    assert browser.get("/_api/maps/demo.yaml") == "image: demo.pgm\n"
    for name in ("private.txt", "demo", "..%2Fruns", "%2e%2e"):
        assert browser.request("GET", f"/_api/maps/{name}")[0] == 404


@pytest.mark.parametrize(
    "path",
    [
        "/_api/runs/nothing",
        "/_api/runs/..",
        "/_api/runs/%2e%2e%2f%2e%2e",
        "/_api/runs/RUN/report/..%2Frun.json",
        "/_api/runs/RUN/report/%2Fetc%2Fpasswd",
        "/_api/runs/RUN/logs/..%2F..%2Frun",
        "/_api/runs/RUN/logs/nav%00",
        "/_api/runs/RUN/run.json",
        "/_api/runs/RUN/recording/x",
    ],
)
def test_other_files_cannot_be_reached(browser: Browser, run: Run, path: str) -> None:
    status, text = browser.request("GET", path.replace("RUN", run.id))
    assert status == 404 and "SECRET" not in json.dumps(text)


def test_every_resource_is_described_and_needs_a_paired_browser(browser: Browser) -> None:
    described: dict[str, Any] = browser.get("/_api/openapi.json")
    assert described["openapi"].startswith("3.1")
    stranger = Browser(browser.port, proxied=True)
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            assert operation["summary"].endswith(".")
            status, _ = stranger.request(
                method.upper(), path.replace("{", "").replace("}", ""), {} if method == "post" else None
            )
            assert (status != 401) == (operation["security"] == []), path
    assert {"/_api/session", "/_api/pair"} == {
        path for path, methods in described["paths"].items() if any(row["security"] == [] for row in methods.values())
    }


@pytest.mark.parametrize("path", ["", "/RUN", "/RUN/logs", "/RUN/commands", "/RUN/report/report.html"])
def test_stop_does_not_wait_for_a_slow_disk(
    browser: Browser, run: Run, path: str, monkeypatch: pytest.MonkeyPatch, graph_host: GraphHost
) -> None:
    reading, released = threading.Event(), threading.Event()

    def wait(_: Any) -> bool:
        reading.set()
        assert released.wait(60.0)
        return True

    monkeypatch.setattr(Path, "is_dir", wait)
    with ThreadPoolExecutor() as pool:
        asked = pool.submit(browser.request, "GET", f"/_api/runs{path.replace('RUN', run.id)}")
        graph_host.until(reading.is_set)
        assert Browser(browser.port).post("/_api/stop", engaged=True)["stop"]
        assert not asked.done()
        released.set()
        assert asked.result(20.0)[0] == 200
