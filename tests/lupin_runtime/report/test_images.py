"""Raster images of the report: maps, heat maps and thumbnails."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from lupin_runtime.gridmap import GridMap
from lupin_runtime.report.images import Extent, heat_maps, known_extent, map_png, thumbnail
from lupin_runtime.report.run_log import TagPlacement
from lupin_runtime.report.tags import LatestReading, TagResult


def decode(image: bytes | None) -> np.ndarray[Any, Any]:
    assert image is not None
    decoded: np.ndarray[Any, Any] | None = cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_UNCHANGED)
    assert decoded is not None
    return decoded


def make_grid() -> GridMap:
    cells = np.full((40, 60), -1, np.int8)
    cells[10:20, 20:50] = 0
    cells[10, 20:50] = 100
    return GridMap(cells, 0.05, -1.0, -2.0)


def make_extent() -> Extent:
    extent = known_extent(make_grid())
    assert extent is not None
    return extent


def make_tag(x: float, y: float, value: float) -> TagResult:
    reading = LatestReading("temperature", value, 1.0, 0.0)
    return TagResult(
        "1", TagPlacement(x, y, 0.4, 0.0), "read", "", True, 0.0, 1.0, 1.0, 3, (reading,), "healthy", 0.0, None, ()
    )


def test_known_extent_bounds_known_cells() -> None:
    found = make_extent()
    assert (found.x0, found.y0, found.x1, found.y1) == pytest.approx((0.0, -1.5, 1.5, -1.0))
    assert known_extent(GridMap(np.full((3, 3), -1, np.int8), 0.05, 0.0, 0.0)) is None


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_map_png_has_y_up_and_sharp_cells(theme: str) -> None:
    picture = decode(map_png(make_grid(), make_extent(), theme))
    assert picture.shape == (30, 90, 4)
    assert (picture[..., 3] == 255).all()
    free, wall = picture[0, 0, :3].astype(int), picture[-1, 0, :3].astype(int)
    assert abs(free - wall).sum() > 300
    assert (picture[-3:, :, :3] == wall).all()
    assert (picture[:-3, :, :3] == free).all()


def test_unknown_cells_are_transparent() -> None:
    picture = decode(map_png(make_grid(), Extent(-0.5, -1.5, 1.5, -1.0), "light"))
    assert (picture[:, :30, 3] == 0).all()
    assert (picture[:, 30:, 3] == 255).all()


def test_heat_map_covers_samples_on_known_cells() -> None:
    maps = heat_maps([make_tag(0.5, -1.2, 18.0), make_tag(1.2, -1.2, 30.0)], make_grid())
    assert [(m.sensor, m.low, m.high, m.samples) for m in maps] == [("temperature", 18.0, 30.0, 2)]
    picture = decode(maps[0].png)
    assert picture[..., 3].max() == pytest.approx(0.6 * 255, abs=2)
    extent = maps[0].extent
    colored = np.argwhere(picture[..., 3] > 40)
    ys = extent.y1 - (colored[:, 0] + 0.5) / picture.shape[0] * extent.height
    xs = extent.x0 + (colored[:, 1] + 0.5) / picture.shape[1] * extent.width
    assert xs.min() > -0.1
    assert xs.max() < 1.6
    assert ys.min() > -1.6
    assert ys.max() < -0.9


def test_heat_map_of_one_sample_and_of_nan() -> None:
    assert decode(heat_maps([make_tag(0.0, 0.0, 21.0)], None)[0].png)[..., 3].max() == 153
    assert heat_maps([make_tag(0.0, 0.0, float("nan"))], None) == []


def test_thumbnail_keeps_aspect_ratio_and_rejects_garbage() -> None:
    jpeg = cv2.imencode(".jpg", np.zeros((480, 640, 3), np.uint8))[1].tobytes()
    assert decode(thumbnail(jpeg, 160)).shape == (120, 160, 3)
    assert thumbnail(b"", 160) is None
    assert thumbnail(b"no picture", 160) is None
