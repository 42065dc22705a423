"""Releases on a real file system through a real shell: complete or absent, and only changed files are transferred."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.connection.base import Output
from lupin_cli.connection.local import LocalTarget
from lupin_cli.operations.base import OperationError
from lupin_cli.operations.release import Release, build_release
from lupin_cli.operations.release_transfer import (
    activate,
    changed_folders,
    current_manifest,
    read_installed,
    require_undamaged,
    upload,
)
from lupin_cli.playbook import find_playbook_run, play
from lupin_cli.playbook.undo import undo
from lupin_cli.release.contents import ReleaseError, RobotPlatform, release_files
from lupin_cli.release.manifest import HashCache, Manifest, build_manifest
from lupin_cli.release.signing_key import ensure_key
from lupin_cli.release.verify_release import ABOUT, SIGNED
from tests.support.operation_cycle import examine

PLATFORM = RobotPlatform(os.uname().machine, sys.version_info[:2], "")
Make = Callable[..., Manifest]
NOBODY = 65534
pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to whom releases belong")


@pytest.fixture(autouse=True)
def signers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make a release key, and return the list that trusts it, which `deploy` and `this_release` use."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    path = tmp_path / "signers"
    path.write_text(ensure_key().public.signers_line)
    return path


@pytest.fixture
def target() -> Iterator[LocalTarget]:
    local = LocalTarget("robot")
    yield local
    local.close()


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """Return a function that builds the manifest of a small release: `make(name=content, …)`."""

    def build(**contents: str) -> Manifest:
        named = {path.replace("_", "/"): text for path, text in contents.items()}
        sources = []
        for path, text in named.items():
            source = tmp_path / "sources" / sha256(text.encode()).hexdigest() / path
            source.parent.mkdir(parents=True, exist_ok=True)
            source.write_text(text)
            sources.append((path, str(source)))
        return build_manifest(sources, HashCache(tmp_path / "hashes.json"))

    return build


def deploy(target: FragileTarget | LocalTarget, root: Path, manifest: Manifest) -> None:
    state = replace(read_installed(target, str(root)), robot=PLATFORM)
    upload(target, state, manifest, ensure_key(), str(root), str(root.parent / "signers"))
    activate(target, manifest.id, str(root))


def release_of(root: Path, **arguments: Any) -> Release:
    return Release(root=str(root), signers=str(root.parent / "signers"), **arguments)


def contents_of(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): path.read_text()
        for path in folder.rglob("*")
        if path.is_file() and not path.is_symlink() and path.name not in ABOUT
    }


def test_releases_with_the_same_files_have_the_same_id(make: Make) -> None:
    assert make(a="1", b="2").id == make(b="2", a="1").id
    assert make(a="1", b="2").id != make(a="2", b="1").id


@pytest.mark.parametrize("path", ["/etc/passwd", "a/../../b", "two\nlines"])
def test_path_outside_the_release_is_refused(path: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="cannot be a path"):
        build_manifest([(path, b"x")], HashCache(tmp_path / "h"))


def test_hash_cache_notices_changes_and_survives_damage(tmp_path: Path) -> None:
    file, cache = tmp_path / "f", tmp_path / "cache.json"
    file.write_text("one")
    first = build_manifest([("f", str(file))], HashCache(cache))
    file.write_text("two")
    assert build_manifest([("f", str(file))], HashCache(cache)).id != first.id
    cache.write_text('{"torn')
    file.write_text("one")
    assert build_manifest([("f", str(file))], HashCache(cache)).id == first.id


def test_deployed_release_is_complete_and_current(target: LocalTarget, make: Make, tmp_path: Path) -> None:
    root = tmp_path / "opt"
    release = make(bin_tool="#!/bin/sh\n", lib_a="x" * 100, lib_b="x" * 100)
    deploy(target, root, release)
    assert contents_of(root / "current") == {"bin/tool": "#!/bin/sh\n", "lib/a": "x" * 100, "lib/b": "x" * 100}
    assert read_installed(target, str(root)).current == release.id
    assert not list((root / "incoming").iterdir())
    # Equal contents were transferred once.
    assert (root / "current/lib/a").stat().st_ino == (root / "current/lib/b").stat().st_ino


def test_next_release_transfers_changes_and_keeps_the_previous(target: LocalTarget, make: Make, tmp_path: Path) -> None:
    root = tmp_path / "opt"
    first = make(a="one", b="same", c="gone")
    deploy(target, root, first)
    before = contents_of(root / f"releases/{first.id}")
    second = make(a="two", b="same", d="new")
    old_manifest = current_manifest(target, read_installed(target, str(root)), str(root))
    lines, size = changed_folders(old_manifest, second)
    assert lines == ["-2 files in .", "+2 files in ., 0.0 MB"]
    assert size == 6
    deploy(target, root, second)
    assert contents_of(root / "current") == {"a": "two", "b": "same", "d": "new"}
    assert contents_of(root / f"releases/{first.id}") == before
    assert read_installed(target, str(root)).previous == first.id
    assert (root / f"releases/{first.id}/b").stat().st_ino == (root / "current/b").stat().st_ino


class LinkCut(Exception):
    """The link is cut."""


class FragileTarget(LocalTarget):
    """Runs `calls` scripts completely; the next one is cut off after the fraction `share` of its input."""

    def __init__(self, calls: int, share: float) -> None:
        super().__init__("robot")
        self.calls, self.share = calls, share

    def run(self, script: str, *, stdin: bytes = b"", **options: Any) -> Output:
        if self.calls == 0:
            super().run(script, stdin=stdin[: int(len(stdin) * self.share)], **options)
            raise LinkCut
        self.calls -= 1
        return super().run(script, stdin=stdin, **options)


@pytest.mark.parametrize("share", [0.0, 0.6])
@pytest.mark.parametrize("calls", range(5))
def test_interrupted_deploy_keeps_previous_release_and_resumes(
    calls: int,
    share: float,
    target: LocalTarget,
    make: Make,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("lupin_cli.operations.release_transfer.CHUNK_BYTES", 3000)
    root = tmp_path / "opt"
    first = make(a="one", b="same")
    deploy(target, root, first)
    contents = {f"f{n}": os.urandom(800).hex() for n in range(5)}
    second = make(b="same", **contents)
    before = contents_of(root / "current")
    fragile = FragileTarget(calls, share)
    with pytest.raises((LinkCut, OperationError)):
        deploy(fragile, root, second)
    fragile.close()
    now = read_installed(target, str(root)).current
    assert now in (first.id, second.id)
    assert contents_of(root / "current") == (before if now == first.id else {"b": "same", **contents})
    deploy(target, root, second)
    assert contents_of(root / "current") == {"b": "same", **contents}
    assert contents_of(root / f"releases/{first.id}") == before


def test_damaged_incoming_file_is_sent_again(target: LocalTarget, make: Make, tmp_path: Path) -> None:
    root = tmp_path / "opt"
    deploy(target, root, make(a="one"))
    second = make(a="two", b="long " * 50)
    folder = root / "incoming" / second.id
    folder.mkdir(parents=True)
    (folder / "b").write_text("half")
    (folder / "stray").write_text("unknown")
    deploy(target, root, second)
    assert contents_of(root / "current") == {"a": "two", "b": "long " * 50}


def test_old_releases_are_removed_but_not_the_previous(target: LocalTarget, make: Make, tmp_path: Path) -> None:
    root = tmp_path / "opt"
    releases = [make(a=str(n)) for n in range(7)]
    for release in releases:
        deploy(target, root, release)
    state = read_installed(target, str(root))
    assert state.current == releases[-1].id
    assert state.previous == releases[-2].id
    assert state.previous in state.releases
    assert len(state.releases) <= 4


def test_full_disk_is_reported_before_anything_is_sent(target: LocalTarget, make: Make, tmp_path: Path) -> None:
    root = tmp_path / "opt"
    state = replace(read_installed(target, str(root)), robot=PLATFORM, free_bytes=10)
    with pytest.raises(OperationError, match="MB free"):
        upload(target, state, make(a="one"), ensure_key(), str(root))
    assert not (root / "current").exists()


def test_kept_release_is_activated_and_undone(target: LocalTarget, make: Make, tmp_path: Path) -> None:
    root = tmp_path / "opt"
    first, second = make(a="one"), make(a="two")
    deploy(target, root, first)
    deploy(target, root, second)
    back = release_of(root, release=first.id)
    difference = examine(back, target)
    assert difference is not None
    back.change(target, difference)
    assert examine(back, target) is None
    assert contents_of(root / "current") == {"a": "one"}
    back.undo(target, difference.before)
    assert contents_of(root / "current") == {"a": "two"}
    with pytest.raises(OperationError, match="has no release cafe"):
        examine(release_of(root, release="cafe"), target)


def test_undo_does_not_take_away_a_newer_release(
    target: LocalTarget, make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, journal = tmp_path / "opt", tmp_path / "journal"
    before, mine, theirs = make(a="one"), make(a="two"), make(a="three")
    monkeypatch.setattr("lupin_cli.operations.release.build_release", lambda _: mine)
    deploy(target, root, before)
    book = tmp_path / "book.yaml"
    step = f"steps:\n- name: install\n  release: {{root: {root}, signers: {tmp_path}/signers}}\n"
    book.write_text(f"name: book\ndescription: A test.\n{step}")
    run = find_playbook_run(play(book, {"robot": target}, journal=journal).run, journal)
    deploy(target, root, theirs)
    refused = undo(run, {"robot": target}, journal=journal)
    assert refused.message.startswith("install: changed since the run: the robot's current release; --force"), refused
    assert read_installed(target, str(root)).current == theirs.id
    assert undo(run, {"robot": target}, journal=journal, force=True).state == "done"
    assert read_installed(target, str(root)).current == before.id


@pytest.mark.parametrize("damage", ["edited", "forged", "removed", "manifest", "link", "symlink", "folder"])
def test_damaged_release_is_installed_again(
    damage: str, target: LocalTarget, make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "opt"
    older, release = make(a="one", b="same"), make(a="two", b="same")
    monkeypatch.setattr("lupin_cli.operations.release.build_release", lambda _: release)
    deploy(target, root, older)
    deploy(target, root, release)
    operation = release_of(root)
    assert examine(operation, target) is None
    folder = root / "releases" / release.id
    if damage == "edited":
        (folder / "b").write_text("tamE")  # of the same size
    elif damage == "forged":
        (folder / "a").unlink()
        (folder / "a").write_text("evil")
        lines = [f"{sha256((folder / name).read_bytes()).hexdigest()}  {name}\n" for name in ("a", "b")]
        (folder / "manifest").write_text("".join(lines))
    elif damage == "link":
        folder.rename(tmp_path / "elsewhere")
    else:
        (folder / {"removed": "a", "manifest": "manifest"}.get(damage, "b")).unlink()
    if damage == "symlink":
        (folder / "b").symlink_to(root / "releases" / older.id / "b")  # with the content that was signed
    elif damage == "folder":
        (folder / "b").mkdir()
        (folder / "b" / "added").write_text("")
    difference = examine(operation, target)
    assert difference is not None and difference.summary.startswith(f"install release {release.id} again, because of damaged")
    operation.change(target, difference)
    assert examine(operation, target) is None and contents_of(root / "current") == {"a": "two", "b": "same"}
    assert not list((root / "incoming").iterdir())
    # The older release shares the inode of a file that did not change. It is checked before it becomes current.
    back = release_of(root, release=older.id)
    back_difference = examine(back, target)
    assert back_difference is not None
    if damage == "edited":
        with pytest.raises(OperationError, match=rf"the release {older.id} on robot is damaged: b \(changed\)"):
            back.change(target, back_difference)
    else:
        back.change(target, back_difference)
        assert contents_of(root / "current") == {"a": "one", "b": "same"}


def test_release_of_another_user_is_signed_but_not_reused(
    target: LocalTarget, make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # As earlier versions of Lupin left it: unsigned, and the robot's user may change its files through any other link to them.
    root = tmp_path / "opt"
    release = make(a="one", b="two")
    monkeypatch.setattr("lupin_cli.operations.release.build_release", lambda _: release)
    deploy(target, root, release)
    folder = root / "releases" / release.id
    (folder / SIGNED).unlink()
    for path in (root, root / "releases", root / "incoming", folder, *folder.iterdir()):
        os.chown(path, NOBODY, NOBODY)
    inode = (folder / "a").stat().st_ino
    operation = release_of(root)
    difference = examine(operation, target)
    assert difference is not None and difference.summary == f"install release {release.id} again, because it is not signed"
    with pytest.raises(OperationError, match=f"the release {release.id} on robot is not signed"):
        require_undamaged(target, release.id, str(root), str(tmp_path / "signers"))
    operation.change(target, difference)
    assert examine(operation, target) is None
    assert {path.lstat().st_uid for path in (root, *root.rglob("*"))} == {0} and (folder / "a").stat().st_ino != inode


def test_release_that_no_trusted_key_signed_is_not_published(
    target: LocalTarget, make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "opt"
    first, second = make(a="one"), make(a="two")
    deploy(target, root, first)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "another operator"))
    with pytest.raises(
        OperationError, match=r"could not verify the release on robot: .*signed\.sig \(made by a key that is not in"
    ):
        deploy(target, root, second)
    state = read_installed(target, str(root))
    assert (state.current, state.releases) == (first.id, (first.id,))
    assert contents_of(root / "current") == {"a": "one"}


def test_undo_returns_to_an_unsigned_but_no_damaged_release(
    target: LocalTarget, make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "opt"
    first, second = make(a="one"), make(a="two")
    monkeypatch.setattr("lupin_cli.operations.release.build_release", lambda _: second)
    deploy(target, root, first)
    operation = release_of(root)
    difference = examine(operation, target)
    assert difference is not None
    operation.change(target, difference)
    old = root / "releases" / first.id
    (old / "a").unlink()
    with pytest.raises(OperationError, match=rf"the release {first.id} on robot is damaged: a \(missing\)"):
        operation.undo(target, difference.before)
    assert read_installed(target, str(root)).current == second.id
    (old / SIGNED).unlink()
    operation.undo(target, difference.before)
    assert read_installed(target, str(root)).current == first.id


def test_damaged_byte_code_is_found(target: LocalTarget, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = tmp_path / "opt"
    release = build_manifest([("venv/lib/m.py", b"x = 1\n")], HashCache(tmp_path / "h"))
    monkeypatch.setattr("lupin_cli.operations.release.build_release", lambda _: release)
    deploy(target, root, release)
    operation = release_of(root)
    assert examine(operation, target) is None
    (compiled,) = (root / "current").rglob("*.pyc")
    compiled.write_bytes(compiled.read_bytes()[:-3] + b"???")
    difference = examine(operation, target)
    assert difference is not None and compiled.name in difference.summary
    operation.change(target, difference)
    assert examine(operation, target) is None


def test_forced_release_is_installed_again_once(
    target: LocalTarget, make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "opt"
    release = make(a="one")
    monkeypatch.setattr("lupin_cli.operations.release.build_release", lambda _: release)
    deploy(target, root, release)
    inode = (root / "releases" / release.id).stat().st_ino
    operation = release_of(root, force=True)
    difference = examine(operation, target)
    assert difference is not None and difference.summary == f"install release {release.id} again, as asked"
    operation.change(target, difference)
    assert (root / "releases" / release.id).stat().st_ino != inode
    assert examine(operation.with_baseline(difference.before), target) is None


def test_real_release_runs_and_second_deploy_changes_nothing(target: LocalTarget, tmp_path: Path) -> None:
    state = read_installed(target, str(tmp_path))
    if state.robot.ros or state.robot.python != PLATFORM.python:
        pytest.skip(
            f"needs a system python3 {PLATFORM.python[0]}.{PLATFORM.python[1]} and no ROS; this machine has {state.robot}"
        )
    operation = release_of(tmp_path / "opt")
    difference = examine(operation, target)
    assert difference is not None
    assert "the first one" in difference.summary
    operation.change(target, difference)
    assert examine(operation, target) is None
    python = tmp_path / "opt/current/venv/bin/python3"
    program = (
        "import sys, lupin_runtime.stack.onboard as m, rclpy, lupin_msgs.msg; print(m.__file__, rclpy.__file__, sys.prefix)"
    )
    clean = {"PATH": "/usr/bin:/bin", "HOME": str(tmp_path)}
    printed = subprocess.run(
        [str(python), "-c", program], env=clean, capture_output=True, text=True, timeout=60, check=True, cwd=tmp_path
    ).stdout
    assert [word for word in printed.split() if not word.startswith(str(tmp_path / "opt"))] == []


def test_release_for_robot_with_ros_has_interface_sources_only() -> None:
    robot = RobotPlatform("aarch64", (3, 10), "humble")
    paths = dict(release_files(robot))
    assert "ws/src/lupin_msgs/package.xml" in paths
    assert any(path.endswith("lupin_runtime/stack/onboard.py") for path in paths)
    assert not any("rclpy/" in path or path.endswith(".so") for path in paths)
    assert b"include-system-site-packages = true" in paths["venv/pyvenv.cfg"]
    assert json.loads(paths["release.json"])["machine"] == "aarch64"


def test_impossible_release_is_refused_with_the_reason() -> None:
    with pytest.raises(ReleaseError, match="a robot without ROS gets the packages of this machine"):
        list(release_files(RobotPlatform("aarch64", PLATFORM.python, "")))
    with pytest.raises(ReleaseError, match=r"Python 3\.10 or newer"):
        list(release_files(RobotPlatform("x86_64", (3, 8), "")))
    with pytest.raises(OperationError, match="no release can be built"):
        build_release(RobotPlatform("riscv64", (3, 11), ""))


def test_file_changed_during_the_build_is_named(target: LocalTarget, make: Make, tmp_path: Path) -> None:
    release = make(a="one")
    source = release.entries[0].source
    assert isinstance(source, str)
    Path(source).write_text("two")
    with pytest.raises(OperationError, match="changed while the release was built"):
        deploy(target, tmp_path / "opt", release)
    assert not (tmp_path / "opt/current").exists()
