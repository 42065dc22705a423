"""Writes as root in folders of another user, who plants links and swaps files: the real scripts, attacked at every step."""

from __future__ import annotations

import os
import stat
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from lupin_cli.connection.base import TargetError
from lupin_cli.connection.local import LocalTarget
from lupin_cli.connection.shell_file_io import SAFE_PATHS, write_file_script
from lupin_cli.operations import OperationError, path_state
from lupin_cli.operations.directory import Directory
from lupin_cli.operations.file import File
from lupin_cli.operations.path_state import link_atomically, put_owned, remove, set_attributes
from lupin_cli.operations.release_transfer import _FOLDERS
from tests.support.operation_cycle import examine

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="needs root, whose writes are attacked")

NOBODY = 65534
SECRET = b"only root may change this"


@pytest.fixture
def victim(tmp_path: Path) -> Path:
    """A file of root that the attacker would like to have."""
    path = tmp_path / "etc" / "shadow"
    path.parent.mkdir()
    path.write_bytes(SECRET)
    path.chmod(0o600)
    return path


@pytest.fixture
def theirs(tmp_path: Path) -> Path:
    """A folder of the attacker."""
    path = tmp_path / "home"
    path.mkdir()
    os.chown(path, NOBODY, NOBODY)
    return path


def plant(link: Path, to: Path) -> None:
    """Make a symbolic link that belongs to the attacker."""
    link.symlink_to(to)
    os.chown(link, NOBODY, NOBODY, follow_symlinks=False)


def assert_unharmed(victim: Path) -> None:
    found = victim.stat()
    assert victim.read_bytes() == SECRET
    assert (found.st_uid, stat.S_IMODE(found.st_mode), found.st_nlink) == (0, 0o600, 1)
    assert [path.name for path in victim.parent.iterdir()] == [victim.name]


def run_script(script: str, data: bytes = b"", programs: Path | None = None) -> subprocess.CompletedProcess[bytes]:
    path = f"{programs}:{os.environ['PATH']}" if programs else os.environ["PATH"]
    return subprocess.run(
        ["/bin/sh", "-c", script], input=data, capture_output=True, env={"PATH": path, "HOME": "/root"}, timeout=60
    )


def interpose(folder: Path, program: str, before: str) -> Path:
    """Let the attacker run `before` whenever root's script calls `program`; return the folder for PATH."""
    folder.mkdir()
    (folder / program).write_text(f'#!/bin/sh\nPATH=/usr/bin:/bin\n{before}\nexec {program} "$@"\n')
    (folder / program).chmod(0o755)
    return folder


def test_names_of_temporary_files_cannot_be_predicted(theirs: Path, tmp_path: Path) -> None:
    programs = interpose(tmp_path / "bin", "stat", f"ls {theirs} >> {tmp_path}/seen")
    for _ in range(20):
        assert run_script(write_file_script(str(theirs / "file"), 3, 0o644), b"new", programs).returncode == 0
    names = {name for name in (tmp_path / "seen").read_text().split() if name != "file"}
    assert len(names) == 20 and not [name for name in names if str(os.getpid()) in name]
    assert [path.name for path in theirs.iterdir()] == ["file"]


@pytest.mark.parametrize("exists", [True, False], ids=["to-a-file", "dangling"])
def test_planted_temporary_name_is_not_written_through(theirs: Path, victim: Path, tmp_path: Path, exists: bool) -> None:
    wanted = victim if exists else victim.parent / "cron"
    plant(theirs / "file.lupin-guessed", wanted)
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "mktemp").write_text("#!/bin/sh\necho ./file.lupin-guessed\n")
    (tmp_path / "bin" / "mktemp").chmod(0o755)
    ran = run_script(write_file_script(str(theirs / "file"), 3, 0o644), b"new", tmp_path / "bin")
    assert ran.returncode != 0 and b"exists" in ran.stderr
    assert_unharmed(victim)
    assert not (theirs / "file").exists()


@pytest.mark.parametrize("program", ["cat", "stat", "chown", "chmod", "sync", "mv"])
@pytest.mark.parametrize("attack", ["ln -sf", "ln -f"], ids=["symlink", "hard-link"])
def test_swapped_temporary_file_leads_nowhere(theirs: Path, victim: Path, tmp_path: Path, program: str, attack: str) -> None:
    programs = interpose(tmp_path / "bin", program, f'for file in {theirs}/file.lupin-*; do {attack} {victim} "$file"; done')
    script = write_file_script(str(theirs / "file"), 3, 0o666, "nobody:nogroup")
    run_script(script, b"new", programs)
    for path in theirs.iterdir():
        path.unlink()  # a hard link to the victim is the attacker's own doing
    assert_unharmed(victim)


