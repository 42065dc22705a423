"""Plays on several robots at the same time. Each run has its own journal; they share the laptop (`SerializedTarget`)."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from lupin_cli.connection.base import TargetError
from lupin_cli.playbook.journal import JournalError
from lupin_cli.playbook.results import Result

_MAX_THREADS = 20
Robot = TypeVar("Robot")


def play_on_all(
    robots: Sequence[Robot],
    name: Callable[[Robot], str],
    playbook: str,
    play_one: Callable[[Robot, threading.Event], Result],
    on_interrupt: Callable[[], None] = lambda: None,
) -> list[Result]:
    """Play on all robots at the same time and return the results in their order.

    `play_one(robot, stop)` plays on one robot; if it cannot start there, that robot's result says why and the others go on. An
    interrupt calls `on_interrupt`, asks all runs to stop, and waits for their current steps; a second interrupt is raised.
    """
    stop = threading.Event()
    results = [Result(playbook, name(robot), "interrupted", message="interrupted before it started") for robot in robots]

    def play_index(index: int) -> None:
        robot = robots[index]
        try:
            results[index] = play_one(robot, stop)
        except TargetError as error:
            results[index] = Result(playbook, name(robot), "unreachable", message=str(error), next_command=error.next_command)
        except JournalError as error:
            results[index] = Result(playbook, name(robot), "failed", message=str(error), next_command=error.next_command)

    pool = ThreadPoolExecutor(max_workers=min(_MAX_THREADS, max(1, len(robots))), thread_name_prefix="play")
    futures: list[Future[None]] = []
    try:
        for index in range(len(robots)):
            futures.append(pool.submit(play_index, index))
        for future in futures:
            future.result()
    except KeyboardInterrupt:
        stop.set()
        on_interrupt()
        pool.shutdown(wait=True, cancel_futures=True)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    return results
