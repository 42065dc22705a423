"""The time budget of a camera's frames: which parts are searched at which resolution, and what the last frame is for."""

from __future__ import annotations

from collections.abc import Iterable
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
import pytest

from lupin_runtime.perception import tags
from lupin_runtime.perception.frame_detector import PARTS, FrameDetector, smooth_low_contrast

if TYPE_CHECKING:
    from lupin_runtime.perception.tags import Found
    from tests.support.tag_views import View

BUDGET_S = 0.012


class NearSightedEngine:
    """The real engine, which misses every tag below full resolution, on a clock that counts `cost_s` per busy frame."""

    name = "near-sighted"
    family = tags.FAMILY
    decimations = tags.DECIMATIONS

    def __init__(self, cost_s: float) -> None:
        self.engine, self.cost_s = tags.make_engine("apriltag"), cost_s
        self.now_s = 0.0
        self.searched: list[tuple[tuple[int, ...], float]] = []

    def clock(self) -> float:
        return self.now_s

    def find(self, gray: np.ndarray, decimation: float = 1.0) -> Iterable[Found]:
        self.searched.append((gray.shape, decimation))
        self.now_s += self.cost_s * gray.size / (640 * 480) / decimation**2
        return self.engine.find(gray) if decimation == 1.0 else []

    def whole_frames(self) -> list[float]:
        return [decimation for shape, decimation in self.searched if shape == (480, 640)]


@pytest.fixture(scope="module")
def leafy_view(tag_views: ModuleType) -> View:
    view: View = tag_views.at_range(40, 1.2, 0.3, np.random.default_rng(5), background="leaves")
    return view


def make(cost_s: float) -> tuple[FrameDetector, NearSightedEngine]:
    engine = NearSightedEngine(cost_s)
    return FrameDetector(engine, BUDGET_S, engine.clock), engine


def test_plain_frame_is_searched_once_at_full_resolution(tag_views: ModuleType) -> None:
    view = tag_views.at_range(11, 1.0, 0.2, np.random.default_rng(3))
    detector, engine = make(0.003)
    assert [found.id for found in detector.detect(view.image)] == [11]
    assert engine.searched == [((480, 640), 1.0)]


@pytest.mark.parametrize("cost_s", [0.013, 0.03, 0.06])
def test_busy_frames_of_any_machine_fit_the_budget(leafy_view: View, cost_s: float) -> None:
    """The resolution follows the time that the last frames took."""
    detector, engine = make(cost_s)
    spent_s = []
    for _ in range(12):
        began_s = engine.now_s
        detector.detect(leafy_view.image)
        spent_s.append(engine.now_s - began_s)
    assert max(spent_s[6:]) <= BUDGET_S
    assert set(engine.whole_frames()[6:]) <= {1.5, 2.0, 3.0}


def test_fast_machine_searches_busy_frames_at_full_resolution(leafy_view: View) -> None:
    detector, engine = make(0.002)
    for _ in range(6):
        detector.detect(leafy_view.image)
    assert engine.whole_frames()[-1] == 1.0


def test_every_part_is_searched_at_full_resolution_in_turn(leafy_view: View) -> None:
    """A tag that the whole frame hides at a lower resolution is found in a part, and then followed from frame to frame."""
    detector, engine = make(0.015)
    results = [[found.id for found in detector.detect(leafy_view.image)] for _ in range(3 * PARTS[0] * PARTS[1])]
    parts = [shape for shape, decimation in engine.searched if decimation == 1.0 and shape != (480, 640)]
    assert 1.0 not in engine.whole_frames() and len(parts) >= PARTS[0] * PARTS[1]
    first = results.index([40])
    assert first <= 2 * PARTS[0] * PARTS[1]
    assert all(ids == [40] for ids in results[first:]), "the tag is searched where it was"


def test_tag_is_followed_while_the_camera_moves(tag_views: ModuleType, leafy_view: View) -> None:
    detector, engine = make(0.015)
    detector._last = tags.detect(leafy_view.image, engine.engine)
    for step in range(1, 6):
        moved = leafy_view.translation + np.array([0.02 * step, 0.0, -0.02 * step])
        view = tag_views.render(40, leafy_view.rotation, moved, np.random.default_rng(step), background="leaves")
        (found,) = detector.detect(view.image)
        assert np.abs(found.corners - view.corners).max() < 0.5


def test_no_time_left_means_no_search_of_parts(leafy_view: View) -> None:
    detector, engine = make(0.5)
    for _ in range(10):
        detector.detect(leafy_view.image)
    assert engine.searched[-4:] == [((480, 640), 3.0)] * 4


def test_clock_that_stands_still_changes_nothing(leafy_view: View) -> None:
    engine = tags.make_engine("apriltag")
    detector = FrameDetector(engine, BUDGET_S, lambda: 0.0)
    for _ in range(3):
        assert [found.id for found in detector.detect(leafy_view.image)] == [40]


def test_engine_of_one_resolution_needs_no_budget(leafy_view: View) -> None:
    detector = FrameDetector(tags.make_engine("aruco"), 1e-9)
    assert [found.id for found in detector.detect(leafy_view.image)] == [40]


def test_tiny_and_colored_frames_are_handled_as_images() -> None:
    detector, _ = make(0.01)
    assert detector.detect(np.zeros((3, 640), np.uint8)) == []
    with pytest.raises(ValueError, match="gray image"):
        detector.detect(np.zeros((480, 640, 3), np.uint8))


def test_smoothing_keeps_a_tag_and_removes_noise(tag_views: ModuleType) -> None:
    view = tag_views.at_range(11, 1.0, 0.2, np.random.default_rng(3), noise=5.0)
    smoothed, busy = smooth_low_contrast(view.image)
    x0, y0 = view.corners.min(axis=0).astype(int)
    x1, y1 = view.corners.max(axis=0).astype(int)
    assert smoothed[y0:y1, x0:x1].std() > 0.95 * view.image[y0:y1, x0:x1].std()
    corner = slice(2, 30), slice(2, 30)
    assert smoothed[corner].std() < 0.4 * view.image[corner].std()
    assert busy < 0.15
