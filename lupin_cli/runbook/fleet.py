"""One playbook on several robots side by side, each with a journal of its own; the laptop, of which there is one, by turns."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

from lupin_cli.runbook.journal import JournalError
from lupin_cli.runbook.outcome import Result
from lupin_cli.target.base import Output, Script, Target, TargetError

AT_ONCE = 20
Play = Callable[[Any, threading.Event], Result]
Robot = TypeVar("Robot")


class TakingTurns:
    """The laptop for several runs: one call at a time, and one step at a time, since two that edit a file lose each other's."""

    def __init__(self, target: Target) -> None:
        self._target = target
        self._turn = threading.RLock()
        self.name, self.user = target.name, target.user

    @contextmanager
    def alone(self) -> Iterator[Target]:
        """Nobody else's calls until it ends."""
        with self._turn:
            yield self._target

    def batch(self, scripts: Sequence[Script], bound_s: float = 10.0) -> dict[str, Output]:
        with self.alone() as target:
            return target.batch(scripts, bound_s)

    def run(self, script: str, **options: Any) -> Output:
        with self.alone() as target:
            return target.run(script, **options)

    def put(self, path: str, data: bytes, **options: Any) -> None:
        with self.alone() as target:
            target.put(path, data, **options)

    def get(self, path: str, **options: Any) -> bytes | None:
        with self.alone() as target:
            return target.get(path, **options)

    def close(self) -> None:
        """The laptop is always there."""


def on_all(
    robots: Iterable[Robot],
    name: Callable[[Robot], str],
    playbook: str,
    one: Callable[[Robot, threading.Event], Result],
    on_interrupt: Callable[[], None] = lambda: None,
) -> list[Result]:
    """Play on every robot at once. An interrupt asks all of them to stop, and waits until what is under way has ended; a
    second one is raised.

    `one(robot, stop)` plays on one robot. Where it can't even begin there, that robot's result says so; the others go on.
    """
    stop = threading.Event()
    found = list(robots)
    results = [Result(playbook, name(robot), "interrupted", message="interrupted before it began") for robot in found]

    def guarded(index: int) -> None:
        robot = found[index]
        try:
            results[index] = one(robot, stop)
        except TargetError as error:
            results[index] = Result(playbook, name(robot), "unreachable", message=str(error), next_command=error.next_command)
        except JournalError as error:
            results[index] = Result(playbook, name(robot), "failed", message=str(error), next_command=error.next_command)

    pool = ThreadPoolExecutor(max_workers=min(AT_ONCE, max(1, len(found))), thread_name_prefix="play")
    futures: list[Future[None]] = []
    try:
        for index in range(len(found)):
            futures.append(pool.submit(guarded, index))
        for future in futures:
            future.result()
    except KeyboardInterrupt:
        stop.set()
        on_interrupt()
        pool.shutdown(wait=True, cancel_futures=True)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    return results
