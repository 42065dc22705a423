"""Questions asked ahead: what a run's steps will look at first goes out in one batch, since a link costs by the question.

Operations are as they would be without it. One that says `stands` begins its look at a machine that only notes the question;
the noted questions are asked together, and each answer is handed out when its step asks in earnest. An answer is given as often
as it was noted, and to nobody once something may have changed or time has passed: then the machine itself is asked.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NoReturn

from lupin_cli.operations.base import OperationError
from lupin_cli.target.base import Output, Script, Target, TargetError

FRESH_S = 3.0  # an answer that waited longer for its step is not believed
BATCH_SLACK_S = 5.0

Look = Callable[[Target], Any]


class _Noted(BaseException):
    """Ends a look that is only noted. No Exception: no operation may take it for a failure of its own."""


class _Listener:
    """A machine that notes the first question it is asked, and answers none."""

    def __init__(self, target: Target) -> None:
        self.name, self.user = target.name, target.user
        self.address = str(getattr(target, "address", ""))
        self.noted: tuple[Script, ...] = ()

    def batch(self, scripts: Sequence[Script], bound_s: float = 10.0) -> NoReturn:
        self.noted = tuple(scripts)
        raise _Noted

    def run(self, script: str, **options: Any) -> NoReturn:
        raise _Noted

    def put(self, path: str, data: bytes, **options: Any) -> NoReturn:
        raise _Noted

    def get(self, path: str, **options: Any) -> NoReturn:
        raise _Noted

    def close(self) -> None:
        """There is nothing to close."""


def _all_of(work: Iterable[Callable[[], None]]) -> None:
    """What fails here is told by the step that needs it."""
    for each in work:
        with contextlib.suppress(OperationError):
            each()


class AskedAhead:
    """Passes everything on to a target, but for questions whose answer is there already."""

    def __init__(self, target: Target) -> None:
        self._target = target
        self.name, self.user = target.name, target.user
        self._answers: dict[tuple[str, bool], list[Output]] = {}
        self._asked_s = 0.0
        self._error: TargetError | None = None

    @property
    def address(self) -> str:
        return str(getattr(self._target, "address", ""))

    def ask(self, looks: Iterable[Look], meanwhile: Iterable[Callable[[], None]] = ()) -> None:
        """Note the first question of each look, and ask all of them at once where there are several; do `meanwhile` while the
        robot answers."""
        noted = [script for look in looks for script in self._question(look)]
        if len(noted) < 2:
            return
        # Two steps that look at the same thing are told the same.
        unlike = {(script.text, script.root): script for script in noted}
        scripts = [Script(str(n), s.text, s.timeout_s, s.root) for n, s in enumerate(unlike.values())]
        bound_s = max(script.timeout_s for script in scripts) + BATCH_SLACK_S
        with ThreadPoolExecutor(max_workers=1, thread_name_prefix="meanwhile") as pool:
            pool.submit(_all_of, meanwhile)
            try:
                outputs = self._target.batch(scripts, bound_s)
            except TargetError as error:
                self._error = error  # the next step's, as it would have been: nobody is asked for a key or a password twice
                return
        self._asked_s = time.monotonic()
        answered = {(s.text, s.root): outputs[s.name] for s in scripts if outputs[s.name].status is not None}
        for script in noted:
            key = script.text, script.root
            if key in answered:
                self._answers.setdefault(key, []).append(answered[key])

    def _question(self, look: Look) -> tuple[Script, ...]:
        listener = _Listener(self._target)
        try:
            look(listener)
        except _Noted:
            return listener.noted
        except Exception:  # whatever is wrong with the look is told when it is its step's turn
            return ()
        return ()

    def forget(self) -> None:
        """What was answered counts no more: somebody may have been at work there since."""
        self._answers.clear()

    def batch(self, scripts: Sequence[Script], bound_s: float = 10.0) -> dict[str, Output]:
        if self._error is not None:
            error, self._error = self._error, None
            raise error
        if self._answers and time.monotonic() - self._asked_s > FRESH_S:
            self.forget()
        known = {script.name: self._answers.get((script.text, script.root), []) for script in scripts}
        if not all(known.values()):
            return self._target.batch(scripts, bound_s)
        return {name: answers.pop() for name, answers in known.items()}

    def run(self, script: str, **options: Any) -> Output:
        self.forget()
        return self._target.run(script, **options)

    def put(self, path: str, data: bytes, **options: Any) -> None:
        self.forget()
        self._target.put(path, data, **options)

    def get(self, path: str, **options: Any) -> bytes | None:
        return self._target.get(path, **options)

    def close(self) -> None:
        self._target.close()
