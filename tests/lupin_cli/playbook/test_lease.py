"""Two operators at the same time: the second one learns who the first is, and their changes do not mix."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from lupin_cli.connection.local import LocalTarget
from lupin_cli.operations.base import OperationError
from lupin_cli.playbook import Event, Playbook, find_playbook_run, list_shipped, load, play
from lupin_cli.playbook.lease import Lease, LeaseTaken
from lupin_cli.playbook.undo import undo

Targets = dict[str, LocalTarget]
ADA = {"who": "ada@desk", "what": "lupin play deploy-robot", "uid": 1000, "machine": "another", "pid": 1, "nonce": "of ada"}
WRITES = "vars: {file: {type: text}}\nsteps:\n- name: write\n  file: {path: '{{ file }}', content: ours}\n"


@pytest.fixture
def lease_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The path of this test's lease."""
    monkeypatch.setattr("lupin_cli.playbook.lease.LEASE_PATH", str(tmp_path / "lease"))
    return tmp_path / "lease"


def take_lease_as(lease_path: Path, owner: dict[str, object]) -> None:
    lease_path.mkdir()
    (lease_path / "owner").write_text(json.dumps(owner))
    (lease_path / "up").write_text("1\n")


def test_lease_names_its_holder_and_can_be_broken(targets: Targets, lease_path: Path) -> None:
    take_lease_as(lease_path, ADA)
    second = Lease(targets["robot"], "lupin play heal")
    with pytest.raises(LeaseTaken, match=r"robot is being changed by ada@desk \(lupin play deploy-robot\), for \d+ s now"):
        second.take()
    second.end()
    assert (lease_path / "owner").exists(), "another operator's lease must stay"
    third = Lease(targets["robot"], "lupin play heal", break_it=True)
    assert third.take() and not third.take()
    assert json.loads((lease_path / "owner").read_text())["what"] == "lupin play heal"
    third.end()
    assert not lease_path.exists()


def test_lease_is_granted_to_one_of_many(targets: Targets, lease_path: Path) -> None:
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
    assert list(lease_path.parent.iterdir()) == []


def test_stale_lease_is_taken_over_by_its_operator_only(targets: Targets, lease_path: Path) -> None:
    live = Lease(targets["robot"], "test")
    live.take()
    owner = json.loads((lease_path / "owner").read_text())
    with pytest.raises(LeaseTaken):
        Lease(targets["robot"], "test").take()
    live.end(reachable=False)  # the link was cut, so the lease stays on the robot
    ours = Lease(targets["robot"], "test")
    assert ours.take()
    ours.end()
    with subprocess.Popen(["true"]) as dead:
        dead.wait()
    for stale_values in ({}, {"pid": dead.pid}, {"started": "1"}, {"boot": "an earlier one"}):
        take_lease_as(lease_path, {**owner, **stale_values})
        next_one = Lease(targets["robot"], "test")
        assert next_one.take()
        next_one.end()
    for foreign_values in ({"machine": "another", "pid": dead.pid}, {"uid": 4711, "pid": dead.pid}):
        take_lease_as(lease_path, {**owner, **foreign_values})
        with pytest.raises(LeaseTaken):
            Lease(targets["robot"], "test").take()
        (lease_path / "owner").unlink()
        (lease_path / "up").unlink()
        lease_path.rmdir()


@pytest.mark.parametrize("text", ["", "no JSON", "[1]", '{"who": "ada"}'])
def test_unreadable_lease_counts_as_taken(text: str, targets: Targets, lease_path: Path) -> None:
    take_lease_as(lease_path, {})
    (lease_path / "owner").write_text(text)
    with pytest.raises(LeaseTaken, match=r"somebody|ada"):
        Lease(targets["robot"], "test").take()


def test_lease_path_that_cannot_exist_is_an_error(targets: Targets, tmp_path: Path) -> None:
    with pytest.raises(OperationError, match="the lease could not be taken"):
        Lease(targets["robot"], "test", path=str(tmp_path / "absent" / "lease")).take()


