"""`/_video` on port 8090: the video server's images, fetched once for all browsers.

A robot's video server is at the other end of the wireless link, which therefore carries each image only once. A slow browser
gets the newest image and skips those in between.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

import aiohttp
from aiohttp import web

from lupin_runtime.cameras import mjpeg
from lupin_runtime.cameras.frames import Frame
from lupin_runtime.cameras.stream_request import BadRequest, StreamRequest, read_request
from lupin_runtime.console.api_table import Resource
from lupin_runtime.json_text import parse_json

MAX_CLIENTS = 64
# The video server accepts 16 connections of one address: streams and the other requests together need fewer.
MAX_UPSTREAMS = 8
_MAX_FETCHES = 4
_CONNECT_TIMEOUT_S = 5.0
_SILENCE_TIMEOUT_S = 15.0  # an upstream connection on which nothing arrives for this long is closed; browsers ask again
_ANSWER_TIMEOUT_S = 8.0
_CHECK_PERIOD_S = 0.5  # how often a stream without images checks that its browser is connected and still paired
_WRITE_TIMEOUT_S = 10.0  # a browser that takes longer for an image is disconnected
_MAX_LIST_BYTES = 1_000_000
_MAX_REASON_BYTES = 500
_FORWARDED_STATUSES = (400, 404, 504)  # of the video server, whose reason is forwarded too
_CHUNK_BYTES = 1 << 18
# How much unsent data the kernel may hold for a slow browser: images that wait there are outdated when they arrive.
_UNSENT_BYTES = 32_768
_HEADERS = {"Cache-Control": "no-store", "X-Content-Type-Options": "nosniff", "Cross-Origin-Resource-Policy": "same-origin"}
_QUERY = "?topic=NAME&quality=1…100&width=PIXELS&invert"


class VideoUnavailable(Exception):
    """The video server delivers no images; the text says why, and `status` is the HTTP status to answer with."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status = status


