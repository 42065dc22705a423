"""A callback group for subscriptions that are polled by their owner, so that no executor waits for them."""

from __future__ import annotations

from typing import Any

from rclpy.callback_groups import CallbackGroup


class PolledGroup(CallbackGroup):
    """A callback group whose entities no executor waits for."""

    def can_execute(self, _entity: Any) -> bool:
        """Refuse: only the owner takes messages."""
        return False

    def beginning_execution(self, _entity: Any) -> bool:
        """Refuse every execution, like `can_execute`."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing, as no execution ever begins."""
