"""A thread that waits until one of several files can be read, and then calls a function once."""

from __future__ import annotations

import os
import select
import threading
from collections.abc import Callable
from contextlib import suppress

_ONCE = select.EPOLLIN | select.EPOLLONESHOT


class ReadableWatch:
    """Calls `on_readable` on its own thread when a file can be read; then that file is not watched until the next `watch`."""

    def __init__(self, on_readable: Callable[[], object]) -> None:
        self._on_readable = on_readable
        self._epoll = select.epoll()
        self._end_reader, self._end_writer = os.pipe2(os.O_CLOEXEC | os.O_NONBLOCK)
        self._epoll.register(self._end_reader, select.EPOLLIN)
        self._thread = threading.Thread(target=self._run, name="pads", daemon=True)
        self._thread.start()

    def watch(self, file: int) -> None:
        """Watch a file until it can be read next. A file that is closed is no longer watched."""
        try:
            self._epoll.modify(file, _ONCE)
        except FileNotFoundError:
            self._epoll.register(file, _ONCE)

    def close(self) -> None:
        """End the thread."""
        if self._thread.is_alive():
            os.close(self._end_writer)
            self._thread.join()
            os.close(self._end_reader)
            self._epoll.close()

    def _run(self) -> None:
        while True:
            with suppress(InterruptedError):
                if any(file == self._end_reader for file, _ in self._epoll.poll()):
                    return
                self._on_readable()
