"""The state of one pad, from its events: whether its dead-man button is held, and where its sticks are.

Only a press of the dead-man button that was seen, after the button was seen released, counts as held. It no longer counts

* as soon as the button is released;
* if events were lost (SYN_DROPPED) or came late, because the button may have been released meanwhile;
* if a pad on a radio link changed nothing for QUIET_S: if its link is lost, its state stays until the kernel notices, which can
  take seconds. What the kernel repeats by itself is no sign of the pad;
* if a value is none that a button has, or more events arrive than a pad sends.

Then it has to be released and pressed anew. The controls of the arm count by the same rules: after each of these, all of them
have to be seen at rest; and none counts unless the dead-man button is released.

What changes in one report of the pad, which ends with SYN_REPORT, takes effect at once, except that a release of the dead-man
button does not wait for the end of its report.
"""

from __future__ import annotations

import enum
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from lupin_runtime.teleop.events import EV_ABS, EV_KEY, EV_SYN, SYN_DROPPED, SYN_REPORT, Event
from lupin_runtime.teleop.pad_maps import BLUETOOTH, DEAD_ZONES, PadMap
from lupin_runtime.teleop.velocity import Sticks, normalize, shape

STALE_S = 0.25  # of an event that is handled, and of the time since events were last read
QUIET_S = 3.0
REPEATED = 2  # value of a key event that the kernel makes by itself
SETTLE_S = 1.0  # after a pad is connected: its first report may press a button that was held all along
MAX_EVENTS = 1024  # at a time; a pad at 1000 Hz sends 250 within the longest time between two readings


class DeadMan(enum.Enum):
    """What is known of the dead-man button."""

    UNKNOWN = "unknown"  # held or not, it must be seen released before a press counts
    RELEASED = "released"
    HELD = "held"


@dataclass(frozen=True)
class Snapshot:
    """What the kernel says of a device at one moment: the codes of the pressed keys, and the axes' values by their codes."""

    keys: Collection[int]
    axes: Mapping[int, int]


@dataclass(frozen=True)
class ArmDeflections:
    """The controls of the arm, -1..1: lift, elbow and wrist lean back, the pan turns left, and the gripper closes with +1."""

    pan: float = 0.0
    lift: float = 0.0
    elbow: float = 0.0
    wrist: float = 0.0
    gripper: float = 0.0


