"""Subscriptions that are polled by their owner, so that no executor waits for them."""

from __future__ import annotations

from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.subscription import Subscription

_MAX_TAKEN = 50  # bounds one call while messages keep arriving


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


def take_newest(subscription: Subscription) -> Any:
    """Take what has arrived on a polled subscription; return the newest message or None."""
    newest = None
    handle = subscription.handle
    with handle:
        for _ in range(_MAX_TAKEN):
            taken = handle.take_message(subscription.msg_type, False)
            if taken is None:
                break
            newest = taken[0]
    return newest
