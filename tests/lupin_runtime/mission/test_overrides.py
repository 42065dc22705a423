"""Files of approach overrides."""

from __future__ import annotations

from pathlib import Path

import pytest

from lupin_runtime.mission.overrides import Override, OverridesError, OverridesFile, load_overrides, save_overrides


def test_load_overrides_drops_unknown_keys(tmp_path: Path) -> None:
    path = tmp_path / "overrides.yaml"
    path.write_text('overrides:\n  "41":\n    yaw: 0.75\n    standoff: 0.6\n    note: by hand\n  12: {goal_x: 1}\n')
    assert load_overrides(path) == {"41": Override(yaw=0.75, standoff=0.6), "12": Override(goal_x=1.0)}


@pytest.mark.parametrize("text", ["", "other: 1\n", "# nothing\n"])
def test_file_without_overrides_is_empty(tmp_path: Path, text: str) -> None:
    path = tmp_path / "overrides.yaml"
    path.write_text(text)
    assert load_overrides(path) == {}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("overrides:\n  - 1\n", ":2: overrides is not a mapping"),
        ("overrides: 3\n", ":1: overrides is not a mapping"),
        ('overrides:\n  "41":\n    yaw: east\n', ":3: overrides.41.yaw is 'east'"),
        ('overrides:\n  "41":\n    yaw: .nan\n', ":3: overrides.41.yaw is '.nan'"),
        ('overrides:\n  "41": [1]\n', ":2: overrides.41 is not a mapping"),
        ("overrides:\n  41: {yaw: 1\n", "not YAML"),
        ("- 1\n", ":1: the file is not a mapping"),
    ],
)
def test_invalid_override_file_error_names_the_line(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "overrides.yaml"
    path.write_text(text)
    with pytest.raises(OverridesError, match=r"overrides\.yaml") as caught:
        load_overrides(path)
    assert expected in str(caught.value)


def test_missing_override_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OverridesError, match="cannot read"):
        load_overrides(tmp_path / "nowhere.yaml")


def test_saved_overrides_are_loaded(tmp_path: Path) -> None:
    saved = {"41": Override(goal_x=1.5, goal_y=-2.0, yaw=0.5), "012": Override(standoff=0.6), "true": Override(yaw=0.0)}
    save_overrides(tmp_path / "overrides.yaml", saved)
    assert load_overrides(tmp_path / "overrides.yaml") == saved
    save_overrides(tmp_path / "overrides.yaml", {})
    assert load_overrides(tmp_path / "overrides.yaml") == {}


def test_changed_file_is_read_at_the_next_look_up(tmp_path: Path) -> None:
    path = tmp_path / "overrides.yaml"
    problems: list[str] = []
    overrides = OverridesFile(path, problems.append)
    assert overrides.get("41") is None and len(problems) == 1 and "cannot read" in problems[0]
    save_overrides(path, {"41": Override(standoff=0.6)})
    assert overrides.get("41") == Override(standoff=0.6) and dict(overrides) == {"41": Override(standoff=0.6)}
    save_overrides(path, {"7": Override(yaw=1.0)})
    assert list(overrides) == ["7"] and len(overrides) == 1 and overrides.get("41") is None


def test_damaged_file_is_reported_once_and_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "overrides.yaml"
    problems: list[str] = []
    save_overrides(path, {"41": Override(standoff=0.6)})
    overrides = OverridesFile(path, problems.append)
    path.write_text("overrides: [1]\n")
    assert [overrides.get("41"), overrides.get("41")] == [Override(standoff=0.6)] * 2
    assert len(problems) == 1 and "not a mapping" in problems[0]
    path.unlink()
    assert overrides.get("41") == Override(standoff=0.6)
    assert len(problems) == 2
