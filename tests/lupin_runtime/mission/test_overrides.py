"""Files of approach overrides."""

from __future__ import annotations

from pathlib import Path

import pytest

from lupin_runtime.mission.overrides import Override, OverridesError, load_overrides


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
