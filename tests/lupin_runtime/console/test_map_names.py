"""Clients' maps are saved in one folder, whatever their names."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime import graph
from lupin_runtime.console.map_names import BadMapName, delete_map, maps_folder, saved_maps, with_map_path

SAVE, SERIALIZE, LOAD = graph.SLAM_SAVE_MAP.name, graph.SLAM_SERIALIZE.name, graph.SLAM_DESERIALIZE.name


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


def test_plain_name_is_a_file_in_the_folder() -> None:
    assert with_map_path(SAVE, {"name": {"data": "demo day.2"}}) == {"name": {"data": str(maps_folder() / "demo day.2")}}
    assert with_map_path(SERIALIZE, {"filename": "house"}) == {"filename": str(maps_folder() / "house")}
    assert maps_folder().is_dir()
    loading = with_map_path(LOAD, {"filename": "house", "match_type": 1})
    assert loading == {"filename": str(maps_folder() / "house"), "match_type": 1}


@pytest.mark.parametrize(
    "name", ["", ".", "..", ".bashrc", "../x", "/etc/x", "~/x", "a/b", "a\0b", "a\n", "x" * 65, None, 3, {}, []]
)
def test_names_that_are_not_plain_are_refused(name: Any) -> None:
    for service, arguments in ((SAVE, {"name": {"data": name}}), *((each, {"filename": name}) for each in (SERIALIZE, LOAD))):
        with pytest.raises(BadMapName, match="map's name"):
            with_map_path(service, arguments)
    for malformed in (None, [], [name], {}, {"name": name}):
        with pytest.raises(BadMapName):
            with_map_path(SAVE, malformed)


def write_map(name: str, *suffixes: str) -> None:
    maps_folder().mkdir(parents=True, exist_ok=True)
    for suffix in suffixes:
        if suffix == ".posegraph":
            with zipfile.ZipFile(maps_folder() / f"{name}{suffix}", "w") as file:
                file.writestr("poses.npy", b"x")
        else:
            (maps_folder() / f"{name}{suffix}").write_text("x")


def test_maps_are_listed_by_what_can_be_done_with_them() -> None:
    assert saved_maps() == []
    write_map("hall 2", ".yaml", ".pgm", ".posegraph")
    write_map("old", ".yaml", ".pgm")
    write_map("graph", ".posegraph")
    write_map("not; a name", ".yaml")
    write_map("note", ".txt")
    (maps_folder() / "folder.yaml").mkdir()
    rows = [(each.name, each.is_loadable, each.yaml) for each in saved_maps()]
    assert rows == [
        ("graph", True, None),
        ("hall 2", True, maps_folder() / "hall 2.yaml"),
        ("old", False, maps_folder() / "old.yaml"),
    ]


def test_deleting_takes_the_files_of_one_map() -> None:
    write_map("hall", ".yaml", ".pgm", ".posegraph", ".txt")
    write_map("hall.2", ".yaml", ".pgm")
    delete_map("hall")
    assert sorted(path.name for path in maps_folder().iterdir()) == ["hall.2.pgm", "hall.2.yaml", "hall.txt"]
    with pytest.raises(FileNotFoundError):
        delete_map("hall")


def test_deleting_follows_no_link_out_of_the_folder(tmp_path: Path) -> None:
    write_map("hall", ".pgm")
    outside = tmp_path / "other.yaml"
    outside.write_text("x")
    (maps_folder() / "hall.yaml").symlink_to(outside)
    delete_map("hall")
    assert outside.read_text() == "x" and not list(maps_folder().iterdir())


@given(st.one_of(st.text(), st.sampled_from(["../x", "/etc/passwd", "..", "a/b", "", None, 3])))
def test_deleting_takes_nothing_by_a_name_that_is_not_listed(name: Any) -> None:
    write_map("kept", ".yaml", ".pgm")
    if name == "kept":
        return
    with pytest.raises((BadMapName, FileNotFoundError)):
        delete_map(name)
    assert len(list(maps_folder().iterdir())) == 2


@given(st.text())
def test_no_name_leads_out_of_the_folder(name: str) -> None:
    try:
        path = Path(with_map_path(SERIALIZE, {"filename": name})["filename"])
    except BadMapName:
        return
    assert path.resolve().parent == maps_folder().resolve()


def test_arguments_of_other_services_are_unchanged() -> None:
    assert with_map_path("/mission/start", {"name": "../x"}) == {"name": "../x"}
