"""Runs on several robots at the same time: each has its own journal, and they share the laptop."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lupin_cli.connection.base import Unreachable
from lupin_cli.connection.local import LocalTarget
from lupin_cli.playbook import Event, JournalError, Playbook, Result, list_runs, play
from lupin_cli.playbook.fleet import play_on_all
from lupin_cli.playbook.serialized_target import SerializedTarget

BOOK = """
vars: {root: {type: text}}
steps:
- name: write on the robot
  file: {path: "{{ root }}/{{ robot.name }}", content: x}
- name: add a line on the laptop
  on: laptop
  line-in-file: {path: "{{ root }}/all", line: "{{ robot.name }}"}
"""


def test_each_robot_has_its_own_journal_and_result(load_playbook: Callable[..., Playbook], tmp_path: Path) -> None:
    playbook, laptop = load_playbook(BOOK), SerializedTarget(LocalTarget())

    def one(name: str, stop: threading.Event) -> Result:
        if name == "gone":
            raise Unreachable("gone: no route to host", "no-route", "lupin transport")
        if name == "busy":
            raise JournalError("the run is still going on")
        targets: dict[str, Any] = {"robot": LocalTarget(name), "laptop": laptop}
        return play(playbook, targets, {"root": str(tmp_path)}, journal=tmp_path / "journal", stop=stop)

    results = play_on_all(["r1", "gone", "r2", "busy", "r3"], str, "book", one)
    assert [(result.robot, result.exit_code) for result in results] == [
        ("r1", 0),
        ("gone", 3),
        ("r2", 0),
        ("busy", 1),
        ("r3", 0),
    ]
    assert sorted(run.robot for run in list_runs(tmp_path / "journal")) == ["r1", "r2", "r3"]
    # All runs edit the same file on the laptop, and no line is lost.
    assert sorted((tmp_path / "all").read_text().split()) == ["r1", "r2", "r3"]
    assert all((tmp_path / name).exists() for name in ("r1", "r2", "r3"))


def test_serialized_target_runs_one_call_at_a_time() -> None:
    class Counting(LocalTarget):
        calls = max_calls = 0

        def run(self, *_arguments: Any, **_options: Any) -> Any:
            self.calls += 1
            self.max_calls = max(self.max_calls, self.calls)
            time.sleep(0.01)
            self.calls -= 1

    laptop = Counting()
    shared = SerializedTarget(laptop)
    threads = [threading.Thread(target=shared.run, args=("true",)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert laptop.max_calls == 1


def test_stop_reaches_robots_after_one_ran_its_always_steps(load_playbook: Callable[..., Playbook], tmp_path: Path) -> None:
    playbook = load_playbook(
        f"steps:\n- name: first\n  file: {{path: '{tmp_path}/{{{{ robot.name }}}}-1', content: x}}\n"
        f"- name: second\n  file: {{path: '{tmp_path}/{{{{ robot.name }}}}-2', content: x}}\n"
        f"- name: up\n  always: true\n  file: {{path: '{tmp_path}/{{{{ robot.name }}}}-up', content: x}}"
    )
    a_has_ended = threading.Event()

    def one(name: str, stop: threading.Event) -> Result:
        def stop_or_wait(event: Event) -> None:
            if (event.step, event.kind) == ("first", "step-end"):
                if name == "a":
                    stop.set()
                else:
                    assert a_has_ended.wait(60)

        result = play(
            playbook, {"robot": LocalTarget(name)}, {}, journal=tmp_path / "journal", stop=stop, on_event=stop_or_wait
        )
        if name == "a":
            a_has_ended.set()
        return result

    results = play_on_all(["a", "b"], str, "book", one)
    assert [result.state for result in results] == ["interrupted", "interrupted"]
    assert sorted(path.name for path in tmp_path.glob("[ab]-*")) == ["a-1", "a-up", "b-1", "b-up"]
