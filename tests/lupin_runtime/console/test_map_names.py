"""Clients' maps are saved in one folder, whatever their names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime import graph
from lupin_runtime.console.map_names import BadMapName, maps_folder, with_map_path

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


@given(st.text())
def test_no_name_leads_out_of_the_folder(name: str) -> None:
    try:
        path = Path(with_map_path(SERIALIZE, {"filename": name})["filename"])
    except BadMapName:
        return
    assert path.resolve().parent == maps_folder().resolve()


def test_arguments_of_other_services_are_unchanged() -> None:
    assert with_map_path("/mission/start", {"name": "../x"}) == {"name": "../x"}
