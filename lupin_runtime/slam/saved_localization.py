"""What a replaced localization process must know of the one before it: where odom is in the map, or that the robot is lost."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

from lupin_runtime.atomic_file import MalformedFile, write_atomically
from lupin_runtime.bounded_file import read_bounded_text
from lupin_runtime.geometry import Pose2
from lupin_runtime.json_text import parse_json

SAVE_PERIOD_S = 5.0
# An older file was not replaced for a reason, such as a full disk: the robot may have been moved on the map, or lost, since.
MAX_AGE_S = 60.0


@dataclass(frozen=True)
class SavedLocalization:
    """The pose of odom in the map at `saved_ns` of the monotonic clock, and whether the robot was lost then."""

    map_from_odom: Pose2
    lost: bool
    saved_ns: int

    def is_usable(self, now_ns: int) -> bool:
        """Return whether `map_from_odom` may be used now: odometry went on, so that it still holds."""
        return not self.lost and 0 <= now_ns - self.saved_ns <= MAX_AGE_S * 1e9

    def save(self, path: Path) -> None:
        """Write it atomically. Raises OSError."""
        pose = self.map_from_odom
        content = {"map_from_odom": [pose.x, pose.y, pose.yaw], "lost": self.lost, "saved_ns": self.saved_ns}
        write_atomically(path, json.dumps(content))


def load_localization(path: Path) -> SavedLocalization:
    """Read what `save` wrote. Raises MalformedFile, OSError."""
    try:
        content = parse_json(read_bounded_text(path))
        x, y, yaw = (float(value) for value in content["map_from_odom"])
        lost, saved_ns = content["lost"], content["saved_ns"]
        if not (all(map(math.isfinite, (x, y, yaw))) and isinstance(lost, bool) and isinstance(saved_ns, int)):
            raise ValueError("a value of the wrong type")
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise MalformedFile(path, None, f"expected a saved localization: {error}") from None
    return SavedLocalization(Pose2(x, y, yaw), lost, saved_ns)
