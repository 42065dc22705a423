"""Prefetches the probes of a run's steps in one batch, since over SSH every round trip counts.

An output is used once, by its own step, and only while it is fresh and nothing has changed since; otherwise the step runs its
probe.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor

from lupin_cli.connection.base import Output, Script, Target, TargetError
from lupin_cli.operations.base import OperationError

MAX_AGE_S = 3.0
_BATCH_SLACK_S = 5.0


class ProbeBatch:
    """The prefetched outputs of one target's probes, by the step's index."""

    def __init__(self, target: Target) -> None:
        self._target = target
        self._outputs: dict[int, tuple[Script, Output]] = {}
        self._fetched_s = 0.0
        self._error: TargetError | None = None

    def fetch(self, probes: Mapping[int, Script], meanwhile: Iterable[Callable[[], None]] = ()) -> None:
        """Run the probes in one batch if there are several, equal ones once; run `meanwhile` while it waits for the target."""
        if len(probes) < 2:
            return
        names = {script: str(number) for number, script in enumerate(dict.fromkeys(probes.values()))}
        scripts = [Script(name, script.text, script.timeout_s, script.root) for script, name in names.items()]
        with ThreadPoolExecutor(max_workers=1, thread_name_prefix="prepare") as pool:
            pool.submit(_run_all, meanwhile)
            try:
                outputs = self._target.batch(scripts, max(script.timeout_s for script in scripts) + _BATCH_SLACK_S)
            except TargetError as error:
                self._error = error  # the next step raises it, so that the operator is asked only once for a key or a password
                return
        self._fetched_s = time.monotonic()
        answered = {index: (script, outputs[names[script]]) for index, script in probes.items()}
        self._outputs = {index: pair for index, pair in answered.items() if pair[1].status is not None}

    def take(self, index: int, script: Script) -> Output | None:
        """Return the output of a step's probe, or None if the step must run it. Raises the batch's TargetError, once."""
        if self._error is not None:
            error, self._error = self._error, None
            raise error
        if time.monotonic() - self._fetched_s > MAX_AGE_S:
            self.clear()
        fetched_script, output = self._outputs.pop(index, (None, None))
        return output if fetched_script == script else None

    def clear(self) -> None:
        """Discard all outputs, since the target may have changed."""
        self._outputs.clear()


def _run_all(work: Iterable[Callable[[], None]]) -> None:
    for each in work:
        with contextlib.suppress(OperationError):  # the step that needs the result raises it again
            each()
