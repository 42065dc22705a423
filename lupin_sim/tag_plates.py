"""Images of the printed AprilTag plates in the simulated greenhouse."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.apriltag import tag_image

# Ink and paper as a camera sees them: printed black is far from 0, and office paper is slightly warm. These colors also keep a
# distant plate out of the flower detector's color bands for black bugs and white flowers.
INK_BGR = (72, 68, 66)
PAPER_BGR = (190, 226, 236)


def plate_image(tag_id: int, module_px: int = 20) -> NDArray[np.uint8]:
    """Draw a tag with a margin of one white module: BGR, shape (10 * module_px, 10 * module_px, 3).

    Raises ValueError for an id outside the family.
    """
    white = tag_image(tag_id, module_px) > 0
    return np.where(white[..., None], PAPER_BGR, INK_BGR).astype(np.uint8)
