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
from lupin_cli.playbook.lease import LONGEST_RUN_S, Lease, LeaseTaken, read_holder
from lupin_cli.playbook.undo import undo
from tests.support.optional import present

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
    with pytest.raises(LeaseTaken, match=r"robot is being changed by ada@desk \(lupin play deploy-robot\), for \d+") as caught:
        second.take()
    assert caught.value.next_command == "lupin wait free --robot robot"
    second.end()
    assert (lease_path / "owner").exists(), "another operator's lease must stay"
    with pytest.raises(LeaseTaken, match="not by bob@desk"):
        Lease(targets["robot"], "lupin play heal", take_from="bob@desk").take()
    assert present(read_holder(targets["robot"])).who == "ada@desk"
    third = Lease(targets["robot"], "lupin play heal", take_from="ada@desk")
    assert third.take() and not third.take()
    assert json.loads((lease_path / "owner").read_text())["what"] == "lupin play heal"
    third.end()
    assert not lease_path.exists() and read_holder(targets["robot"]) is None


@pytest.mark.parametrize(("age_s", "advice"), [(4, "wait until that run has ended"), (7201, "--break-lease ada@desk")])
def test_only_a_lease_older_than_any_run_is_called_dead(age_s: int, advice: str, targets: Targets, lease_path: Path) -> None:
    take_lease_as(lease_path, ADA)
    uptime_s = float(Path("/proc/uptime").read_text().split()[0])
    (lease_path / "up").write_text(f"{int(uptime_s) - age_s}\n")
    with pytest.raises(LeaseTaken) as caught:
        Lease(targets["robot"], "lupin play heal").take()
    assert advice in str(caught.value) and ("--break-lease" in str(caught.value)) == (age_s > LONGEST_RUN_S)


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
    live.reachable = False  # the link was cut, so the lease stays on the robot
    live.end()
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


def test_exclusive_run_without_the_lease_begins_no_step(
    load_playbook: Callable[..., Playbook], targets: Targets, lease_path: Path, tmp_path: Path
) -> None:
    playbook, given, journal = (
        load_playbook(f"exclusive: true\n{WRITES}"),
        {"file": str(tmp_path / "file")},
        tmp_path / "journal",
    )
    take_lease_as(lease_path, ADA)
    assert play(playbook, targets, given, dry_run=True).state == "done"
    events: list[Event] = []
    out = play(playbook, targets, given, journal=journal, on_event=events.append)
    assert (out.state, out.exit_code, out.run, events) == ("failed", 1, "", []) and "ada@desk" in out.message
    again = f"lupin play {tmp_path}/book.yaml --robot robot -v file={tmp_path}/file"
    assert out.next_command == f"lupin wait free --robot robot && {again}"
    assert not (tmp_path / "file").exists()
    done = play(playbook, targets, given, take_lease_from="ada@desk", journal=journal)
    assert done.state == "done" and (tmp_path / "file").read_text() == "ours"
    assert not lease_path.exists()
    take_lease_as(lease_path, ADA)
    back = undo(find_playbook_run(done.run, journal), targets, journal=journal)
    assert back.state == "failed" and back.next_command.startswith("lupin wait free --robot robot && lupin play ")
    assert (tmp_path / "file").exists()
    assert undo(find_playbook_run(done.run, journal), targets, journal=journal, take_lease_from="ada@desk").state == "done"
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
    cut.reachable = False
    cut.end()
    assert lease_path.exists()
    assert play(playbook, targets, resume=True, journal=journal).state == "failed"
    assert not lease_path.exists()


def test_lease_is_held_from_the_first_step_to_the_end(
    load_playbook: Callable[..., Playbook], targets: Targets, lease_path: Path, tmp_path: Path
) -> None:
    playbook, held = load_playbook(f"exclusive: true\n{WRITES}"), []

    def note(event: Event) -> None:
        held.append((event.kind, present(read_holder(targets["robot"])).purpose))

    result = play(
        playbook, targets, {"file": str(tmp_path / "file")}, journal=tmp_path / "j", on_event=note, command="lupin deploy robot"
    )
    assert result.state == "done" and not lease_path.exists()
    assert ("step", "lupin deploy robot") in held and {purpose for _, purpose in held} == {"lupin deploy robot"}


def test_step_is_judged_again_after_a_reboot_ended_the_lease(
    load_playbook: Callable[..., Playbook], targets: Targets, lease_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A reboot ends the lease; another run may take it and change the robot before this one has it again.
    playbook, file = load_playbook(f"exclusive: true\n{WRITES}"), tmp_path / "file"
    held: list[Lease] = []
    take = Lease.take

    def note_and_take(lease: Lease) -> bool:
        held.append(lease)
        return take(lease)

    monkeypatch.setattr(Lease, "take", note_and_take)

    def meanwhile(event: Event) -> None:
        if event.kind == "difference":
            held[0].end()
            file.write_text("ours")

    result = play(playbook, targets, {"file": str(file)}, journal=tmp_path / "journal", on_event=meanwhile)
    assert (result.state, result.steps[0].state) == ("done", "same")
    assert not lease_path.exists()


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


@pytest.mark.parametrize("nonce", ["'; touch evil; '", "$(touch evil)", "-e x -f /etc/passwd", "`touch evil`"])
def test_nonce_and_path_of_a_lease_are_not_shell_text(
    nonce: str, targets: Targets, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "a $(touch evil) 'lease"
    take_lease_as(path, {**ADA, "nonce": nonce})
    lease = Lease(targets["robot"], "lupin play heal", take_from="ada@desk", path=str(path))
    assert lease.take()
    assert present(read_holder(targets["robot"], str(path))).purpose == "lupin play heal"
    lease.end()
    assert not path.exists() and read_holder(targets["robot"], str(path)) is None
    assert not (tmp_path / "evil").exists()


@pytest.mark.parametrize("pid", ["../../x", "1\0", [1], None, 1.5, -1])
def test_odd_pid_of_a_lease_is_no_process(pid: object, targets: Targets, lease_path: Path) -> None:
    mine = Lease(targets["robot"], "lupin play heal")
    assert mine.take()
    owner = json.loads((lease_path / "owner").read_text())
    (lease_path / "owner").write_text(json.dumps({**owner, "pid": pid}))
    assert present(read_holder(targets["robot"])).is_stale
