"""The target of one step of a playbook: it enforces the step's timeout, and records the output of scripts."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext

from lupin_cli.connection.base import Output, Script, Target
from lupin_cli.operations.base import OperationError

RECORDED_CHARACTERS = 64 * 1024  # of one script's output in the journal: its beginning and its end


class StepTarget:
    """Forwards every call to a target, bounded by `deadline`.

    `reserve` reserves a target that several playbook runs share for this one.
    """

    def __init__(self, target: Target, reserve: Callable[[], AbstractContextManager[object]] = nullcontext) -> None:
        self._target = target
        self._reserve = reserve
        self.name = target.name
        self.user = target.user
        self.address = target.address
        self.login_command = target.login_command
        self.deadline = float("inf")  # of time.monotonic()
        self.record: Callable[[str], None] | None = None  # receives the output of scripts that change something
        self.on_line: Callable[[str], None] | None = None

    @property
    def unlimited(self) -> Target:
        """The target without the step's timeout, for one short probe."""
        return self._target

    @contextmanager
    def reserved(self) -> Iterator[None]:
        """Keep other runs that share the target from using it. The wait for them does not count against the timeout."""
        start = time.monotonic()
        with self._reserve():
            self.deadline += time.monotonic() - start
            yield

    def remaining(self, timeout_s: float) -> float:
        """Return the remaining time of the step, at most `timeout_s`; raises OperationError if none is left."""
        remaining_s = self.deadline - time.monotonic()
        if remaining_s <= 0:
            raise OperationError("the step's time is up; give it more with 'timeout' in the playbook")
        return min(timeout_s, remaining_s)

    def batch(self, scripts: Sequence[Script], timeout_s: float = 10.0) -> dict[str, Output]:
        return self._target.batch(scripts, self.remaining(timeout_s))

    def run(
        self,
        script: str,
        *,
        root: bool = False,
        stdin: bytes = b"",
        timeout_s: float = 60.0,
        on_line: Callable[[str], None] | None = None,
    ) -> Output:
        def forward_line(line: str) -> None:
            if on_line is not None:
                on_line(line)
            if self.on_line is not None:
                self.on_line(line)

        timeout_s = self.remaining(timeout_s)
        if self.record is None:
            return self._target.run(script, root=root, stdin=stdin, timeout_s=timeout_s, on_line=on_line)
        output = self._target.run(script, root=root, stdin=stdin, timeout_s=timeout_s, on_line=forward_line)
        text = output.stdout + (f"\n[errors]\n{output.stderr}" if output.stderr else "")
        if text.strip():
            self.record(_both_ends(text))
        return output

    def put(
        self, path: str, data: bytes, *, mode: int = 0o644, owner: str = "", root: bool = False, timeout_s: float = 60.0
    ) -> None:
        self._target.put(path, data, mode=mode, owner=owner, root=root, timeout_s=self.remaining(timeout_s))

    def get(self, path: str, *, root: bool = False, timeout_s: float = 60.0) -> bytes | None:
        return self._target.get(path, root=root, timeout_s=self.remaining(timeout_s))

    def close(self) -> None:
        self._target.close()


def _both_ends(text: str) -> str:
    if len(text) <= RECORDED_CHARACTERS:
        return text
    half = RECORDED_CHARACTERS // 2
    return f"{text[:half]}\n[{len(text) - 2 * half} characters left out]\n{text[-half:]}"
