"""Reports of a pad: events as the kernel's driver would write them, at times that the test chooses."""

from __future__ import annotations

from lupin_runtime.teleop.events import EV_ABS, EV_KEY, EV_SYN, SYN_DROPPED, SYN_REPORT, Event
from lupin_runtime.teleop.pad_maps import USB, PadMap, find_map
from lupin_runtime.teleop.pad_state import SETTLE_S, PadState
from tests.support.pad_ids import XBOX_USB

MS = 1_000_000
CONNECTED_NS = 5_000 * MS
SETTLED_NS = CONNECTED_NS + int(SETTLE_S * 1e9)


def xbox() -> PadMap:
    row = find_map(XBOX_USB)
    assert row is not None
    return row


def new_state(row: PadMap | None = None) -> PadState:
    """Return the state of a pad of which nothing is known yet."""
    return PadState(row or xbox(), USB, {}, CONNECTED_NS)


def key(code: int, value: int, at_ns: int) -> list[Event]:
    return [Event(at_ns, EV_KEY, code, value), report(at_ns)]


def axis(code: int, value: int, at_ns: int) -> list[Event]:
    return [Event(at_ns, EV_ABS, code, value), report(at_ns)]


def report(at_ns: int) -> Event:
    return Event(at_ns, EV_SYN, SYN_REPORT, 0)


def dropped(at_ns: int) -> Event:
    return Event(at_ns, EV_SYN, SYN_DROPPED, 0)


def held_state(at_ns: int) -> PadState:
    """Return the state of a pad whose dead-man button was released and is held since `at_ns`."""
    state = new_state()
    state.handle(key(state.row.dead_man, 0, at_ns) + key(state.row.dead_man, 1, at_ns), at_ns)
    return state
