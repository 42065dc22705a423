"""Run directories: private to their user, and robust against what stands in their files."""

from __future__ import annotations

import json
import os
import signal
import stat
from pathlib import Path

import pytest

from lupin_runtime.stack.recorded import RecordedProcess, supervisor_of
from lupin_runtime.stack.runs import Run, create_run, make_state_folder, state_directory


@pytest.fixture(autouse=True)
def own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "lupin"


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.mark.parametrize("earlier", [None, 0o755, 0o777, 0o700])
def test_no_other_user_enters_the_state(own_state: Path, earlier: int | None) -> None:
    if earlier is not None:
        own_state.mkdir(parents=True)
        own_state.chmod(earlier)
    run, lock = create_run()
    assert state_directory() == own_state
    assert (mode(own_state), mode(run.path), mode(run.path / "lock")) == (0o700, 0o700, 0o600)
    assert run.is_live()
    os.close(lock)
    assert not run.is_live()


def test_files_of_a_run_are_for_their_user_only(own_state: Path) -> None:
    before = os.umask(0)
    try:
        run, lock = create_run()
        run.write_info({})
        run.write_state({})
        run.set_kept(True)
    finally:
        os.umask(before)
    os.close(lock)
    folders = [path for path in (own_state, *own_state.rglob("*")) if path.is_dir()]
    files = [path for path in own_state.rglob("*") if path.is_file()]
    assert {path.name: mode(path) for path in folders} == dict.fromkeys(("lupin", "runs", run.id, "logs"), 0o700)
    assert {path.name: mode(path) for path in files} == dict.fromkeys(("lock", "run.json", "state.json", "keep"), 0o600)


def test_lock_that_is_a_link_or_fifo_is_not_opened(tmp_path: Path) -> None:
    (tmp_path / "lock").symlink_to("/dev/zero")
    assert not Run(tmp_path).is_live()
    (tmp_path / "lock").unlink()
    os.mkfifo(tmp_path / "lock")
    assert not Run(tmp_path).is_live()


def test_folder_elsewhere_keeps_its_parent(tmp_path: Path) -> None:
    (tmp_path / "shared").mkdir(mode=0o755)
    make_state_folder(tmp_path / "shared" / "private")
    assert (mode(tmp_path / "shared"), mode(tmp_path / "shared" / "private")) == (0o755, 0o700)


@pytest.mark.parametrize("pid", [-1, 0, 1, True, "1", None, 2**70, [1], 3.5])
@pytest.mark.parametrize("start_ticks", [None, 0, -1, "x"])
def test_file_names_no_process_to_signal(tmp_path: Path, pid: object, start_ticks: object) -> None:
    (tmp_path / "run.json").write_text(json.dumps({"pid": pid, "start_ticks": start_ticks}))
    supervisor = supervisor_of(Run(tmp_path))
    assert isinstance(supervisor, RecordedProcess)
    assert not supervisor.exists()
    assert supervisor.signal(signal.SIGTERM) is False


@pytest.mark.parametrize(
    "content", ["", "[]", "null", "{", '"x"', "1e999", "[" * 100_000, "\ud800".encode("utf-8", "surrogatepass")]
)
def test_damaged_files_are_empty(tmp_path: Path, content: str | bytes) -> None:
    for name in ("run.json", "state.json"):
        (tmp_path / name).write_bytes(content.encode() if isinstance(content, str) else content)
    assert (Run(tmp_path).info(), Run(tmp_path).state()) == ({}, {})
