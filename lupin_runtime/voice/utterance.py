"""What the grammar makes of a sentence, and what a sentence may refer to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from lupin_runtime.voice.slots import Names


@dataclass(frozen=True)
class Call:
    """One call of a tool of the table, with arguments that fit it."""

    tool: str
    arguments: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Confirmation:
    """The operator's answer to what was read back."""

    agrees: bool


@dataclass(frozen=True)
class Question:
    """Why nothing is done, and the sentences nearest to what was heard; `meant` is the call that may have been meant."""

    reason: str
    nearest: tuple[str, ...] = ()
    meant: Call | None = None


@dataclass(frozen=True)
class Context:
    """What a sentence may refer to.

    `pending` is the call that was read back and waits for an answer. `running` is the tool whose action `start` was carried
    out, `calibrate_arm` or `arm_record`, until it is finished; else empty. `speed_cap` is the session's share of the maximum.
    """

    names: Names = field(default_factory=Names)
    pending: Call | None = None
    running: str = ""
    speed_cap: float = 1.0


NO_CONTEXT = Context()
