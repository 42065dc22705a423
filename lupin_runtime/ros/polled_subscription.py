"""Subscriptions that are polled by their owner, so that no executor waits for them."""

from __future__ import annotations

import time
from itertools import islice
from typing import Any, NamedTuple

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
    taken = _take(subscription, raw=False)
    return taken[-1][0] if taken else None


class Serialized(NamedTuple):
    """A serialized message, and how long ago it arrived."""

    data: bytes
    age_s: float


def take_newest_with(subscription: Subscription, mark: bytes) -> Serialized | None:
    """Take what has arrived on a polled, raw subscription; return the newest message that contains `mark`, or None.

    The middleware tells the time of arrival on the wall clock: call it often where a step of that clock must not matter.
    """
    newest = next((taken for taken in reversed(_take(subscription, raw=True)) if mark in taken[0]), None)
    if newest is None:
        return None
    return Serialized(newest[0], max(0.0, (time.time_ns() - newest[1]["received_timestamp"]) / 1e9))


def _take(subscription: Subscription, raw: bool) -> list[tuple[Any, dict[str, int]]]:
    """Take what has arrived, the oldest first: each message, serialized if `raw`, with what the middleware tells of it."""
    handle = subscription.handle
    with handle:
        return list(islice(iter(lambda: handle.take_message(subscription.msg_type, raw), None), _MAX_TAKEN))
