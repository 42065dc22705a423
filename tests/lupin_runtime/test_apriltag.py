"""Images of tag36h11."""

from __future__ import annotations

import numpy as np
import pytest

from lupin_runtime import apriltag


def test_id_0_equals_the_official_image_upright() -> None:
    """OpenCV draws the family turned by 180 degrees, and a later version will not."""
    rows = ["".join(str(bit) for bit in row) for row in apriltag.modules(0)[1:-1, 1:-1]]
    assert tuple(rows) == apriltag.ID0_ROWS == ("110101", "011101", "011000", "101000", "010110", "000100")


@pytest.mark.parametrize("tag_id", [0, 1, 13, 30, 586])
def test_tag_image_has_a_white_margin_and_a_black_border(tag_id: int) -> None:
    image = apriltag.tag_image(tag_id, module_px=1)
    assert image.shape == (10, 10)
    ring = np.ones((10, 10), bool)
    ring[1:-1, 1:-1] = False
    assert (image[ring] == 255).all()
    ring[1:-1, 1:-1], ring[2:-2, 2:-2] = True, False
    ring[[0, -1]] = False
    ring[:, [0, -1]] = False
    assert (image[ring] == 0).all()


@pytest.mark.parametrize("tag_id", [-1, 587])
def test_id_outside_the_family_is_refused(tag_id: int) -> None:
    with pytest.raises(ValueError, match="36h11 has the ids 0 to 586"):
        apriltag.tag_image(tag_id, module_px=4)