class VideoRelay:
    """Forwards the images of the video server at `own_target`, or at the one that `point_at` names. For the event loop only.

    `may_see` returns whether the sender of a request may still see images.
    """

    def __init__(self, own_target: str, may_see: Callable[[web.Request], bool]) -> None:
        self._own_target = self._target = own_target
        self._may_see = may_see
        self._http: aiohttp.ClientSession | None = None
        self._upstreams: dict[StreamRequest, _Upstream] = {}
        self._clients = 0
        self._fetching = asyncio.Semaphore(_MAX_FETCHES)

    def resources(self) -> tuple[Resource, ...]:
        """Return the routes, each with a summary of its answer."""
        return (
            Resource("/_video/streams", self._guarded(self._list), "The cameras: topic, clients, frames a second, age."),
            Resource("/_video/snapshot", self._guarded(self._snapshot), f"The next image as JPEG: {_QUERY}."),
            Resource("/_video/stream", self._guarded(self._stream), f"Images without end, for an <img>: {_QUERY}."),
        )

    def point_at(self, target: str) -> None:
        """Fetch images from another URL; from the own one again if it is empty. Streams that end are asked for again."""
        target = target.rstrip("/") or self._own_target
        if target != self._target:
            self._target = target
            self._end_streams()

    def _end_streams(self) -> None:
        for upstream in list(self._upstreams.values()):
            upstream.cancel()
        self._upstreams.clear()

    async def close(self) -> None:
        """End all streams."""
        self._end_streams()
        if self._http is not None:
            await self._http.close()

    # -- requests -----------------------------------------------------------------------------------------------------
    def _guarded(
        self, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> Callable[[web.Request], Awaitable[web.StreamResponse]]:
        async def guarded(request: web.Request) -> web.StreamResponse:
            if request.headers.get("Sec-Fetch-Site", "same-origin") not in ("same-origin", "none"):
                # Pages of other sites may not show the cameras either.
                raise web.HTTPForbidden(text="pages of other sites may not use this server\n")
            try:
                return await handler(request)
            except BadRequest as error:
                raise web.HTTPBadRequest(text=f"{error}\n") from error
            except VideoUnavailable as error:
                return web.Response(status=error.status, text=f"{error}\n", headers=_HEADERS)

        return guarded

    async def _list(self, _: web.Request) -> web.StreamResponse:
        content, _headers = await self._fetch("streams", {}, _MAX_LIST_BYTES)
        try:
            rows = parse_json(content)
        except ValueError as error:
            raise self._malformed() from error
        return web.json_response(rows, headers=_HEADERS)

    async def _snapshot(self, request: web.Request) -> web.StreamResponse:
        stream_request = read_request(request.query)
        content, headers = await self._fetch("snapshot", stream_request.query(), mjpeg.MAX_IMAGE_BYTES)
        try:
            stamp = mjpeg.stamp_text(mjpeg.stamp_ns_of(headers.get("X-Timestamp", "")))
        except mjpeg.MalformedStream as error:
            raise self._malformed() from error
        return web.Response(body=content, content_type="image/jpeg", headers={**_HEADERS, "X-Timestamp": stamp})

    async def _stream(self, request: web.Request) -> web.StreamResponse:
        stream_request = read_request(request.query)
        if self._clients >= MAX_CLIENTS:
            raise VideoUnavailable(503, f"{MAX_CLIENTS} browsers are already watching")
        upstream = self._upstreams.get(stream_request)
        if upstream is None and len(self._upstreams) >= MAX_UPSTREAMS:
            raise VideoUnavailable(503, f"{MAX_UPSTREAMS} other streams are being watched; watch one of them, or wait")
        if upstream is None:
            upstream = self._upstreams[stream_request] = _Upstream()
            upstream.task = asyncio.create_task(self._follow(upstream, stream_request))
        self._clients += 1
        upstream.clients += 1
        try:
            await asyncio.shield(upstream.opened)
            return await self._show(request, upstream)
        finally:
            self._clients -= 1
            upstream.clients -= 1
            if not upstream.clients:
                self._forget(stream_request, upstream)
                upstream.cancel()

    async def _show(self, request: web.Request, upstream: _Upstream) -> web.StreamResponse:
        """Send a browser the images until it disconnects or the video server ends the stream."""
        response = web.StreamResponse(headers={**_HEADERS, "Content-Type": mjpeg.CONTENT_TYPE, "Connection": "close"})
        transport = request.transport
        connection = transport.get_extra_info("socket") if transport is not None else None
        if connection is not None:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, _UNSENT_BYTES)
        await response.prepare(request)
        if request.method == "HEAD":
            return response
        number = 0
        with contextlib.suppress(ConnectionError, asyncio.TimeoutError):
            await response.write(mjpeg.OPENING)
            while self._may_see(request) and transport is not None and not transport.is_closing():
                frame = await upstream.after(number)
                if frame is not None:
                    number = frame.number
                    await asyncio.wait_for(response.write(mjpeg.part(frame.data, frame.stamp_ns)), _WRITE_TIMEOUT_S)
                elif upstream.ended:
                    break
        if transport is not None and not transport.is_closing():
            transport.abort()  # a browser must not mistake the stream's end for an image's; nor must a slow one delay it
        return response

    # -- the video server ---------------------------------------------------------------------------------------------
    def _session(self) -> aiohttp.ClientSession:
        if self._http is None:
            self._http = aiohttp.ClientSession(auto_decompress=False, cookie_jar=aiohttp.DummyCookieJar())
        return self._http

    async def _fetch(self, path: str, query: Mapping[str, str], limit_bytes: int) -> tuple[bytes, Mapping[str, str]]:
        timeout = aiohttp.ClientTimeout(total=_ANSWER_TIMEOUT_S, sock_connect=_CONNECT_TIMEOUT_S)
        async with self._fetching, self._get(path, query, timeout) as answer:
            content = await answer.content.read(limit_bytes + 1)
            while len(content) <= limit_bytes and (more := await answer.content.read(_CHUNK_BYTES)):
                content += more
            if len(content) > limit_bytes:
                raise self._malformed()
            return content, answer.headers

    async def _follow(self, upstream: _Upstream, stream_request: StreamRequest) -> None:
        """Fetch images until nobody watches them or the video server ends the stream."""
        timeout = aiohttp.ClientTimeout(total=None, sock_connect=_CONNECT_TIMEOUT_S, sock_read=_SILENCE_TIMEOUT_S)
        try:
            async with self._get("stream", stream_request.query(), timeout) as answer:
                if answer.content_type != "multipart/x-mixed-replace":
                    raise self._malformed()
                upstream.opened.set_result(None)
                reader = mjpeg.PartReader()
                async for data in answer.content.iter_any():
                    for image, stamp_ns in reader.feed(data):
                        upstream.put(image, stamp_ns)
        except mjpeg.MalformedStream:
            pass  # the stream ends; a browser that asks again gets another one
        except VideoUnavailable as error:
            if not upstream.opened.done():
                upstream.opened.set_exception(error)
        finally:
            self._forget(stream_request, upstream)
            upstream.finish()

    def _forget(self, stream_request: StreamRequest, upstream: _Upstream) -> None:
        """Open another stream for later requests."""
        if self._upstreams.get(stream_request) is upstream:
            del self._upstreams[stream_request]

    @contextlib.asynccontextmanager
    async def _get(self, path: str, query: Mapping[str, str], timeout: aiohttp.ClientTimeout) -> Any:
        """Send a request to the video server and yield its answer, if its status is 200. Raises VideoUnavailable."""
        request = self._session().get(f"{self._target}/{path}", params=query, timeout=timeout, allow_redirects=False)
        try:
            async with request as answer:
                if answer.status != 200:
                    reason = (await answer.content.read(_MAX_REASON_BYTES)).decode(errors="replace").strip()
                    if answer.status not in _FORWARDED_STATUSES or not reason:
                        raise VideoUnavailable(502, f"the video server at {self._target} answered with status {answer.status}")
                    raise VideoUnavailable(answer.status, reason)
                yield answer
        except asyncio.TimeoutError as error:
            raise VideoUnavailable(504, f"the video server at {self._target} does not respond; see: lupin doctor") from error
        except aiohttp.ClientError as error:
            raise VideoUnavailable(502, f"no video from {self._target}: {_reason(error)}; see: lupin doctor") from error

    def _malformed(self) -> VideoUnavailable:
        return VideoUnavailable(502, f"the server at {self._target} is not the video server; see: lupin doctor")


