"""Plays a playbook again and again, and cuts the cable to the robot in another step each time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from lupin_cli.connection.base import Target
from lupin_cli.connection.local import LocalTarget
from lupin_cli.playbook import Event, Result, load, play
from lupin_sim.host import Host

CUT_DELAY_S = 0.03  # after an event, when the step's probe or change is running
MAX_CUTS = 60


class CableCutter:
    """Plays a playbook, with a cut of the cable in each of its steps: every run but the last one loses its robot."""

    def __init__(self, host: Host, target: Target) -> None:
        self._host, self._target = host, target
        # Cuts to make: a step's index, and the kind of event that triggers the cut.
        self._remaining: set[tuple[int, str]] = set()
        self._cut: threading.Timer | None = None

    @property
    def uncut_changes(self) -> set[int]:
        """The indices of steps that were to change something, and whose change was not interrupted."""
        return {index for index, kind in self._remaining if kind == "change"}

    def _on_event(self, event: Event) -> None:
        point = event.index, event.kind
        if self._cut is not None:
            # On a busy machine the cut takes a while; until it is made, no further step may begin and end.
            self._cut.join()
        elif point in self._remaining:
            self._remaining.remove(point)
            self._cut = threading.Timer(CUT_DELAY_S, self._host.robot.inject_fault, ("cable-cut",), {"link": "eth0"})
            self._cut.start()

    def play(
        self, name: str, variables: dict[str, Any], after_each: Callable[[Result], None], *, changes_only: bool = False
    ) -> tuple[Result, int]:
        """Play the playbook until it is done; return the last result and the number of cuts.

        The cut comes during the change of a step that changes something, and during the probe of any other step; with
        `changes_only`, probes are not interrupted. `after_each` is called with the result of each interrupted run.
        """
        targets, cuts = {"robot": self._target, "laptop": LocalTarget()}, 0
        for step in play(name, targets, variables, dry_run=True).steps:
            cut_in_probe = not changes_only and step.state != "would-change"
            self._remaining.add((step.index, "step" if cut_in_probe else "change"))
        while True:
            self._cut = None
            result = play(name, targets, {} if cuts else variables, resume=cuts > 0, on_event=self._on_event)
            if self._cut is None:
                return result, cuts
            self._cut.join()
            self._host.robot.undo_fault("cable-cut", link="eth0")
            self._target.close()
            self._host.robot.wait_ready()
            if result.state == "done":
                return result, cuts + 1  # this cut came after the last request, and interrupted nothing
            cuts += 1
            assert cuts < MAX_CUTS
            assert (result.state, result.exit_code) == ("unreachable", 3), result.message
            step = load(name).steps[result.steps[-1].index]
            assert result.message.startswith(step.name) and result.next_command, result
            assert result.resume == f"lupin play {name} --robot mirte --resume"
            after_each(result)
