"""The arm's library survives kills, corrupt files and full disks, and keeps a backup."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.arm import Library, LibraryError, LibraryStore, StoredPose, StoredSequence, Waypoint
from lupin_runtime.arm.library import from_json, to_json, valid_name
from lupin_runtime.arm.store import default_path

FINITE = st.floats(-3, 3)
ARM = st.tuples(FINITE, FINITE, FINITE, FINITE)
GRIPPER = st.one_of(st.none(), FINITE)
NAME = st.from_regex(r"[a-z0-9][a-z0-9_-]{0,31}", fullmatch=True)
POSE = st.builds(StoredPose, ARM, GRIPPER, st.just("2030-01-02T03:04:05+00:00"), st.text(max_size=20))
SEQUENCE = st.builds(
    lambda times, arm, gripper: StoredSequence(
        "teleop", True, max(times), tuple(Waypoint(t, arm, gripper) for t in sorted(times))
    ),
    st.lists(st.floats(0, 60), min_size=1, max_size=10),
    ARM,
    GRIPPER,
)
LIBRARY = st.builds(Library, st.dictionaries(NAME, POSE, max_size=4), st.dictionaries(NAME, SEQUENCE, max_size=3))
POSE_A, POSE_B = StoredPose((0.1, 0.2, 0.3, 0.4), 0.05), StoredPose((0.0, 0.0, 0.0, 0.0))


@pytest.fixture
def store(tmp_path: Path) -> LibraryStore:
    return LibraryStore(tmp_path / "lupin" / "arm_library.json")


@given(LIBRARY)
def test_library_reading_inverts_writing(library: Any) -> None:
    assert from_json(to_json(library)) == library


def test_library_file_of_the_documented_form_is_read(tmp_path: Path) -> None:
    path = tmp_path / "arm_library.json"
    path.write_text(
        '{"version":1,"poses":{"look_left":{"arm":[0.3,0.1,-0.2,0.5],"gripper":null,'
        '"created":"2030-01-02T03:04:05+00:00","note":""}},"sequences":{}}'
    )
    assert LibraryStore(path).get("pose", "Look_Left").arm == (0.3, 0.1, -0.2, 0.5)


@pytest.mark.parametrize("name", ["a", "0", "look_left", "a" * 32, "  Wave-2  "])
def test_valid_library_names_are_accepted(name: str) -> None:
    assert valid_name(name) == name.strip().lower()


@pytest.mark.parametrize("name", ["", " ", "_a", "-a", "a" * 33, "a b", "käse", "a/b", "../x", "a\n"])
def test_invalid_library_names_are_refused(name: str) -> None:
    if name.strip().lower() == "a":
        assert valid_name(name) == "a"
    else:
        with pytest.raises(LibraryError, match="not a valid name"):
            valid_name(name)


def test_stored_entries_are_read_by_another_store(store: Any) -> None:
    store.put("pose", "Up", POSE_A, overwrite=False)
    again = LibraryStore(store.path)
    assert again.get("pose", "up") == POSE_A and again.complaint == ""


def test_existing_library_name_is_replaced_only_on_request(store: Any) -> None:
    store.put("pose", "up", POSE_A, overwrite=False)
    with pytest.raises(LibraryError, match="already"):
        store.put("pose", "UP", POSE_B, overwrite=False)
    assert store.get("pose", "up") == POSE_A
    store.put("pose", "up", POSE_B, overwrite=True)
    assert store.get("pose", "up") == POSE_B


def test_library_keeps_a_backup_of_the_previous_file(store: Any) -> None:
    store.put("pose", "a", POSE_A, overwrite=False)
    before = store.path.read_text()
    store.put("pose", "b", POSE_B, overwrite=False)
    assert store.path.with_name("arm_library.json.bak").read_text() == before


def test_library_entries_are_deleted_and_renamed(store: Any) -> None:
    store.put("pose", "a", POSE_A, overwrite=False)
    store.put("pose", "b", POSE_B, overwrite=False)
    with pytest.raises(LibraryError, match="already"):
        store.rename("pose", "a", "b")
    assert store.rename("pose", "a", "C") == "c"
    store.delete("pose", "b")
    assert LibraryStore(store.path).library.poses == {"c": POSE_A}
    with pytest.raises(LibraryError, match="there are: c"):
        store.get("pose", "a")
    with pytest.raises(LibraryError, match="expected pose or sequence"):
        store.delete("dance", "a")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        '{"version": 2}',
        '{"version": 1, "poses": []}',
        '{"version": 1, "poses": {"a": {"arm": [0, 0, 0]}}}',
        '{"version": 1, "poses": {"a": {"arm": [0, 0, 0, NaN]}}}',
        '{"version": 1, "poses": {"a": {"arm": ["0", 0, 0, 0]}}}',
        '{"version": 1, "poses": {"a b": {"arm": [0, 0, 0, 0]}}}',
        '{"version": 1, "poses": {"a": 3}}',
        '{"version": 1, "sequences": {"a": {"mode": "teleop", "include_gripper": true, "duration_s": 1, "waypoints": []}}}',
    ],
)
def test_corrupt_library_is_moved_aside_unchanged(tmp_path: Path, text: str) -> None:
    path = tmp_path / "arm_library.json"
    path.write_text(text)
    store = LibraryStore(path)
    assert store.library == Library() and "corrupt-1" in store.complaint
    assert (tmp_path / "arm_library.corrupt-1.json").read_text() == text
    path.write_text("also not")
    LibraryStore(path)
    assert (tmp_path / "arm_library.corrupt-2.json").read_text() == "also not"
    store.put("pose", "a", POSE_A, overwrite=False)
    assert LibraryStore(path).get("pose", "a") == POSE_A


def test_binary_library_file_is_corrupt(tmp_path: Path) -> None:
    path = tmp_path / "arm_library.json"
    path.write_bytes(b"\xff\xfe\x00\x01")
    assert "corrupt-1" in LibraryStore(path).complaint


class Killed(BaseException):
    """The process was killed at this point."""


# Each writes the backup first, then the library; only the library is synchronized.
STEPS = ("open", "replace", "open#2", "fsync", "replace#2")


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("after", [False, True])
def test_kill_during_writing_leaves_the_old_or_new_library(
    store: Any, monkeypatch: pytest.MonkeyPatch, step: str, after: bool
) -> None:
    store.put("pose", "a", POSE_A, overwrite=False)
    store.put("pose", "b", POSE_B, overwrite=False)
    target, _, number = step.partition("#")
    calls = {"left": int(number or 1)}
    owner: Any = Path if target == "replace" else os
    real = getattr(owner, target)

    def killed(*args: Any, **kwargs: Any) -> Any:
        calls["left"] -= 1
        if calls["left"] == 0:
            done = real(*args, **kwargs) if after else None
            if isinstance(done, int):
                os.close(done)  # as the operating system does
            raise Killed
        return real(*args, **kwargs)

    with monkeypatch.context() as patch:
        patch.setattr(owner, target, killed)
        patch.setattr(Path, "unlink", lambda *_, **__: None)  # a killed process does not clean up
        with pytest.raises(Killed):
            store.put("pose", "c", POSE_A, overwrite=False)
    survivor = LibraryStore(store.path)
    assert survivor.complaint == ""
    assert set(survivor.library.poses) in ({"a", "b"}, {"a", "b", "c"})
    survivor.put("pose", "d", POSE_A, overwrite=False)
    assert "d" in LibraryStore(store.path).library.poses


def test_unwritable_change_is_not_applied(store: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    store.put("pose", "a", POSE_A, overwrite=False)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        store.put("pose", "b", POSE_B, overwrite=False)
    monkeypatch.undo()
    assert set(store.library.poses) == set(LibraryStore(store.path).library.poses) == {"a"}


def test_unreadable_library_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "arm_library.json"
    path.mkdir()
    store = LibraryStore(path)
    assert "cannot be read" in store.complaint
    with pytest.raises(LibraryError, match="cannot be read"):
        store.put("pose", "a", POSE_A, overwrite=False)
    assert path.is_dir()


def test_library_listing_is_sorted_by_name(store: Any) -> None:
    store.put("pose", "b", POSE_B, overwrite=False)
    store.put("pose", "a", POSE_A, overwrite=False)
    store.put("sequence", "s", StoredSequence("teleop", False, 1.5, (Waypoint(0.0, (0.0,) * 4),)), overwrite=False)
    assert json.loads(store.listing()) == {
        "poses": [{"name": "a", "note": "", "has_gripper": True}, {"name": "b", "note": "", "has_gripper": False}],
        "sequences": [{"name": "s", "mode": "teleop", "duration_s": 1.5, "n_waypoints": 1, "include_gripper": False}],
    }


def test_library_file_is_in_the_user_configuration(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert default_path() == tmp_path / "lupin" / "arm_library.json"
    monkeypatch.delenv("XDG_CONFIG_HOME")
    monkeypatch.setenv("HOME", "/home/mirte")
    assert default_path() == Path("/home/mirte/.config/lupin/arm_library.json")
