"""A transform tree that pairs the transforms of tags with their detections, which travel on another topic."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from lupin_runtime.transforms import Transform, TransformTree

# A detection and its transform travel on two topics, and the map's transform may lag behind the image's stamp.
PAIRING_TIMEOUT_S = 1.0


@dataclass(frozen=True)
class TagTransform:
    """A received `tag_<id>` transform that waits for its detection, or for the map's transform."""

    stamp_ns: int
    parent: str
    camera_from_tag: Transform
    arrived_ns: int


@dataclass
class _TagQueue:
    """The unprocessed transforms and detections of one tag; `detections` are (arrival in ns, near enough)."""

    transforms: deque[TagTransform] = field(default_factory=lambda: deque(maxlen=32))
    detections: deque[tuple[int, bool]] = field(default_factory=lambda: deque(maxlen=32))


class TagTree(TransformTree):
    """A transform tree that also queues every tag transform: tags are placed at exactly those stamps, since between two
    transforms of a tag the robot may have been anywhere.

    The names of tags' frames are `prefix` and an id; `clock` returns monotonic ns.
    """

    def __init__(self, prefix: str, clock: Callable[[], int]) -> None:
        super().__init__()
        self._prefix, self._clock = prefix, clock
        self.waiting: dict[str, _TagQueue] = {}  # by tag id

    def insert(self, parent: str, child: str, stamp_ns: int, transform: Transform, static: bool = False) -> None:
        """See `TransformTree.insert`."""
        super().insert(parent, child, stamp_ns, transform, static)
        if child.startswith(self._prefix):
            received = TagTransform(stamp_ns, parent, transform, self._clock())
            self._queue(child[len(self._prefix) :]).transforms.append(received)

    def note_detection(self, tag_id: str, near: bool) -> None:
        """Note a detection of a tag; unless it is `near` enough, its transform is dropped."""
        self._queue(tag_id).detections.append((self._clock(), near))

    def pair(self, place: Callable[[str, TagTransform], bool]) -> None:
        """Call `place` with the id and transform of each near tag that was detected, until it returns True.

        What has waited for more than PAIRING_TIMEOUT_S is dropped.
        """
        too_old_ns = self._clock() - int(PAIRING_TIMEOUT_S * 1e9)
        for tag_id, waiting in self.waiting.items():
            while waiting.transforms and waiting.detections:
                transform, (_, near) = waiting.transforms[0], waiting.detections[0]
                if near and not place(tag_id, transform) and transform.arrived_ns > too_old_ns:
                    break
                waiting.transforms.popleft()
                waiting.detections.popleft()
            while waiting.transforms and waiting.transforms[0].arrived_ns <= too_old_ns:
                waiting.transforms.popleft()
            while waiting.detections and waiting.detections[0][0] <= too_old_ns:
                waiting.detections.popleft()

    def _queue(self, tag_id: str) -> _TagQueue:
        return self.waiting.setdefault(tag_id, _TagQueue())
