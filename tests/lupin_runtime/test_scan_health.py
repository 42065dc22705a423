"""The verdict on one scan."""

from __future__ import annotations

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_runtime.scan_health import ScanHealth, ScanJudge


def test_equal_ranges_are_repeated_at_rest_and_frozen_in_motion() -> None:
    judge = ScanJudge()
    a, b = np.linspace(1, 2, 40), np.linspace(1, 2.1, 40)
    assert judge.judge(a, True, Pose2()) is ScanHealth.GOOD
    assert judge.judge(a, True, Pose2(0.001)) is ScanHealth.REPEATED
    assert judge.judge(a, True, Pose2(0.5)) is ScanHealth.FROZEN
    assert judge.judge(a, True, Pose2(0.0, 0.0, 0.3)) is ScanHealth.FROZEN
    assert judge.judge(b, True, Pose2(0.6)) is ScanHealth.GOOD


def test_scan_with_too_few_returns_is_blind() -> None:
    judge = ScanJudge()
    ranges = np.linspace(1, 2, 40)
    assert judge.judge(ranges, True, Pose2(0.6)) is ScanHealth.GOOD
    assert judge.judge(ranges * np.nan, False, Pose2(0.6)) is ScanHealth.BLIND
