"""Two operators at once: the second is told who the first is, and nothing of theirs is mixed."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from lupin_cli.operations.base import OperationError
from lupin_cli.runbook import Event, Playbook, find_run, load, play, shipped
from lupin_cli.runbook.lease import Lease, LeaseTaken
from lupin_cli.runbook.undo import undo
from lupin_cli.target.local import LocalTarget

Targets = dict[str, LocalTarget]
OTHERS = {"who": "ada@desk", "what": "lupin play deploy-robot", "uid": 1000, "machine": "another", "pid": 1, "nonce": "hers"}
WRITES = "vars: {file: {type: text}}\nsteps:\n- name: write\n  file: {path: '{{ file }}', content: ours}\n"


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where leases of this test lie."""
    monkeypatch.setattr("lupin_cli.runbook.lease.PLACE", str(tmp_path / "lease"))
    return tmp_path / "lease"


def taken_by(place: Path, owner: dict[str, object]) -> None:
    place.mkdir()
    (place / "owner").write_text(json.dumps(owner))
    (place / "up").write_text("1\n")


def test_the_second_operator_is_told_who_the_first_is_and_may_break_the_lease(targets: Targets, place: Path) -> None:
    taken_by(place, OTHERS)
    second = Lease(targets["robot"], "lupin play heal")
    with pytest.raises(LeaseTaken, match=r"robot is being changed by ada@desk \(lupin play deploy-robot\) since \d+ s"):
        second.take()
    second.end()
    assert (place / "owner").exists(), "somebody else's lease is not given back"
    third = Lease(targets["robot"], "lupin play heal", break_it=True)
    assert third.take() and not third.take()
    assert json.loads((place / "owner").read_text())["what"] == "lupin play heal"
    third.end()
    assert not place.exists()


def test_of_many_at_once_one_has_it(targets: Targets, place: Path) -> None:
    def attempt(lease: Lease) -> bool:
        try:
            return lease.take()
        except LeaseTaken:
            return False

    leases = [Lease(targets["robot"], "test") for _ in range(12)]
    with ThreadPoolExecutor(12) as pool:
        assert sum(pool.map(attempt, leases)) == 1
    for lease in leases:
        lease.end()
    assert [path.name for path in place.parent.iterdir()] == []


def test_what_a_dead_run_of_ours_left_is_taken_over_and_a_live_ones_is_not(targets: Targets, place: Path) -> None:
    live = Lease(targets["robot"], "test")
    live.take()
    owner = json.loads((place / "owner").read_text())
    with pytest.raises(LeaseTaken):
        Lease(targets["robot"], "test").take()
    live.end(reachable=False)  # the link went: it stays on the robot
    ours = Lease(targets["robot"], "test")
    assert ours.take()
    ours.end()
    with subprocess.Popen(["true"]) as dead:
        dead.wait()
    for left_over in ({}, {"pid": dead.pid}, {"started": "1"}, {"boot": "an earlier one"}):
        taken_by(place, {**owner, **left_over})
        next_one = Lease(targets["robot"], "test")
        assert next_one.take()
        next_one.end()
    for others in ({"machine": "another", "pid": dead.pid}, {"uid": 4711, "pid": dead.pid}):
        taken_by(place, {**owner, **others})
        with pytest.raises(LeaseTaken):
            Lease(targets["robot"], "test").take()
        (place / "owner").unlink()
        (place / "up").unlink()
        place.rmdir()


@pytest.mark.parametrize("text", ["", "no JSON", "[1]", '{"who": "ada"}'])
def test_a_lease_that_tells_nothing_is_somebodys(text: str, targets: Targets, place: Path) -> None:
    taken_by(place, {})
    (place / "owner").write_text(text)
    with pytest.raises(LeaseTaken, match=r"somebody|ada"):
        Lease(targets["robot"], "test").take()


def test_a_place_where_no_lease_can_lie_is_said(targets: Targets, tmp_path: Path) -> None:
    with pytest.raises(OperationError, match="no lease could be taken"):
        Lease(targets["robot"], "test", place=str(tmp_path / "absent" / "lease")).take()