class PadState:
    """The state of one pad. Times are nanoseconds of the monotonic clock."""

    def __init__(
        self, row: PadMap, bus: int, ranges: Mapping[int, tuple[int, int]], now_ns: int, *, quiet_s: float | None = QUIET_S
    ) -> None:
        """Begin with a pad that was connected at `now_ns`. `ranges` are those of its axes; others have that of the row.

        `quiet_s` is how long it may change nothing while its dead-man button is held; None on a cable.
        """
        self.row = row
        self.dead_zone = DEAD_ZONES.get(bus, DEAD_ZONES[BLUETOOTH])
        self.dead_man = DeadMan.UNKNOWN
        self._ranges = {code: ranges.get(code, known) for code, known in row.ranges.items()}
        self._arm_buttons = frozenset(row.arm.buttons) if row.arm else frozenset()
        self._arm_trusted = False  # whether the controls of the arm count: all were at rest since the last doubt
        self._pressed: set[int] = set()  # of the arm's buttons
        self._axes: dict[int, int] = {}
        self._turbo = False
        self._report: list[Event] = []  # the changes of the report that has begun
        self._dropping = False  # events were lost, and the present report is incomplete
        self._connected_ns = now_ns
        self._read_ns = now_ns
        self._heard_ns = now_ns
        self._quiet_s = quiet_s
        self._problem = ""

    @property
    def turbo(self) -> bool:
        """Whether the turbo button is held."""
        return self._turbo

    @property
    def sticks(self) -> Sticks:
        """Where the sticks are; an axis that is not known yet counts as centered."""
        left, forward, turn = (self._stick(code) for code in self.row.axes)
        return Sticks(forward, left, turn)

    @property
    def arm(self) -> ArmDeflections:
        """The controls of the arm; at rest if they do not count."""
        released = self.dead_man is DeadMan.RELEASED
        return self._arm_deflections() if released and self._arm_trusted else ArmDeflections()

    def _arm_deflections(self) -> ArmDeflections:
        arm = self.row.arm
        if arm is None:
            return ArmDeflections()
        pressed = self._pressed
        if arm.trigger_range is None:
            gripper = float(arm.close in pressed) - float(arm.open in pressed)
        else:
            gripper = self._trigger(arm.close) - self._trigger(arm.open)
        return ArmDeflections(
            pan=float(arm.right in pressed) - float(arm.left in pressed),
            lift=float(arm.top in pressed) - float(arm.bottom in pressed),
            elbow=0.0 - normalize(self._axes.get(arm.forward), *self._ranges[arm.forward]),
            wrist=0.0 - normalize(self._axes.get(arm.sideways), *self._ranges[arm.sideways]),
            gripper=gripper,
        )

    def _trigger(self, code: int) -> float:
        """Return how far a trigger is pulled, 0..1."""
        low, high = self._ranges[code]
        # A trigger's rest is the lower end of its range, so what counts as a centered stick would be half pulled.
        place = normalize(self._axes.get(code), low, high, unknown=-1.0)
        return shape((place + 1.0) / 2.0, self.dead_zone)

    def _stick(self, code: int) -> float:
        place = normalize(self._axes.get(code), *self._ranges[code])
        return place if code in self.row.above_center else 0.0 - place

    def handle(self, events: Sequence[Event], now_ns: int) -> None:
        """Handle what was read from the device at `now_ns`; call it at least every STALE_S, if there are no events, too."""
        self.check(now_ns)
        self._read_ns = now_ns
        if any(each.type == EV_ABS or (each.type == EV_KEY and each.value != REPEATED) for each in events):
            self._heard_ns = now_ns
        for event in events[-MAX_EVENTS:]:
            self._handle_event(event, now_ns)
        if len(events) > MAX_EVENTS:
            self.distrust()
        settled = now_ns - self._connected_ns >= SETTLE_S * 1e9
        if self.dead_man is not DeadMan.RELEASED:
            self._arm_trusted = False  # what is held when it is released moves nothing
        elif settled and self._arm_deflections() == ArmDeflections():
            self._arm_trusted = True

    def check(self, now_ns: int) -> None:
        """Stop trusting the pad's buttons if the events are no longer read, or the pad is silent."""
        if self.dead_man is not DeadMan.HELD and self.arm == ArmDeflections():
            return
        if now_ns - self._read_ns > STALE_S * 1e9:
            self._problem = f"was not read for {STALE_S:g} s, as this computer is busy"
            self.distrust()
        elif self._quiet_s is not None and now_ns - self._heard_ns > self._quiet_s * 1e9:
            self._problem = f"changed nothing for {self._quiet_s:g} s, as if its link were lost"
            self.distrust()

    def take_problem(self) -> str:
        """Return why the dead-man button does not count any more, once; empty if nothing is wrong with the pad."""
        problem, self._problem = self._problem, ""
        return problem

    def distrust(self) -> None:
        """Require that the dead-man button and the arm's controls are seen released before they count again."""
        self.dead_man = DeadMan.UNKNOWN
        self._arm_trusted = False
        self._report.clear()

    def resynchronize(self, snapshot: Snapshot) -> None:
        """Take over the state that the kernel keeps. A button that is held there may have been held all along."""
        self.dead_man = DeadMan.UNKNOWN if self.row.dead_man in snapshot.keys else DeadMan.RELEASED
        self._turbo = self.row.turbo in snapshot.keys
        self._pressed = set(self._arm_buttons & set(snapshot.keys))
        self._axes = {code: value for code, value in snapshot.axes.items() if code in self._ranges}

    def _handle_event(self, event: Event, now_ns: int) -> None:
        if event.type == EV_SYN and event.code == SYN_DROPPED:
            self.distrust()
            self._axes.clear()
            self._pressed.clear()
            self._turbo = False
            self._dropping = True
        elif event.type == EV_SYN and event.code == SYN_REPORT:
            self._finish_report(now_ns)
        elif not self._dropping:
            if event.type == EV_KEY and event.code == self.row.dead_man and event.value == 0:
                self.dead_man = DeadMan.RELEASED
            self._report.append(event)
            if len(self._report) > MAX_EVENTS:
                self.distrust()

    def _finish_report(self, now_ns: int) -> None:
        report, self._report = self._report, []
        if self._dropping:
            self._dropping = False
            return
        for event in report:
            if abs(now_ns - event.time_ns) > STALE_S * 1e9:
                self._arm_trusted = False
                if self.dead_man is DeadMan.HELD:
                    self.distrust()
            if event.type == EV_ABS and event.code in self._ranges:
                self._axes[event.code] = event.value
            elif event.type == EV_KEY and event.code == self.row.turbo:
                self._turbo = event.value == 1 or (event.value == REPEATED and self._turbo)
            elif event.type == EV_KEY and event.code == self.row.dead_man:
                self._press(event, now_ns)
            elif event.type == EV_KEY and event.code in self._arm_buttons:
                self._press_for_arm(event)

    def _press(self, event: Event, now_ns: int) -> None:
        """Handle a change of the dead-man button; a repeated press changes nothing."""
        if event.value == 0:
            self.dead_man = DeadMan.RELEASED
        elif event.value not in (1, REPEATED):
            self.distrust()
        elif event.value == 1:
            self._arm_trusted = False
            fresh = abs(now_ns - event.time_ns) <= STALE_S * 1e9
            settled = now_ns - self._connected_ns >= SETTLE_S * 1e9
            believed = self.dead_man is not DeadMan.UNKNOWN and fresh and settled
            self.dead_man = DeadMan.HELD if believed else DeadMan.UNKNOWN

    def _press_for_arm(self, event: Event) -> None:
        if event.value == 0:
            self._pressed.discard(event.code)
        elif event.value == 1:
            self._pressed.add(event.code)
        elif event.value != REPEATED:
            self.distrust()
