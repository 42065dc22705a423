from __future__ import annotations

import cv2
import numpy as np
import pytest

from lupin_runtime.gridmap import GridMap
from lupin_runtime.report.log import TagPose
from lupin_runtime.report.raster import Extent, heat_maps, known_extent, map_png, thumbnail
from lupin_runtime.report.tags import Reading, TagResult


def decoded(png: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)


def grid() -> GridMap:
    cells = np.full((40, 60), -1, np.int8)
    cells[10:20, 20:50] = 0
    cells[10, 20:50] = 100
    return GridMap(cells, 0.05, -1.0, -2.0)


def measured(x: float, y: float, value: float) -> TagResult:
    reading = Reading("temperature", value, 1.0, 0.0)
    return TagResult("1", TagPose(x, y, 0.4, 0.0), "read", "", True, 0.0, 1.0, 3, (reading,), "healthy", 0.0, None, ())


def test_the_known_part_of_a_map_is_found():
    found = known_extent(grid())
    assert (found.x0, found.y0, found.x1, found.y1) == pytest.approx((0.0, -1.5, 1.5, -1.0))
    assert known_extent(GridMap(np.full((3, 3), -1, np.int8), 0.05, 0.0, 0.0)) is None


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_map_is_drawn_with_north_up_and_sharp_cells(theme):
    picture = decoded(map_png(grid(), known_extent(grid()), theme))
    assert picture.shape == (30, 90, 4)
    assert (picture[..., 3] == 255).all()
    free, wall = picture[0, 0, :3].astype(int), picture[-1, 0, :3].astype(int)
    assert abs(free - wall).sum() > 300
    assert (picture[-3:, :, :3] == wall).all()
    assert (picture[:-3, :, :3] == free).all()


def test_unknown_cells_are_transparent():
    picture = decoded(map_png(grid(), Extent(-0.5, -1.5, 1.5, -1.0), "light"))
    assert (picture[:, :30, 3] == 0).all()
    assert (picture[:, 30:, 3] == 255).all()


def test_a_heat_map_spans_its_samples_and_stays_on_the_known_map():
    maps = heat_maps([measured(0.5, -1.2, 18.0), measured(1.2, -1.2, 30.0)], grid())
    assert [(m.sensor, m.low, m.high, m.samples) for m in maps] == [("temperature", 18.0, 30.0, 2)]
    picture = decoded(maps[0].png)
    assert picture[..., 3].max() == pytest.approx(0.6 * 255, abs=2)
    extent = maps[0].extent
    coloured = np.argwhere(picture[..., 3] > 40)
    ys = extent.y1 - (coloured[:, 0] + 0.5) / picture.shape[0] * extent.height
    xs = extent.x0 + (coloured[:, 1] + 0.5) / picture.shape[1] * extent.width
    assert xs.min() > -0.1
    assert xs.max() < 1.6
    assert ys.min() > -1.6
    assert ys.max() < -0.9


def test_one_sample_is_drawn_at_full_strength_and_nan_is_left_out():
    assert decoded(heat_maps([measured(0.0, 0.0, 21.0)], None)[0].png)[..., 3].max() == 153
    assert heat_maps([measured(0.0, 0.0, float("nan"))], None) == []


def test_a_thumbnail_keeps_the_shape_and_garbage_gives_none():
    jpeg = cv2.imencode(".jpg", np.zeros((480, 640, 3), np.uint8))[1].tobytes()
    small = cv2.imdecode(np.frombuffer(thumbnail(jpeg, 160), np.uint8), cv2.IMREAD_COLOR)
    assert small.shape == (120, 160, 3)
    assert thumbnail(b"", 160) is None
    assert thumbnail(b"no picture", 160) is None
