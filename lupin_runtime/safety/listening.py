"""How long a process that was just started listens for a stop before it says that it has missed none.

It cannot expect the console of another computer, which may hold the stop. A robot alone need not wait for one as long.
"""

from __future__ import annotations

# Through a discovery server, a first sample usually takes up to 3.3 s; then a period of a console.
LISTEN_S = 4.0
# Two periods of a console, and of a discovery server, which looks for matching topics every 0.45 s.
SHORT_LISTEN_S = 1.0


class Listening:
    """Whether a process has listened for long enough. Times are nanoseconds of one monotonic clock.

    LISTEN_S is enough in any case. With `own_server`, the discovery server of this computer has the names of all consoles that
    are connected to the robot, and tells them together with the button's. Then SHORT_LISTEN_S is enough after the button became
    known, once its state was received, if no console is known.
    """

    def __init__(self, now_ns: int, listen_s: float = LISTEN_S, own_server: bool = False) -> None:
        self._ends_ns = now_ns + int(listen_s * 1e9)
        self._may_be_short = own_server
        self._known_ns: int | None = None  # since when the button is known
        self._hears_button = False

    def hear_button(self) -> None:
        """Note that the button's state was received."""
        self._hears_button = True

    def is_over(self, buttons: int, consoles: int, now_ns: int) -> bool:
        """Return whether it is over; so many publishers of the button and of the consoles are known now."""
        if consoles:
            self._may_be_short = False  # also after it has left: it may be back
        if not buttons:
            self._known_ns = None
        elif self._known_ns is None:
            self._known_ns = now_ns
        is_alone = self._may_be_short and self._hears_button and self._known_ns is not None
        return now_ns >= self._ends_ns or (is_alone and now_ns - (self._known_ns or 0) >= SHORT_LISTEN_S * 1e9)
