"""The file by which a replaced localization process knows where the robot is."""

from __future__ import annotations

from pathlib import Path

import pytest

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.geometry import Pose2
from lupin_runtime.slam.saved_localization import MAX_AGE_S, SavedLocalization, load_localization

NOW_NS = 10**12


def test_saved_localization_is_read_back(tmp_path: Path) -> None:
    saved = SavedLocalization(Pose2(1.5, -0.25, 3.0), False, NOW_NS)
    saved.save(tmp_path / "localization.json")
    assert load_localization(tmp_path / "localization.json") == saved


@pytest.mark.parametrize(
    ("lost", "age_s", "usable"), [(False, 0.0, True), (False, MAX_AGE_S + 1.0, False), (False, -1.0, False), (True, 0.0, False)]
)
def test_lost_or_outdated_localization_is_not_usable(lost: bool, age_s: float, usable: bool) -> None:
    assert SavedLocalization(Pose2(), lost, NOW_NS - int(age_s * 1e9)).is_usable(NOW_NS) == usable


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"map_from_odom": [1, 2], "lost": false, "saved_ns": 1}',
        '{"map_from_odom": [1, 2, NaN], "lost": false, "saved_ns": 1}',
        '{"map_from_odom": [1, 2, 1' + "0" * 400 + '], "lost": false, "saved_ns": 1}',
        '{"map_from_odom": [1, 2, 3], "lost": 0, "saved_ns": 1}',
        '{"map_from_odom": [1, 2, 3], "lost": false, "saved_ns": 1.5}',
    ],
)
def test_malformed_localization_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "localization.json").write_text(text)
    with pytest.raises(MalformedFile):
        load_localization(tmp_path / "localization.json")
