"""The e-stop: the robot's button OR the consoles, with every reason in words."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_runtime.safety.consoles import ConsoleLane

BUTTON_SILENCE_S = 2.0


@dataclass(frozen=True)
class EstopState:
    """Whether the stop is engaged, every reason for it, and what is wrong with its sources."""

    engaged: bool
    reasons: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


class EstopSources:
    """Folds the button and the consoles together. Both start released.

    The button's last value holds until it says another. When it fell silent, `button_silence_engages` decides: by default
    that is only a warning, because whether the vendor's firmware repeats an unchanged button has not been verified, and a
    stop that is always on gets bypassed. Set it where the button is known to repeat.
    """

    def __init__(
        self,
        consoles: ConsoleLane,
        *,
        engaged_value: bool = True,
        button_silence_s: float = BUTTON_SILENCE_S,
        button_silence_engages: bool = False,
    ) -> None:
        self.consoles = consoles
        self._engaged_value = engaged_value
        self._silence_ns = int(button_silence_s * 1e9)
        self._silence_engages = button_silence_engages
        self._pressed = False
        self._button_ns: int | None = None

    def button(self, value: bool, now_ns: int) -> None:
        """Take a message of the button; `now_ns` is of the clock that the button's driver lives by."""
        self._pressed = value == self._engaged_value
        self._button_ns = now_ns

    def state(self, now_ns: int, real_ns: int) -> EstopState:
        """The stop as of now: `now_ns` of the button's clock, `real_ns` of the consoles'."""
        reasons, warnings = [], []
        if self._pressed:
            reasons.append("the button is pressed")
        if self._button_ns is None:
            warnings.append("the button has not been heard")
        elif not 0 <= now_ns - self._button_ns <= self._silence_ns:
            silent = f"the button has been silent for more than {self._silence_ns / 1e9:g} s"
            (reasons if self._silence_engages else warnings).append(silent)
        console = self.consoles.reason(real_ns)
        if console is not None:
            reasons.append(console)
        return EstopState(bool(reasons), tuple(reasons), tuple(warnings))
