"""Lets several playbook runs share the laptop: one call at a time, and one step at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from lupin_cli.connection.base import Output, Script, Target


class SerializedTarget:
    """Serializes the calls of several runs. Two steps that edit the same file at once would lose each other's changes."""

    def __init__(self, target: Target) -> None:
        self._target = target
        self._lock = threading.RLock()
        self.name, self.user, self.address = target.name, target.user, target.address
        self.login_command = target.login_command

    @contextmanager
    def reserved(self) -> Iterator[Target]:
        """Keep the target for the calling thread until the context ends."""
        with self._lock:
            yield self._target

    def batch(self, scripts: Sequence[Script], timeout_s: float = 10.0) -> dict[str, Output]:
        with self.reserved() as target:
            return target.batch(scripts, timeout_s)

    def run(
        self,
        script: str,
        *,
        root: bool = False,
        stdin: bytes = b"",
        timeout_s: float = 60.0,
        on_line: Callable[[str], None] | None = None,
    ) -> Output:
        with self.reserved() as target:
            return target.run(script, root=root, stdin=stdin, timeout_s=timeout_s, on_line=on_line)

    def put(
        self, path: str, data: bytes, *, mode: int = 0o644, owner: str = "", root: bool = False, timeout_s: float = 60.0
    ) -> None:
        with self.reserved() as target:
            target.put(path, data, mode=mode, owner=owner, root=root, timeout_s=timeout_s)

    def get(self, path: str, *, root: bool = False, timeout_s: float = 60.0) -> bytes | None:
        with self.reserved() as target:
            return target.get(path, root=root, timeout_s=timeout_s)

    def close(self) -> None:
        """Do nothing: the laptop needs no connection."""
