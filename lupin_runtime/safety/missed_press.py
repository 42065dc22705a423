"""A stop that the e-stop bridge missed or forgot, because the bridge hung or was being replaced.

Somebody who presses and releases the button meanwhile expects what follows any other press: nothing moves until a newer
command. And a bridge that has just been started may not have heard a button that is held, and never hears a console that is
gone and has left its stop. Another process therefore subscribes to button and consoles, too.
"""

from __future__ import annotations

# A working bridge answers within milliseconds; on a busy machine a press may also arrive this long before or after the answer.
ANSWER_S = 0.5
# The processes discover a new bridge one after the other; some would miss a shorter stop.
HOLD_S = 1.5


class MissedPress:
    """Whether a stop was missed: the e-stop's state was not engaged from ANSWER_S before a press until ANSWER_S after it, or
    for that long while a stop is held.

    It counts as missed until the state has been engaged for HOLD_S and no stop is held. Times are nanoseconds of one monotonic
    clock.
    """

    def __init__(self) -> None:
        self._engaged_ns: int | None = None
        self._press_ns: int | None = None
        self._made_good_ns: int | None = None  # when the state was engaged after a missed press
        self._down = False  # whether the button is held
        self._lost = False  # whether a console has left a stop
        self._unanswered_ns: int | None = None  # since when a stop is held although the state is not engaged
        self.missed = False

    def button(self, pressed: bool, now_ns: int) -> None:
        """Handle a message of the button. Its repeated value is one press."""
        if pressed and not self._down:
            self.press(now_ns)
        self._down = pressed

    def press(self, now_ns: int) -> None:
        """Handle a press, or a console's message that it holds the stop."""
        if self._press_ns is None and not self._is_engaged(now_ns):
            self._press_ns = now_ns

    def lose_stop(self, is_lost: bool) -> None:
        """Note whether a stop is engaged that no console repeats, so that only a process that remembers it knows of it."""
        self._lost = is_lost

    def state(self, engaged: bool, now_ns: int) -> None:
        """Handle a message of the e-stop's state."""
        if engaged:
            self._engaged_ns, self._press_ns = now_ns, None
            if self.missed and self._made_good_ns is None:
                self._made_good_ns = now_ns

    def note_no_press(self) -> None:
        """Note that the e-stop was not engaged for a press so far: its process has not heard every source yet."""
        self._engaged_ns = None

    def tick(self, now_ns: int) -> bool:
        """Return whether a stop is missed at `now_ns`."""
        is_held = self._down or self._lost
        if not is_held or self._is_engaged(now_ns):
            self._unanswered_ns = None
        elif self._unanswered_ns is None:
            self._unanswered_ns = now_ns
        if any(
            since_ns is not None and now_ns - since_ns > ANSWER_S * 1e9 for since_ns in (self._press_ns, self._unanswered_ns)
        ):
            self.missed = True
        if not is_held and self._made_good_ns is not None and now_ns - self._made_good_ns >= HOLD_S * 1e9:
            self.missed, self._made_good_ns = False, None
        return self.missed

    def _is_engaged(self, now_ns: int) -> bool:
        return self._engaged_ns is not None and now_ns - self._engaged_ns <= ANSWER_S * 1e9
