"""The e-stop: engaged by the robot's button or by a console, with every reason as text."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from lupin_runtime.safety.console_server_stop import ConsoleServerStop
from lupin_runtime.safety.console_stop import ConsoleStop
from lupin_runtime.safety.expected_sources import BUTTON, CONSOLE, UNHEARD, WITNESS, ExpectedSources

BUTTON_SILENCE_S = 2.0
BUTTON_PRESSED = "the button is pressed"
BUTTON_SILENT = "the button has been silent for more than {seconds:g} s"
MISSED_PRESS = (
    "it was pressed while the e-stop's process did not respond, or a console that held it was lost; "
    "if it stays engaged, press and release the stop of a console"
)
# The reason of a process that has never received the button: its silence may be what the former process knew of.
MISSED_PRESS_OR_SILENCE = (
    "before the e-stop's process was started again, it was pressed, or its button or a console that held it was lost; "
    "if it stays engaged, check the button, then press and release the stop of a console"
)


@dataclass(frozen=True)
class EstopState:
    """What holds the stop, the expected sources that have not been heard, and warnings about sources."""

    stops: tuple[str, ...] = ()
    unheard: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def reasons(self) -> tuple[str, ...]:
        """Every reason for the e-stop."""
        return (*self.stops, *(UNHEARD[source] for source in self.unheard))

    @property
    def engaged(self) -> bool:
        """Whether the e-stop is engaged."""
        return bool(self.stops or self.unheard)


class ButtonSilence:
    """Detects that the button, once received, has fallen silent.

    It must be silent on both clocks, so that neither a jump of the simulated clock nor a slow simulation counts.
    """

    def __init__(self, silence_s: float) -> None:
        self.silence_s = silence_s
        self._received_ns: tuple[int, int] | None = None

    @property
    def was_received(self) -> bool:
        """Whether a message of the button has arrived."""
        return self._received_ns is not None

    def receive(self, now_ns: int, real_ns: int) -> None:
        """Handle a message, at `now_ns` of the clock of the button's driver and at `real_ns` of real time."""
        self._received_ns = now_ns, real_ns

    def is_silent(self, now_ns: int, real_ns: int) -> bool:
        """Return whether the last message is older than `silence_s`."""
        received_ns = self._received_ns
        if received_ns is None:
            return False
        return not any(0 <= now - then <= self.silence_s * 1e9 for now, then in zip((now_ns, real_ns), received_ns))


class EstopSources:
    """Combines the button, the consoles, and what the e-stop's process has missed.

    It is engaged until each of the sources `expected` was heard. The button's last value stays valid until its next message. A
    button that falls silent engages the e-stop, because a press would no longer be noticed. One that is not expected and was
    never received causes a warning: a robot without one can still be driven. Clear `button_silence_engages` for firmware that
    reports the button only when it changes; its silence then causes a warning.
    """

    def __init__(
        self,
        consoles: ConsoleStop,
        *,
        expected: Collection[str] = (),
        engaged_value: bool = True,
        button_silence_s: float = BUTTON_SILENCE_S,
        button_silence_engages: bool = True,
    ) -> None:
        self.consoles = consoles
        self._console_server = ConsoleServerStop()
        self._expected = ExpectedSources(expected)
        self._engaged_value = engaged_value
        self._silence = ButtonSilence(button_silence_s)
        self._silence_engages = button_silence_engages
        self._pressed = False
        # Whether another process noticed what this one missed: a press, the button's silence, or the stop of a lost console.
        self._missed_press: bool | None = None  # None before it has said anything

    @property
    def is_told_of_no_missed_press(self) -> bool:
        """Whether the other process says that nothing was missed."""
        return self._missed_press is False

    def button(self, value: bool, now_ns: int, real_ns: int) -> None:
        """Handle a message of the button; `now_ns` is on the clock of the button's driver, `real_ns` on the consoles' clock."""
        self._pressed = value == self._engaged_value
        self._silence.receive(now_ns, real_ns)
        self._expected.hear(BUTTON)

    def console_server(self, text: str, real_ns: int) -> None:
        """Handle a statement of the console's server."""
        self._console_server.update(text, real_ns)
        self._expected.hear(CONSOLE)

    def missed_press(self, missed: bool) -> None:
        """Handle a message of the process that notices what this one missed."""
        self._missed_press = missed
        self._expected.hear(WITNESS)

    def state(self, now_ns: int, real_ns: int) -> EstopState:
        """Return the e-stop state at `now_ns` of the button's clock and `real_ns` of the consoles' clock."""
        stops: list[str] = []
        warnings: list[str] = []
        unheard = self._expected.unheard
        if self._pressed:
            stops.append(BUTTON_PRESSED)
        if self._silence.is_silent(now_ns, real_ns):
            silent = BUTTON_SILENT.format(seconds=self._silence.silence_s)
            (stops if self._silence_engages else warnings).append(silent)
        elif not self._silence.was_received and BUTTON not in unheard:
            warnings.append("no message from the button yet")
        stops += [why for why in (self.consoles.reason(real_ns), self._console_server.reason(real_ns)) if why is not None]
        if self._missed_press and not stops:
            stops.append(MISSED_PRESS if self._silence.was_received else MISSED_PRESS_OR_SILENCE)
        return EstopState(tuple(stops), unheard, tuple(warnings))
