"""`always` steps bring back what a run has stopped: after an interrupt at any point, and when the journal's disk is full."""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from lupin_cli.connection.local import LocalTarget
from lupin_cli.playbook import Event, JournalError, Playbook, find_playbook_run, play
from lupin_cli.playbook.journal import Journal

LoadPlaybook = Callable[..., Playbook]
Targets = dict[str, LocalTarget]

# `down` stops what `up` starts; `clean` runs between them.
STACK = """
vars: {root: {type: text}}
steps:
- name: down
  command: {run: "rm {{ root }}/up", unless: "[ ! -e {{ root }}/up ]"}
- name: clean
  file: {path: "{{ root }}/clean", content: x}
- name: up
  always: true
  file: {path: "{{ root }}/up", content: x}
- name: also up
  always: true
  file: {path: "{{ root }}/also-up", content: x}
"""


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "machine"
    folder.mkdir()
    (folder / "up").touch()
    return folder


def files_in(root: Path) -> list[str]:
    return sorted(path.name for path in root.iterdir())


@pytest.mark.parametrize("last", ["down", "clean", "up"])
def test_stop_between_steps_runs_every_always_step(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path, last: str
) -> None:
    stop = threading.Event()

    def stop_after(event: Event) -> None:
        if event.kind == "step-end" and event.step == last:
            stop.set()

    result = play(load_playbook(STACK), targets, {"root": str(root)}, journal=tmp_path / "j", on_event=stop_after, stop=stop)
    assert result.state == "interrupted" and "before the step" in result.message
    assert {"up", "also-up"} <= set(files_in(root)), result.message
    assert stop.is_set(), "other robots' runs share the event"
    assert find_playbook_run(result.run, tmp_path / "j").closed


@pytest.mark.parametrize("kind", ["step", "difference", "change", "step-end"])
@pytest.mark.parametrize("at", ["down", "clean", "up", "also up"])
def test_ctrl_c_in_any_step_runs_every_always_step(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path, at: str, kind: str
) -> None:
    pressed: list[Event] = []

    def press(event: Event) -> None:
        if (event.step, event.kind) == (at, kind) and not pressed:
            pressed.append(event)
            raise KeyboardInterrupt

    result = play(load_playbook(STACK), targets, {"root": str(root)}, journal=tmp_path / "j", on_event=press)
    assert pressed and result.state == "interrupted"
    assert {"up", "also-up"} <= set(files_in(root)), result.message


def test_failed_always_step_is_named_after_the_first_error(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path
) -> None:
    (root / "clean").mkdir()
    (root / "clean" / "x").touch()
    (root / "also-up").mkdir()
    (root / "also-up" / "x").touch()
    result = play(load_playbook(STACK), targets, {"root": str(root)}, journal=tmp_path / "j")
    assert result.message.startswith("clean: ") and "; also up: robot: could not write" in result.message


@pytest.fixture
def fill_disk(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """A function that fills the journal's disk: from its n-th line on, only half of each line is written."""

    def fill(line: int) -> None:
        write, real_write, lines = Journal.write, os.write, []

        def write_and_count(self: Journal, event: str, **values: object) -> None:
            lines.append(event)
            write(self, event, **values)  # type: ignore[arg-type]

        def write_half(descriptor: int, data: bytes) -> int:
            if len(lines) < line or b'"event"' not in data[:10]:
                return real_write(descriptor, data)
            real_write(descriptor, data[: len(data) // 2])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr(Journal, "write", write_and_count)
        monkeypatch.setattr(os, "write", write_half)

    return fill


def test_full_disk_stops_the_run_and_runs_always_steps(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path, fill_disk: Callable[[int], None]
) -> None:
    fill_disk(5)  # start; step, change, step-end of `down`; step of `clean`
    result = play(load_playbook(STACK), targets, {"root": str(root)}, journal=tmp_path / "j")
    assert (result.state, result.exit_code) == ("failed", 1)
    assert "No space left on device" in result.message and "'always' steps" in result.message
    assert files_in(root) == ["also-up", "up"], "what cannot be journaled is not done, but the stack is started"
    assert result.next_command == f"lupin play {tmp_path}/book.yaml --robot robot -v root={root}"
    record = find_playbook_run(result.run, tmp_path / "j")
    assert (record.torn_lines, [step.name for step in record.steps]) == (0, ["down"])


@pytest.mark.parametrize("line", range(2, 15))
def test_full_disk_at_any_line_leaves_nothing_stopped(
    load_playbook: LoadPlaybook,
    targets: Targets,
    root: Path,
    tmp_path: Path,
    fill_disk: Callable[[int], None],
    line: int,
) -> None:
    fill_disk(line)
    result = play(load_playbook(STACK), targets, {"root": str(root)}, journal=tmp_path / "j")
    assert {"up", "also-up"} <= set(files_in(root)), result.message
    assert result.state == ("done" if line == 14 else "failed")


def test_full_disk_before_the_run_is_refused(
    load_playbook: LoadPlaybook, targets: Targets, root: Path, tmp_path: Path, fill_disk: Callable[[int], None]
) -> None:
    fill_disk(1)
    with pytest.raises(JournalError, match="No space left on device"):
        play(load_playbook(STACK), targets, {"root": str(root)}, journal=tmp_path / "j")
    assert files_in(root) == ["up"]
