"""Learns the controls of a pad from its events: one after the other is used, and let go of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lupin_runtime.teleop.events import EV_ABS, EV_KEY, Event
from lupin_runtime.teleop.pad_maps import KERNEL_LAYOUT, PadId, PadMap

STABLE_S = 0.12  # a control must be used for this long
USED, AT_REST = 0.6, 0.3  # shares of half the range of an axis, from its place at rest
# The keys of joysticks and gamepads, from BTN_JOYSTICK to BTN_THUMBR.
_BUTTONS = range(0x120, 0x13F)


@dataclass(frozen=True)
class Step:
    """A control to use: its field of PadMap, what to ask for, and whether it is an axis."""

    control: str
    prompt: str
    is_axis: bool = False


STEPS = (
    Step("dead_man", "hold the left shoulder button: it will be the dead-man button"),
    Step("turbo", "hold the right shoulder button"),
    Step("forward_axis", "push the left stick forward", is_axis=True),
    Step("lateral_axis", "push the left stick to the left", is_axis=True),
    Step("yaw_axis", "push the right stick to the left", is_axis=True),
)


def can_be_calibrated(found: PadId) -> bool:
    """Return whether a device has two buttons of a gamepad or joystick, and three axes."""
    return len(found.keys & frozenset(_BUTTONS)) >= 2 and len(found.axes) >= 3


class Calibrator:
    """Follows the steps. Times are nanoseconds of the monotonic clock."""

    def __init__(self, ranges: Mapping[int, tuple[int, int]], rest: Mapping[int, int]) -> None:
        """Begin with the axes' ranges and their values at rest. An axis that is not in `rest` begins at its first value."""
        self.codes: dict[str, int] = {}
        self.above_center: list[int] = []
        self._ranges = ranges
        self._rest = dict(rest)
        self._values: dict[int, int] = {}
        self._pressed: set[int] = set()
        self._candidate: int | None = None
        self._since_ns = 0
        self._waits_for_rest = False

    @property
    def step(self) -> Step | None:
        """The control to use now; None once all are known."""
        return STEPS[len(self.codes)] if len(self.codes) < len(STEPS) else None

    @property
    def waits_for_rest(self) -> bool:
        """Whether the control of the last step must still be let go of."""
        return self._waits_for_rest

    def handle(self, events: Sequence[Event], now_ns: int) -> None:
        """Handle what was read from the device; call it several times in STABLE_S, if there are no events, too."""
        for event in events:
            if event.type == EV_ABS and event.code in self._ranges:
                self._rest.setdefault(event.code, event.value)
                self._values[event.code] = event.value
            elif event.type == EV_KEY and event.value == 0:
                self._pressed.discard(event.code)
            elif event.type == EV_KEY and event.code in _BUTTONS:
                self._pressed.add(event.code)
        is_for_axes = self.step is None or self.step.is_axis
        moved = {code for code in self._values if abs(self._place(code)) >= AT_REST} if is_for_axes else set()
        if self._waits_for_rest:
            self._waits_for_rest = bool(moved or self._pressed)
        elif self.step is not None:
            self._follow(self.step, now_ns)

    def row(self, name: str, found: PadId, axis_range: tuple[int, int]) -> PadMap:
        """Return the row of the pad, once all steps are done."""
        return PadMap(
            name,
            (found.bus,),
            found.vendor,
            products=(found.product,),
            version_bits=found.version & KERNEL_LAYOUT,
            declares=tuple(sorted(found.axes)),
            dead_man=self.codes["dead_man"],
            turbo=self.codes["turbo"],
            lateral_axis=self.codes["lateral_axis"],
            forward_axis=self.codes["forward_axis"],
            yaw_axis=self.codes["yaw_axis"],
            above_center=tuple(self.above_center),
            axis_range=axis_range,
        )

    def _follow(self, step: Step, now_ns: int) -> None:
        used = {code for code in self._values if abs(self._place(code)) >= USED} if step.is_axis else set(self._pressed)
        known = {self.codes[other.control] for other in STEPS[: len(self.codes)] if other.is_axis == step.is_axis}
        candidates = {code for code in used - known if not step.is_axis or self._rests_in_the_middle(code)}
        candidate = next(iter(candidates)) if len(candidates) == 1 else None  # of several it is not known which is meant
        if candidate != self._candidate:
            self._candidate, self._since_ns = candidate, now_ns
        elif candidate is not None and now_ns - self._since_ns >= STABLE_S * 1e9:
            self.codes[step.control] = candidate
            if step.is_axis and self._place(candidate) > 0.0:
                self.above_center.append(candidate)
            self._candidate, self._waits_for_rest = None, True
            if self.step is not None and self.step.is_axis and not step.is_axis:
                # No stick was asked for yet. Before its first report, the kernel had said 0 of each axis.
                self._rest.update(self._values)

    def _rests_in_the_middle(self, code: int) -> bool:
        """Return whether an axis is that of a stick: a trigger rests at an end, where a stick would command full speed."""
        low, high = self._ranges[code]
        return abs(2 * self._rest[code] - low - high) <= AT_REST * (high - low)

    def _place(self, code: int) -> float:
        """Return how far an axis is from its rest, as a share of half its range."""
        low, high = self._ranges[code]
        return 2.0 * (self._values[code] - self._rest[code]) / (high - low)
