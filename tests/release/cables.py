"""A cable that is pulled at every point of a playbook, one after another, and plugged in again."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from lupin_cli.runbook import Event, Result, load, play
from lupin_cli.target.base import Target
from lupin_sim.host import Host

INTO_S = 0.03  # a step's look or its change, when the cable goes
MOST_CUTS = 60


class Pulled:
    """Plays a playbook with a cut in the middle of each of its steps; every run but the last one ends without its robot."""

    def __init__(self, host: Host, target: Target) -> None:
        self._host, self._target = host, target
        self._points: set[tuple[int, str]] = set()  # still to come: a step's number, and the event behind which to cut
        self._cut: threading.Timer | None = None

    def _on_event(self, event: Event) -> None:
        point = event.index, event.kind
        if self._cut is None and point in self._points:
            self._points.remove(point)
            self._cut = threading.Timer(INTO_S, self._host.robot.fault, ("cable-cut",), {"link": "eth0"})
            self._cut.start()

    def plays(
        self, name: str, given: dict[str, Any], after_each: Callable[[Result], None], *, changes_only: bool = False
    ) -> tuple[Result, int]:
        """The run's end, and how often it was cut: in what a step changes, in what it looks at where it changes nothing."""
        targets, cuts = {"robot": self._target}, 0
        for step in play(name, targets, given, dry_run=True).steps:
            looks = not changes_only and step.state != "would-change"
            self._points.add((step.index, "step" if looks else "change"))
        while True:
            self._cut = None
            result = play(name, targets, {} if cuts else given, resume=cuts > 0, on_event=self._on_event)
            if self._cut is None:
                return result, cuts
            self._cut.join()
            self._host.robot.mend("cable-cut", link="eth0")
            self._target.close()
            self._host.robot.wait_ready()
            if result.state == "done":
                return result, cuts  # nothing was left to ask for when it went
            cuts += 1
            assert cuts < MOST_CUTS
            assert (result.state, result.exit_code) == ("unreachable", 3), result.message
            step = load(name).steps[result.steps[-1].index]
            assert result.message.startswith(step.name) and result.next_command, result
            assert result.resume == f"lupin play {name} --robot mirte --resume"
            after_each(result)
