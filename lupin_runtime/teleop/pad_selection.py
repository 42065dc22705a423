"""What driving and jogging by pads share: which of several pads is obeyed, and how often its commands are published."""

from __future__ import annotations

from collections.abc import Collection
from typing import Generic, TypeVar

PERIOD_S = 0.05
MIN_PERIOD_S = 0.01  # between two changes of a command: a pad may send 1000 reports a second

Command = TypeVar("Command")


class FirstHeld:
    """Selects the pad that is held first until it is released. The others must be released, too, before one of them counts."""

    def __init__(self) -> None:
        self.selected: str | None = None
        self._refused: set[str] = set()  # pads that were held while another one was selected

    def update(self, held: Collection[str]) -> bool:
        """Handle which pads are held now, by name; return whether the selected one has just been released."""
        self._refused &= set(held)
        if self.selected is not None and self.selected not in held:
            self.selected = None
            self._refused.update(held)
            return True
        if self.selected is None:
            self.selected = next((name for name in held if name not in self._refused), None)
        self._refused.update(name for name in held if name != self.selected)
        return False

    def refuse(self, held: Collection[str]) -> bool:
        """Select none; what is held now must be released before it counts. Return whether one was selected."""
        was_selected = self.selected is not None
        self.selected, self._refused = None, set(held)
        return was_selected


class Pacer(Generic[Command]):
    """Decides when a command is published: at once if it begins or stops, every PERIOD_S while it lasts, and if it changes."""

    def __init__(self, zero: Command) -> None:
        self.delayed = False  # whether a change waits for MIN_PERIOD_S to pass
        self._zero = self._sent = zero
        self._sent_ns: int | None = None

    def restart(self) -> None:
        """Publish the next command at once."""
        self.delayed, self._sent_ns = False, None

    def is_due(self, command: Command, now_ns: int) -> bool:
        """Return whether to publish a command now, which then counts as published."""
        self.delayed = False
        if self._sent_ns is not None:
            since_s = (now_ns - self._sent_ns) / 1e9
            has_changed = command != self._sent
            # A zero is never delayed.
            if since_s < PERIOD_S and not (has_changed and (since_s >= MIN_PERIOD_S or command == self._zero)):
                self.delayed = has_changed
                return False
        self._sent, self._sent_ns = command, now_ns
        return True
