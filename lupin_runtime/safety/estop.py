"""The e-stop: engaged by the robot's button or by a console, with every reason as text."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_runtime.safety.console_server_stop import ConsoleServerStop
from lupin_runtime.safety.console_stop import ConsoleStop

BUTTON_SILENCE_S = 2.0
MISSED_PRESS = "it was pressed while the e-stop's process did not respond"


@dataclass(frozen=True)
class EstopState:
    """Whether the e-stop is engaged, every reason for it, and warnings about its sources."""

    engaged: bool
    reasons: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


class EstopSources:
    """Combines the button, the consoles and a press that was missed. All start released.

    The button's last value stays valid until its next message. A button that falls silent engages the e-stop, because a press
    would no longer be noticed. It counts as silent only if it is silent on both clocks, so that neither a jump of the simulated
    clock nor a slow simulation counts. A button that was never received causes a warning: a robot without one can still be
    driven. Clear `button_silence_engages` for firmware that reports the button only when it changes; silence then causes a
    warning, too.
    """

    def __init__(
        self,
        consoles: ConsoleStop,
        *,
        engaged_value: bool = True,
        button_silence_s: float = BUTTON_SILENCE_S,
        button_silence_engages: bool = True,
    ) -> None:
        self.consoles = consoles
        self.console_server = ConsoleServerStop()
        self._engaged_value = engaged_value
        self._silence_ns = int(button_silence_s * 1e9)
        self._silence_engages = button_silence_engages
        self._pressed = False
        self._button_ns: tuple[int, int] | None = None  # the time of its last message, on its driver's clock and in real time
        self.missed_press = False  # whether another process saw a press that this one missed

    def button(self, value: bool, now_ns: int, real_ns: int) -> None:
        """Handle a message of the button; `now_ns` is on the clock of the button's driver, `real_ns` on the consoles' clock."""
        self._pressed = value == self._engaged_value
        self._button_ns = (now_ns, real_ns)

    def state(self, now_ns: int, real_ns: int) -> EstopState:
        """Return the e-stop state at `now_ns` of the button's clock and `real_ns` of the consoles' clock."""
        reasons, warnings = [], []
        if self._pressed:
            reasons.append("the button is pressed")
        if self._button_ns is None:
            warnings.append("no message from the button yet")
        elif not any(0 <= now - then <= self._silence_ns for now, then in zip((now_ns, real_ns), self._button_ns)):
            silent = f"the button has been silent for more than {self._silence_ns / 1e9:g} s"
            (reasons if self._silence_engages else warnings).append(silent)
        if self.missed_press:
            reasons.append(MISSED_PRESS)
        reasons += [why for why in (self.consoles.reason(real_ns), self.console_server.reason(real_ns)) if why is not None]
        return EstopState(bool(reasons), tuple(reasons), tuple(warnings))
