"""Subscriptions that their owner polls: no executor waits for them."""

from __future__ import annotations

from typing import Any

from rclpy.callback_groups import CallbackGroup


class Unspun(CallbackGroup):
    """A group that no executor waits for, should one get its node."""

    def can_execute(self, entity: Any) -> bool:
        return False

    def beginning_execution(self, entity: Any) -> bool:
        return False

    def ending_execution(self, entity: Any) -> None:
        """Nothing was begun."""