def test_exclusive_run_without_the_lease_names_break_lease(
    load_playbook: Callable[..., Playbook], targets: Targets, lease_path: Path, tmp_path: Path
) -> None:
    playbook, given, journal = (
        load_playbook(f"exclusive: true\n{WRITES}"),
        {"file": str(tmp_path / "file")},
        tmp_path / "journal",
    )
    take_lease_as(lease_path, ADA)
    assert play(playbook, targets, given, dry_run=True).state == "done"
    out = play(playbook, targets, given, journal=journal)
    assert (out.state, out.exit_code) == ("failed", 1) and "ada@desk" in out.message
    assert out.next_command == "lupin play book --robot robot --resume --break-lease"
    assert not (tmp_path / "file").exists()
    done = play(playbook, targets, resume=True, break_lease=True, journal=journal)
    assert (done.state, done.run) == ("done", out.run) and (tmp_path / "file").read_text() == "ours"
    assert not lease_path.exists()
    take_lease_as(lease_path, ADA)
    assert play(playbook, targets, given, journal=journal).state == "done", "what changes nothing needs no lease"
    back = undo(find_playbook_run(done.run, journal), targets, journal=journal)
    assert back.state == "failed" and back.next_command.endswith("--break-lease") and (tmp_path / "file").exists()
    assert undo(find_playbook_run(done.run, journal), targets, journal=journal, break_lease=True).state == "done"
    assert not (tmp_path / "file").exists() and not lease_path.exists()


def test_resumed_run_without_changes_removes_its_old_lease(
    load_playbook: Callable[..., Playbook], targets: Targets, lease_path: Path, tmp_path: Path
) -> None:
    needs = "- name: goes no further\n  require: {holds: '{{ false }}', otherwise: not here}\n"
    playbook, journal = load_playbook(f"exclusive: true\n{WRITES}{needs}"), tmp_path / "journal"
    failed = play(playbook, targets, {"file": str(tmp_path / "file")}, journal=journal)
    assert failed.state == "failed" and not lease_path.exists()
    cut = Lease(targets["robot"], "test")
    assert cut.take()
    cut.end(reachable=False)
    assert lease_path.exists()
    assert play(playbook, targets, resume=True, journal=journal).state == "failed"
    assert not lease_path.exists()


@pytest.mark.usefixtures("lease_path")
def test_step_is_judged_again_after_the_lease_is_taken(
    load_playbook: Callable[..., Playbook], targets: Targets, tmp_path: Path
) -> None:
    playbook, file = load_playbook(f"exclusive: true\n{WRITES}"), tmp_path / "file"

    def meanwhile(event: Event) -> None:
        if event.kind == "difference":
            file.write_text("ours")

    result = play(playbook, targets, {"file": str(file)}, journal=tmp_path / "journal", on_event=meanwhile)
    assert (result.state, result.steps[0].state) == ("done", "same")


def test_playbook_that_includes_an_exclusive_one_is_exclusive(
    write_playbook: Callable[..., Path], targets: Targets, lease_path: Path, tmp_path: Path
) -> None:
    write_playbook(f"exclusive: true\n{WRITES}", "inner")
    outer = load(write_playbook("vars: {f: {type: text}}\nsteps:\n- include: inner\n  vars: {file: '{{ f }}'}\n", "outer"))
    assert outer.exclusive and not load(write_playbook(WRITES, "plain")).exclusive
    take_lease_as(lease_path, ADA)
    assert play(outer, targets, {"f": str(tmp_path / "file")}, journal=tmp_path / "journal").state == "failed"
    plain = load(tmp_path / "plain.yaml")
    assert play(plain, targets, {"file": str(tmp_path / "file")}, journal=tmp_path / "journal").state == "done"


def test_shipped_playbooks_that_touch_the_stack_are_exclusive() -> None:
    touching = {"release", "unit", "unit-file", "restart", "reboot", "discovery-server", "controllers", "clock-step"}
    for playbook in map(load, list_shipped()):
        words = {step.operation.name for step in playbook.steps if step.machine == "robot"}
        assert playbook.exclusive == bool(words & touching), playbook.name