def test_link_in_place_of_the_file_is_replaced(theirs: Path, victim: Path) -> None:
    plant(theirs / "file", victim)
    plant(theirs / "folder", victim.parent)
    target = LocalTarget()
    for name in ("file", "folder"):
        target.put(str(theirs / name), b"new", mode=0o644, root=True)
        assert not (theirs / name).is_symlink() and (theirs / name).read_bytes() == b"new"
    assert_unharmed(victim)


def test_folder_in_place_of_the_file_is_an_error(theirs: Path) -> None:
    (theirs / "file").mkdir()
    with pytest.raises(TargetError, match="could not write"):
        LocalTarget().put(str(theirs / "file"), b"new", root=True)
    assert list((theirs / "file").iterdir()) == []


def test_root_follows_no_link_of_another_user(theirs: Path, victim: Path) -> None:
    target = LocalTarget()
    plant(theirs / "config", victim.parent)
    path = str(theirs / "config" / "shadow")
    with pytest.raises(TargetError, match=r"config is a symbolic link that does not belong to root"):
        target.put(path, b"new", root=True)
    attempts: tuple[Callable[[], object], ...] = (
        lambda: remove(target, path, True),
        lambda: set_attributes(target, path, mode="666", owner="nobody:nogroup", root=True),
        lambda: put_owned(target, path, b"new", 0o666, "nobody:nogroup", True),
        lambda: link_atomically(target, path, "/elsewhere", True),
        lambda: Directory(path=f"{theirs}/config/cron.d", root=True)._create(target),
        lambda: Directory(path=f"{theirs}/config", root=True)._create(target),
    )
    for attempt in attempts:
        with pytest.raises((OperationError, TargetError), match="does not belong to root"):
            attempt()
    assert_unharmed(victim)


def test_root_follows_its_own_links(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    (tmp_path / "again").symlink_to(tmp_path / "link" / ".." / "link")
    LocalTarget().put(str(tmp_path / "again" / "file"), b"new", root=True)
    assert (tmp_path / "real" / "file").read_bytes() == b"new"


def test_attributes_of_a_planted_link_are_not_set(theirs: Path, victim: Path) -> None:
    plant(theirs / "file", victim)
    with pytest.raises(OperationError, match="neither a file nor a folder"):
        set_attributes(LocalTarget(), str(theirs / "file"), mode="666", owner="nobody:nogroup", root=True)
    assert_unharmed(victim)


@pytest.mark.parametrize("program", ["id", "pwd", "readlink", "stat", "chown", "chmod"])
def test_attributes_are_set_on_the_opened_file(
    theirs: Path, victim: Path, tmp_path: Path, program: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (theirs / "file").write_text("mine")
    programs = interpose(tmp_path / "bin", program, f"ln -sf {victim} {theirs}/file")
    sent: list[str] = []
    monkeypatch.setattr(path_state, "change", lambda _, script, *__, **___: sent.append(script))
    set_attributes(LocalTarget(), str(theirs / "file"), mode="666", owner="nobody:nogroup", root=True)
    run_script(sent[0], programs=programs)
    assert_unharmed(victim)


def test_file_gets_its_owner_before_its_name(theirs: Path, tmp_path: Path) -> None:
    owners = tmp_path / "owners"
    programs = interpose(tmp_path / "bin", "mv", f"stat -c '%U:%G %a' {theirs}/file.lupin-* >> {owners}")
    assert run_script(write_file_script(str(theirs / "file"), 3, 0o640, "nobody:nogroup"), b"new", programs).returncode == 0
    assert owners.read_text() == "nobody:nogroup 640\n"
    assert (theirs / "file").stat().st_uid == NOBODY


def test_operations_work_as_root_in_a_folder_of_a_user(theirs: Path) -> None:
    target = LocalTarget()
    for operation in (
        Directory(path=f"{theirs}/a/b", mode="0750", owner="nobody:nogroup", root=True),
        File(path=f"{theirs}/a/b/file", content="x", mode="0640", owner="nobody:nogroup", root=True),
        File(path=f"{theirs}/a/b/file", mode="0600", root=True),
        File(path=f"{theirs}/a/b/file", present=False, root=True),
        Directory(path=f"{theirs}/a/b", present=False, root=True),
    ):
        difference = examine(operation, target)
        assert difference is not None
        operation.change(target, difference)
        assert examine(operation, target) is None
    assert (theirs / "a").is_dir() and not (theirs / "a" / "b").exists()


def test_folder_of_releases_is_not_a_planted_link(theirs: Path, victim: Path) -> None:
    plant(theirs / "releases", victim.parent)
    ran = run_script(SAFE_PATHS + _FOLDERS.format(root=theirs))
    assert ran.returncode != 0 and b"does not belong to root" in ran.stderr
    assert victim.parent.stat().st_uid == 0
    (theirs / "releases").unlink()
    assert run_script(SAFE_PATHS + _FOLDERS.format(root=theirs)).returncode == 0
    assert {path.stat().st_uid for path in (theirs, theirs / "releases", theirs / "incoming")} == {0}
