"""A target that forwards every call to another one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from lupin_cli.connection.base import Output, Script, Target


class ForwardingTarget:
    """Forwards every call to a target. A subclass overrides `forwarded` with what all calls have in common."""

    def __init__(self, target: Target) -> None:
        self._target = target
        self.name, self.user, self.address = target.name, target.user, target.address
        self.login_command = target.login_command

    @contextmanager
    def forwarded(self, timeout_s: float) -> Iterator[tuple[Target, float]]:
        """Give the target and the time limit of one call."""
        yield self._target, timeout_s

    def batch(self, scripts: Sequence[Script], timeout_s: float = 10.0) -> dict[str, Output]:
        with self.forwarded(timeout_s) as (target, limit_s):
            return target.batch(scripts, limit_s)

    def run(
        self,
        script: str,
        *,
        root: bool = False,
        stdin: bytes = b"",
        timeout_s: float = 60.0,
        on_line: Callable[[str], None] | None = None,
    ) -> Output:
        with self.forwarded(timeout_s) as (target, limit_s):
            return target.run(script, root=root, stdin=stdin, timeout_s=limit_s, on_line=on_line)

    def put(
        self, path: str, data: bytes, *, mode: int = 0o644, owner: str = "", root: bool = False, timeout_s: float = 60.0
    ) -> None:
        with self.forwarded(timeout_s) as (target, limit_s):
            target.put(path, data, mode=mode, owner=owner, root=root, timeout_s=limit_s)

    def get(self, path: str, *, root: bool = False, timeout_s: float = 60.0) -> bytes | None:
        with self.forwarded(timeout_s) as (target, limit_s):
            return target.get(path, root=root, timeout_s=limit_s)

    def close(self) -> None:
        self._target.close()
