"""The API's window on a run's recording: decoded samples of some seconds, with which a page shows the past."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cbor2
from aiohttp import web

from lupin_runtime import graph
from lupin_runtime.console.api_table import Resource
from lupin_runtime.console.cdr import Format, MalformedMessage, UnsupportedType, decoder
from lupin_runtime.console.run_files import chosen_run
from lupin_runtime.record.reader import NotARecording, RawMessage
from lupin_runtime.record.runs import recorded_run
from lupin_runtime.record.window import IndexedRecording, read_window
from lupin_runtime.ros.type_names import UnknownType, find
from lupin_runtime.stack.runs import Run

MAX_WINDOW_S = 30.0
MAX_TOPICS = 40
_MAX_WAITING = 8  # requests that wait for the one that is answered
_KEPT_RECORDINGS = 8  # whose chunks need not be looked for again
_MEDIA_TYPE = "application/cbor-seq"


class Rewind:
    """Serves windows of recordings, one at a time, and off the event loop."""

    def __init__(self) -> None:
        self._recordings: dict[Path, IndexedRecording] = {}
        self._lock = asyncio.Lock()
        self._waiting = 0

    def resources(self) -> tuple[Resource, ...]:
        """Return the route with a summary of its answer."""
        summary = (
            "Decoded samples of the recording, as a CBOR sequence. `from` and `to` are s of ROS time, up to "
            f"{MAX_WINDOW_S:g} s apart; `topics` are up to {MAX_TOPICS} names with commas between them. The first item has the "
            "recording's `start_s` and `end_s`, and `complete_s`, up to which there are all samples. The others are "
            "[topic, s, message], with the last sample of each topic before `from`. Without `topics`, there are no others."
        )
        return (Resource("/_api/runs/{run}/recording/window", self._window, summary),)

    async def _window(self, request: web.Request) -> web.StreamResponse:
        run = await chosen_run(request)
        from_s, to_s, topics = _asked(request)
        if self._waiting >= _MAX_WAITING:
            raise web.HTTPServiceUnavailable(text="too many windows of recordings are being read; ask again later\n")
        self._waiting += 1
        try:
            async with self._lock:
                body = await asyncio.to_thread(self._read, run, from_s, to_s, topics)
        except NotARecording as error:
            raise web.HTTPNotFound(text=f"this run was not recorded: {error}\n") from error
        finally:
            self._waiting -= 1
        return web.Response(body=body, content_type=_MEDIA_TYPE)

    def _read(self, run: Run, from_s: float, to_s: float, topics: Sequence[str]) -> bytes:
        recordings = self._open(run)
        window = read_window(recordings, topics, int(from_s * 1e9), int(to_s * 1e9), all_before=(graph.TF_STATIC.name,))
        head = {"start_s": window.start_ns / 1e9, "end_s": window.end_ns / 1e9, "complete_s": window.complete_ns / 1e9}
        types = {topic: _type_of(recordings, topic) for topic in topics}
        # Each item is encoded by a call of its own: a long one would keep the threads that stop the robot from running.
        return b"".join([cbor2.dumps(head), *(_item(types[message.topic], message) for message in window.messages)])

    def _open(self, run: Run) -> list[IndexedRecording]:
        """The run's recordings, oldest first. Raises NotARecording if there is none."""
        opened = []
        problem = NotARecording(f"there is no {run.recording.name}")
        for path in recorded_run(run.path).recordings:
            try:
                recording = self._recordings.pop(path, None) or IndexedRecording(path)
            except NotARecording as error:
                problem = error
                continue
            self._recordings[path] = recording
            opened.append(recording)
        for oldest in list(self._recordings)[:-_KEPT_RECORDINGS]:
            del self._recordings[oldest]
        if not opened:
            raise problem
        return opened


def _asked(request: web.Request) -> tuple[float, float, list[str]]:
    """Return the window's limits in s and its topics. Raises HTTPBadRequest."""
    topics = [name for name in request.query.get("topics", "").split(",") if name]
    if not topics:
        return 0.0, 0.0, []
    if len(topics) > MAX_TOPICS:
        raise web.HTTPBadRequest(text=f"a window has up to {MAX_TOPICS} topics, not {len(topics)}\n")
    try:
        from_s, to_s = float(request.query.get("from", "")), float(request.query.get("to", ""))
    except ValueError as error:
        raise web.HTTPBadRequest(text="from and to must be numbers: seconds of ROS time\n") from error
    # False for NaN, too. Seconds of ROS time have 32 bits.
    if not 0.0 <= from_s <= to_s <= min(from_s + MAX_WINDOW_S, 2.0**32):
        raise web.HTTPBadRequest(text=f"to must be up to {MAX_WINDOW_S:g} s after from, and both at least 0\n")
    return from_s, to_s, topics


def _type_of(recordings: Sequence[IndexedRecording], topic: str) -> Any:
    """The message class of a topic; None if its type is not installed here, or the recordings do not have the topic."""
    for recording in recordings:
        name = recording.type_of(topic)
        if name is not None:
            try:
                return find(name, "msg")
            except UnknownType:
                return None
    return None


def _item(message_class: Any, message: RawMessage) -> bytes:
    """A sample of the sequence; empty if it cannot be decoded."""
    if message_class is None:
        return b""
    try:
        values = decoder(message_class, Format.CBOR)(message.data)
    except (UnsupportedType, MalformedMessage):
        return b""
    return cbor2.dumps([message.topic, message.log_ns / 1e9, values])