def _reason(error: aiohttp.ClientError) -> str:
    """Return what a person can use of an error: asyncio words a refused connection as "Connect call failed"."""
    if isinstance(error, aiohttp.ClientConnectorError) and error.errno is not None and error.errno > 0:
        return os.strerror(error.errno)
    return str(error)


class _Upstream:
    """One stream of the video server, and the browsers that watch it."""

    def __init__(self) -> None:
        self.task: asyncio.Task[None] | None = None
        self.clients = 0
        self.ended = False
        self.opened: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._frame: Frame | None = None
        self._number = 0
        self._next = asyncio.Event()  # set by the next image

    def put(self, image: bytes, stamp_ns: int) -> None:
        self._number += 1
        self._frame = Frame(image, stamp_ns, self._number)
        self._wake()

    async def after(self, number: int) -> Frame | None:
        """Wait briefly for an image after `number`, and return the newest one; None if there is none."""
        if self._number <= number and not self.ended:
            with contextlib.suppress(asyncio.TimeoutError):
                await asyncio.wait_for(self._next.wait(), _CHECK_PERIOD_S)
        return self._frame if self._number > number else None

    def cancel(self) -> None:
        if self.task is not None:
            self.task.cancel()

    def finish(self) -> None:
        self.ended = True
        if not self.opened.done():
            self.opened.set_exception(VideoUnavailable(503, "the stream has ended"))
        self.opened.exception()  # mark it as retrieved, because nobody may be waiting for it
        self._wake()

    def _wake(self) -> None:
        self._next.set()
        self._next = asyncio.Event()