def test_an_exclusive_run_is_kept_out_with_the_command_that_breaks_in_and_goes_on(
    loaded: Callable[..., Playbook], targets: Targets, place: Path, tmp_path: Path
) -> None:
    book, given, journal = loaded(f"exclusive: true\n{WRITES}"), {"file": str(tmp_path / "file")}, tmp_path / "journal"
    taken_by(place, OTHERS)
    assert play(book, targets, given, dry_run=True).state == "done"
    out = play(book, targets, given, journal=journal)
    assert (out.state, out.exit_code) == ("failed", 1) and "ada@desk" in out.message
    assert out.next_command == "lupin play book --robot robot --resume --break-lease"
    assert not (tmp_path / "file").exists()
    done = play(book, targets, resume=True, break_lease=True, journal=journal)
    assert (done.state, done.run) == ("done", out.run) and (tmp_path / "file").read_text() == "ours"
    assert not place.exists()
    taken_by(place, OTHERS)
    assert play(book, targets, given, journal=journal).state == "done", "what changes nothing needs no lease"
    back = undo(find_run(done.run, journal), targets, journal=journal)
    assert back.state == "failed" and back.next_command.endswith("--break-lease") and (tmp_path / "file").exists()
    assert undo(find_run(done.run, journal), targets, journal=journal, break_lease=True).state == "done"
    assert not (tmp_path / "file").exists() and not place.exists()


def test_a_resumed_run_with_nothing_left_to_change_gives_back_what_its_cut_run_could_not(
    loaded: Callable[..., Playbook], targets: Targets, place: Path, tmp_path: Path
) -> None:
    needs = "- name: goes no further\n  require: {holds: '{{ false }}', otherwise: not here}\n"
    book, journal = loaded(f"exclusive: true\n{WRITES}{needs}"), tmp_path / "journal"
    failed = play(book, targets, {"file": str(tmp_path / "file")}, journal=journal)
    assert failed.state == "failed" and not place.exists()
    cut = Lease(targets["robot"], "test")
    assert cut.take()
    cut.end(reachable=False)
    assert place.exists()
    assert play(book, targets, resume=True, journal=journal).state == "failed"
    assert not place.exists()


def test_what_others_did_until_the_lease_was_had_is_seen(
    loaded: Callable[..., Playbook], targets: Targets, place: Path, tmp_path: Path
) -> None:
    book, file = loaded(f"exclusive: true\n{WRITES}"), tmp_path / "file"

    def meanwhile(event: Event) -> None:
        if event.kind == "difference":
            file.write_text("ours")

    result = play(book, targets, {"file": str(file)}, journal=tmp_path / "journal", on_event=meanwhile)
    assert (result.state, result.steps[0].state) == ("done", "same")


def test_a_playbook_that_includes_an_exclusive_one_is_exclusive(
    written: Callable[..., Path], targets: Targets, place: Path, tmp_path: Path
) -> None:
    written(f"exclusive: true\n{WRITES}", "inner")
    outer = load(written("vars: {f: {type: text}}\nsteps:\n- include: inner\n  vars: {file: '{{ f }}'}\n", "outer"))
    assert outer.exclusive and not load(written(WRITES, "plain")).exclusive
    taken_by(place, OTHERS)
    assert play(outer, targets, {"f": str(tmp_path / "file")}, journal=tmp_path / "journal").state == "failed"
    plain = load(tmp_path / "plain.yaml")
    assert play(plain, targets, {"file": str(tmp_path / "file")}, journal=tmp_path / "journal").state == "done"


def test_every_shipped_playbook_that_stops_or_starts_what_drives_the_robot_is_exclusive() -> None:
    touching = {"release", "unit", "unit-file", "restart", "reboot", "discovery-server", "controllers", "clock-step"}
    for book in map(load, shipped()):
        words = {step.operation.name for step in book.steps if step.machine == "robot"}  # type: ignore[attr-defined]
        assert book.exclusive == bool(words & touching), book.name
