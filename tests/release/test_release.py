"""A release on a real file system, through a real shell: whole or not at all, and only what changed travels."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import pytest

from lupin_cli.operations.base import OperationError
from lupin_cli.operations.release import Release, built
from lupin_cli.release.contents import CannotBuild, Robot, files
from lupin_cli.release.manifest import Hashes, manifest_of
from lupin_cli.release.transfer import activate, changes, installed, upload
from lupin_cli.target.base import Output
from lupin_cli.target.local import LocalTarget

HERE = Robot(os.uname().machine, sys.version_info[:2], "")


@pytest.fixture
def target():
    with_close = LocalTarget("robot")
    yield with_close
    with_close.close()


@pytest.fixture
def make(tmp_path):
    """Manifests of small releases: `make(name=content, …)`."""

    def made(**contents: str):
        named = {path.replace("_", "/"): text for path, text in contents.items()}
        sources = []
        for path, text in named.items():
            source = tmp_path / "sources" / sha256(text.encode()).hexdigest() / path
            source.parent.mkdir(parents=True, exist_ok=True)
            source.write_text(text)
            sources.append((path, str(source)))
        return manifest_of(sources, Hashes(tmp_path / "hashes.json"))

    return made


def put(target, root, manifest):
    state = replace(installed(target, str(root)), robot=HERE)
    upload(target, state, manifest, str(root))
    activate(target, manifest.id, str(root))


def content(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): path.read_text()
        for path in folder.rglob("*")
        if path.is_file() and not path.is_symlink() and path.name != "manifest"
    }


def test_two_releases_of_the_same_files_have_one_name(make):
    assert make(a="1", b="2").id == make(b="2", a="1").id
    assert make(a="1", b="2").id != make(a="2", b="1").id


@pytest.mark.parametrize("path", ["/etc/passwd", "a/../../b", "two\nlines"])
def test_a_path_that_leaves_the_release_is_refused(path, tmp_path):
    with pytest.raises(ValueError, match="can't be a path"):
        manifest_of([(path, b"x")], Hashes(tmp_path / "h"))


def test_the_memory_of_hashes_sees_a_changed_file_and_survives_its_own_ruin(tmp_path):
    file, cache = tmp_path / "f", tmp_path / "cache.json"
    file.write_text("one")
    first = manifest_of([("f", str(file))], Hashes(cache))
    file.write_text("two")
    assert manifest_of([("f", str(file))], Hashes(cache)).id != first.id
    cache.write_text('{"torn')
    file.write_text("one")
    assert manifest_of([("f", str(file))], Hashes(cache)).id == first.id


def test_a_release_arrives_whole_and_is_current(target, make, tmp_path):
    root = tmp_path / "opt"
    release = make(bin_tool="#!/bin/sh\n", lib_a="x" * 100, lib_b="x" * 100)
    put(target, root, release)
    assert content(root / "current") == {"bin/tool": "#!/bin/sh\n", "lib/a": "x" * 100, "lib/b": "x" * 100}
    assert installed(target, str(root)).current == release.id
    assert not list((root / "incoming").iterdir())
    # Equal contents travelled once.
    assert (root / "current/lib/a").stat().st_ino == (root / "current/lib/b").stat().st_ino


def test_the_next_release_brings_what_changed_and_leaves_the_one_before_untouched(target, make, tmp_path):
    root = tmp_path / "opt"
    first = make(a="one", b="same", c="gone")
    put(target, root, first)
    before = content(root / f"releases/{first.id}")
    second = make(a="two", b="same", d="new")
    lines, size = changes(target, installed(target, str(root)), second, str(root))
    assert lines == ["-a", "+a  3 bytes", "-c", "+d  3 bytes"]
    assert size == 6
    put(target, root, second)
    assert content(root / "current") == {"a": "two", "b": "same", "d": "new"}
    assert content(root / f"releases/{first.id}") == before
    assert installed(target, str(root)).previous == first.id
    assert (root / f"releases/{first.id}/b").stat().st_ino == (root / "current/b").stat().st_ino


class Cut(Exception):
    """The link goes."""


class FragileTarget(LocalTarget):
    """Lets `calls` scripts through; the next one is cut after `share` of its input."""

    def __init__(self, calls: int, share: float) -> None:
        super().__init__("robot")
        self.calls, self.share = calls, share

    def run(self, script: str, *, stdin: bytes = b"", **options) -> Output:
        if self.calls == 0:
            super().run(script, stdin=stdin[: int(len(stdin) * self.share)], **options)
            raise Cut
        self.calls -= 1
        return super().run(script, stdin=stdin, **options)


@pytest.mark.parametrize("share", [0.0, 0.6])
@pytest.mark.parametrize("calls", range(4))
def test_a_deploy_cut_anywhere_leaves_the_release_before_it_and_the_next_one_ends_it(
    calls, share, target, make, tmp_path, monkeypatch
):
    monkeypatch.setattr("lupin_cli.release.transfer.CHUNK_BYTES", 3000)
    root = tmp_path / "opt"
    first = make(a="one", b="same")
    put(target, root, first)
    contents = {f"f{n}": os.urandom(800).hex() for n in range(6)}
    second = make(b="same", **contents)
    before = content(root / "current")
    fragile = FragileTarget(calls, share)
    with pytest.raises((Cut, OperationError)):
        put(fragile, root, second)
    fragile.close()
    now = installed(target, str(root)).current
    assert now in (first.id, second.id)
    assert content(root / "current") == (before if now == first.id else {"b": "same", **contents})
    put(target, root, second)
    assert content(root / "current") == {"b": "same", **contents}
    assert content(root / f"releases/{first.id}") == before


def test_a_file_that_rotted_on_the_way_is_sent_again(target, make, tmp_path):
    root = tmp_path / "opt"
    put(target, root, make(a="one"))
    second = make(a="two", b="long " * 50)
    folder = root / "incoming" / second.id
    folder.mkdir(parents=True)
    (folder / "b").write_text("half")
    (folder / "stray").write_text("of nobody")
    put(target, root, second)
    assert content(root / "current") == {"a": "two", "b": "long " * 50}


def test_old_releases_are_removed_but_never_the_one_before(target, make, tmp_path):
    root = tmp_path / "opt"
    releases = [make(a=str(n)) for n in range(7)]
    for release in releases:
        put(target, root, release)
    state = installed(target, str(root))
    assert state.current == releases[-1].id
    assert state.previous == releases[-2].id
    assert state.previous in state.releases
    assert len(state.releases) <= 4


def test_a_full_disk_is_said_before_anything_is_sent(target, make, tmp_path):
    root = tmp_path / "opt"
    state = replace(installed(target, str(root)), robot=HERE, free_bytes=10)
    with pytest.raises(OperationError, match="MB free"):
        upload(target, state, make(a="one"), str(root))
    assert not (root / "current").exists()


def test_going_back_to_a_kept_release_and_to_none(target, make, tmp_path):
    root = tmp_path / "opt"
    first, second = make(a="one"), make(a="two")
    put(target, root, first)
    put(target, root, second)
    back = Release(release=first.id, root=str(root))
    difference = back.differs(target)
    assert difference is not None
    back.change(target, difference)
    assert back.differs(target) is None
    assert content(root / "current") == {"a": "one"}
    back.undo(target, difference.before)
    assert content(root / "current") == {"a": "two"}
    with pytest.raises(OperationError, match="has no release cafe"):
        Release(release="cafe", root=str(root)).differs(target)


def test_the_real_release_runs_where_it_lands_and_its_second_deploy_changes_nothing(target, tmp_path):
    state = installed(target, str(tmp_path))
    if state.robot.ros or state.robot.python != HERE.python:
        pytest.skip(f"needs a system python3 {HERE.python[0]}.{HERE.python[1]} and no ROS; this machine has {state.robot}")
    operation = Release(root=str(tmp_path / "opt"))
    difference = operation.differs(target)
    assert difference is not None
    assert "is the first" in difference.summary
    operation.change(target, difference)
    assert operation.differs(target) is None
    python = tmp_path / "opt/current/venv/bin/python3"
    program = (
        "import sys, lupin_runtime.stack.onboard as m, rclpy, lupin_msgs.msg; print(m.__file__, rclpy.__file__, sys.prefix)"
    )
    clean = {"PATH": "/usr/bin:/bin", "HOME": str(tmp_path)}
    said = subprocess.run(
        [str(python), "-c", program], env=clean, capture_output=True, text=True, timeout=60, check=True, cwd=tmp_path
    ).stdout
    assert [word for word in said.split() if not word.startswith(str(tmp_path / "opt"))] == []


def test_a_release_for_a_robot_with_ros_carries_no_wheels_and_the_sources_of_the_interfaces():
    robot = Robot("aarch64", (3, 10), "humble")
    paths = dict(files(robot))
    assert "ws/src/lupin_msgs/package.xml" in paths
    assert any(path.endswith("lupin_runtime/stack/onboard.py") for path in paths)
    assert not any("rclpy/" in path or path.endswith(".so") for path in paths)
    assert b"include-system-site-packages = true" in paths["venv/pyvenv.cfg"]
    assert json.loads(paths["release.json"])["machine"] == "aarch64"


def test_a_robot_that_can_get_no_release_is_told_why():
    with pytest.raises(CannotBuild, match="without ROS the robot runs the packages of this machine"):
        list(files(Robot("aarch64", HERE.python, "")))
    with pytest.raises(CannotBuild, match=r"Python 3\.10 or newer"):
        list(files(Robot("x86_64", (3, 8), "")))
    with pytest.raises(OperationError, match="no release can be made"):
        built(Robot("riscv64", (3, 11), ""))


def test_a_file_that_changes_while_the_release_is_made_is_named(target, make, tmp_path):
    release = make(a="one")
    Path(release.entries[0].source).write_text("two")
    with pytest.raises(OperationError, match="changed while the release was made"):
        put(target, tmp_path / "opt", release)
    assert not (tmp_path / "opt/current").exists()
