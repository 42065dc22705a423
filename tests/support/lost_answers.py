"""Answers of action servers that do not arrive, as when a server has not discovered all of a client's readers yet."""

from __future__ import annotations

from typing import Any

import pytest


def lose_goal_answers(monkeypatch: pytest.MonkeyPatch, clients: Any) -> None:
    """From now on, drop every server's answer to a goal. The server works on the goal all the same.

    `clients` is an action client, or a class of them.
    """
    send = clients.send_goal_async

    def send_goal_async(*arguments: Any, **options: Any) -> Any:
        answer = send(*arguments, **options)
        client = arguments[0] if isinstance(clients, type) else clients
        client._goal_sequence_number_to_goal_id.clear()  # an answer to an unknown sequence number is dropped
        return answer

    monkeypatch.setattr(clients, "send_goal_async", send_goal_async)
