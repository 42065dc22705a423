"""A target whose calls stay within the step's time, and whose output goes into the journal."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext

from lupin_cli.operations.base import OperationError
from lupin_cli.target.base import Output, Script, Target

KEPT_CHARACTERS = 64 * 1024  # of one script's output in the journal: its beginning and its end


class WatchedTarget:
    """Passes everything on to a target."""

    def __init__(self, target: Target) -> None:
        self._target = target
        self.name = target.name
        self.user = target.user
        self.deadline = float("inf")  # of time.monotonic()
        self.record: Callable[[str], None] | None = None  # gets the output of scripts that change something
        self.on_line: Callable[[str], None] | None = None

    @property
    def address(self) -> str:
        return str(getattr(self._target, "address", ""))

    @property
    def beyond_the_step(self) -> Target:
        """The target without this step's bound, for one short question."""
        return self._target

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Where several runs share the target, none of the others' steps until it ends; the step's time stands still before."""
        asked = time.monotonic()
        with getattr(self._target, "alone", nullcontext)():
            self.deadline += time.monotonic() - asked
            yield

    def remaining(self, bound_s: float) -> float:
        """What is left of the step's time, at most `bound_s`; raises OperationError where nothing is."""
        left = self.deadline - time.monotonic()
        if left <= 0:
            raise OperationError("the step's time is up; 'timeout' in the playbook gives it more")
        return min(bound_s, left)

    def batch(self, scripts: Sequence[Script], bound_s: float = 10.0) -> dict[str, Output]:
        return self._target.batch(scripts, self.remaining(bound_s))

    def run(
        self,
        script: str,
        *,
        root: bool = False,
        stdin: bytes = b"",
        bound_s: float = 60.0,
        on_line: Callable[[str], None] | None = None,
    ) -> Output:
        def tell(line: str) -> None:
            if on_line is not None:
                on_line(line)
            if self.on_line is not None:
                self.on_line(line)

        bound_s = self.remaining(bound_s)
        if self.record is None:
            return self._target.run(script, root=root, stdin=stdin, bound_s=bound_s, on_line=on_line)
        output = self._target.run(script, root=root, stdin=stdin, bound_s=bound_s, on_line=tell)
        text = output.stdout + (f"\n[errors]\n{output.stderr}" if output.stderr else "")
        if text.strip():
            self.record(_kept(text))
        return output

    def put(self, path: str, data: bytes, *, mode: int = 0o644, root: bool = False, bound_s: float = 60.0) -> None:
        self._target.put(path, data, mode=mode, root=root, bound_s=self.remaining(bound_s))

    def get(self, path: str, *, root: bool = False, bound_s: float = 60.0) -> bytes | None:
        return self._target.get(path, root=root, bound_s=self.remaining(bound_s))

    def close(self) -> None:
        self._target.close()


def _kept(text: str) -> str:
    if len(text) <= KEPT_CHARACTERS:
        return text
    half = KEPT_CHARACTERS // 2
    return f"{text[:half]}\n[{len(text) - 2 * half} characters left out]\n{text[-half:]}"
