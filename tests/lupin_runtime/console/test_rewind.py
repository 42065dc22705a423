"""The API serves windows of a run's recording, decoded, and within limits."""

from __future__ import annotations

import http.client
import io
import os
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cbor2
import pytest

from lupin_runtime import graph
from lupin_runtime.record import window
from lupin_runtime.record.definitions import schema_text
from lupin_runtime.record.writer import RecordingWriter
from lupin_runtime.stack.runs import Run, create_run
from tests.support.console_browser import Browser

if TYPE_CHECKING:
    from lupin_runtime.console.node import Console
    from tests.conftest import GraphHost

pytestmark = pytest.mark.graph


def serialized(message: Any) -> bytes:
    from rclpy.serialization import serialize_message

    return bytes(serialize_message(message))


def add(writer: RecordingWriter, topic: graph.Topic) -> int:
    return writer.add_channel(topic.name, topic.type, schema_text(topic.type), topic.qos)


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Run]:
    """A run whose recording has a map at 1 s, the stop once a second to 9 s, and a sample that cannot be decoded."""
    from nav_msgs.msg import OccupancyGrid
    from std_msgs.msg import Bool

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    made, lock = create_run()
    writer = RecordingWriter(made.recording)
    grid = OccupancyGrid(data=[-1, 0, 100])
    grid.info.resolution = 0.05
    writer.write(add(writer, graph.MAP), serialized(grid), 1_000_000_000, 0)
    stop = add(writer, graph.ESTOP_STATE)
    for second in range(10):
        writer.write(stop, serialized(Bool(data=second >= 5)), second * 1_000_000_000, 0)
    writer.write(add(writer, graph.ODOM), b"\x00\x01\x00\x00\x01", 5_000_000_000, 0)
    writer.finish()
    yield made
    os.close(lock)


@pytest.fixture
def browser(graph_host: GraphHost, run: Run) -> Iterator[Browser]:
    from lupin_runtime.console.node import Console

    node: Console = graph_host.add(Console({"port": 0, "rosbridge_port": 0, "folder": str(run.path)}))
    yield Browser(node.port)
    node.before_shutdown()


def ask(browser: Browser, run: Run, query: str) -> tuple[int, bytes, str]:
    connection = http.client.HTTPConnection("127.0.0.1", browser.port, timeout=60)
    connection.request("GET", f"/_api/runs/{run.id}/recording/window{query}")
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, body, answer.getheader("Content-Type", "")


def sequence(body: bytes) -> list[Any]:
    """The items of a CBOR sequence."""
    stream, items = io.BytesIO(body), []
    while stream.tell() < len(body):
        items.append(cbor2.load(stream))
    return items


def test_window_has_decoded_samples_and_state_before(browser: Browser, run: Run) -> None:
    status, body, kind = ask(browser, run, "?from=4&to=5.5&topics=/map,/e_stop_state,/mirte_base_controller/odom,/none")
    assert (status, kind) == (200, "application/cbor-seq")
    head, *samples = sequence(body)
    assert head == {"start_s": 0.0, "end_s": 9.0, "complete_s": 5.5}
    assert [(topic, at_s) for topic, at_s, _ in samples] == [
        ("/map", 1.0), ("/e_stop_state", 3.0), ("/e_stop_state", 4.0), ("/e_stop_state", 5.0),
    ]  # fmt: skip
    grid, *stops = [message for _, _, message in samples]
    assert bytes(grid["data"].value) == b"\xff\x00\x64" and grid["info"]["width"] == 0
    assert [message["data"] for message in stops] == [False, False, True]


def test_window_without_topics_has_the_recordings_times(browser: Browser, run: Run) -> None:
    status, body, _ = ask(browser, run, "")
    assert (status, sequence(body)) == (200, [{"start_s": 0.0, "end_s": 9.0, "complete_s": 0.0}])


@pytest.mark.parametrize(
    ("query", "reason"),
    [
        ("from=4&to=3", "after from"),
        ("from=-1&to=3", "at least 0"),
        ("from=0&to=30.5", "up to 30 s"),
        ("from=nan&to=3", "after from"),
        ("from=1&to=inf", "after from"),
        ("from=1e300&to=1e300", "after from"),
        ("from=x&to=3", "must be numbers"),
        ("from=3", "must be numbers"),
    ],
)
def test_window_outside_of_its_limits_is_refused(browser: Browser, run: Run, query: str, reason: str) -> None:
    status, body, _ = ask(browser, run, f"?topics=/map&{query}")
    assert status == 400 and reason in body.decode()


def test_too_many_topics_are_refused(browser: Browser, run: Run) -> None:
    status, body, _ = ask(browser, run, f"?from=0&to=1&topics={','.join(f'/t{n}' for n in range(41))}")
    assert status == 400 and "40 topics, not 41" in body.decode()


def test_run_without_a_recording_is_not_found(browser: Browser, run: Run) -> None:
    run.recording.write_bytes(b"no recording")
    status, body, _ = ask(browser, run, "")
    assert status == 404 and "not an MCAP recording" in body.decode()
    run.recording.unlink()
    status, body, _ = ask(browser, run, "")
    assert status == 404 and "this run was not recorded" in body.decode()


def test_stop_does_not_wait_for_windows(
    browser: Browser, run: Run, graph_host: GraphHost, monkeypatch: pytest.MonkeyPatch
) -> None:
    reading, released = threading.Event(), threading.Event()

    def refresh(_: Any) -> None:
        reading.set()
        assert released.wait(60.0)

    monkeypatch.setattr(window.IndexedRecording, "refresh", refresh)
    with ThreadPoolExecutor(12) as pool:
        asked = [pool.submit(ask, browser, run, "") for _ in range(12)]
        graph_host.until(lambda: reading.is_set() and any(one.done() for one in asked))
        assert Browser(browser.port).post("/_api/stop", engaged=True)["stop"]
        released.set()
        statuses = sorted(one.result(20.0)[0] for one in asked)
    assert set(statuses) == {200, 503} and statuses.count(200) >= 8
