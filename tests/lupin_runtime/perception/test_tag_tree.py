"""Pairs of a tag's transform and its detection."""

from __future__ import annotations

import pytest

from lupin_runtime.perception.tag_tree import PAIRING_TIMEOUT_S, TagTransform, TagTree
from lupin_runtime.transforms import Transform


class Rig:
    """A tree with a clock that is set, and what it has placed."""

    def __init__(self) -> None:
        self.now_s = 10.0
        self.tree = TagTree("tag_", lambda: int(self.now_s * 1e9))
        self.placed: list[tuple[str, int]] = []
        self.map_arrived = True

    def receive(self, stamp_ns: int) -> None:
        self.tree.insert("camera", "tag_7", stamp_ns, Transform())

    def pair(self) -> list[tuple[str, int]]:
        self.tree.pair(self._place)
        return self.placed

    def _place(self, tag_id: str, transform: TagTransform) -> bool:
        if self.map_arrived:
            self.placed.append((tag_id, transform.stamp_ns))
        return self.map_arrived


@pytest.mark.parametrize("transform_first", [True, False])
def test_tag_is_placed_once_both_messages_arrived(transform_first: bool) -> None:
    rig = Rig()
    for is_transform in (transform_first, not transform_first):
        assert rig.pair() == []
        if is_transform:
            rig.receive(3)
        else:
            rig.tree.note_detection("7", near=True)
    assert rig.pair() == [("7", 3)]
    assert rig.pair() == [("7", 3)]


def test_detection_too_far_away_takes_its_transform() -> None:
    rig = Rig()
    for stamp_ns, near in ((3, False), (4, True)):
        rig.receive(stamp_ns)
        rig.tree.note_detection("7", near)
    assert rig.pair() == [("7", 4)]


def test_pair_waits_for_the_map_until_the_timeout() -> None:
    rig = Rig()
    rig.map_arrived = False
    rig.receive(3)
    rig.tree.note_detection("7", near=True)
    assert rig.pair() == []
    assert len(rig.tree.waiting["7"].transforms) == 1
    rig.now_s += PAIRING_TIMEOUT_S
    assert rig.pair() == []
    rig.map_arrived = True
    assert rig.pair() == [] and not rig.tree.waiting["7"].detections


def test_transform_of_another_frame_waits_for_nothing() -> None:
    rig = Rig()
    rig.tree.insert("odom", "base_link", 3, Transform())
    assert not rig.tree.waiting
