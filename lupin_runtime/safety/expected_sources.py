"""The sources that the e-stop's process expects: it may say *released* only after it has heard each of them.

A process that has just been started receives a source once it has discovered it, which may take arbitrarily long. Until then it
cannot know whether that source holds the stop.
"""

from __future__ import annotations

from collections.abc import Collection

from lupin_runtime.json_text import parse_json

BUTTON = "button"
CONSOLE = "console"
WITNESS = "witness"
ESTOP_BUTTON = "LUPIN_ESTOP_BUTTON"  # of the environment of lupin-onboard; off on a robot without a button

UNHEARD_BUTTON = "nothing has been heard of the robot's button yet"
UNHEARD_CONSOLE = "nothing has been heard of the console yet"
UNHEARD_WITNESS = "nothing has been heard of estop_witness yet"
# Source → the reason of a stop while nothing has been heard of it, with the way out.
UNHEARD = {
    BUTTON: f"{UNHEARD_BUTTON}: press and release it; on a robot without one, set {ESTOP_BUTTON}=no (docs/robot-services.md)",
    CONSOLE: f"{UNHEARD_CONSOLE}: see lupin logs console, or start the run without it: lupin up --no-web",
    WITNESS: f"{UNHEARD_WITNESS}, which knows what this process has missed: see the log of the process drive",
}


class ExpectedSources:
    """Which of the expected sources have been heard."""

    def __init__(self, expected: Collection[str] = ()) -> None:
        """`expected` are keys of UNHEARD. Raises ValueError for another one."""
        unknown = sorted(set(expected) - set(UNHEARD))
        if unknown:
            raise ValueError(f"unknown e-stop source {', '.join(unknown)}, expected some of {', '.join(UNHEARD)}")
        self._unheard = [source for source in UNHEARD if source in expected]

    @property
    def unheard(self) -> tuple[str, ...]:
        """The expected sources that have not been heard."""
        return tuple(self._unheard)

    def hear(self, source: str) -> None:
        """Note that a source was heard. Its later silence has rules of its own."""
        if source in self._unheard:
            self._unheard.remove(source)


def waits_for_sources(text: str) -> bool:
    """Return whether the e-stop's status names sources that its process has not heard. A malformed one names none."""
    try:
        return bool(parse_json(text)["unheard"])
    except (ValueError, KeyError, TypeError):
        return False


def tells_of_no_press(text: str) -> bool:
    """Return whether the e-stop's status says that nothing has held the stop since its process was started.

    If the e-stop is engaged nevertheless, its process has not heard every source. A malformed status does not say so.
    """
    try:
        presses = parse_json(text)["presses"]
    except (ValueError, KeyError, TypeError):
        return False
    return type(presses) is int and presses == 0
