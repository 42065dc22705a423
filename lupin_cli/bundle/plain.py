"""Facts and findings as JSON-able data."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from enum import Enum
from typing import Any

from lupin_cli.facts.base import Facts, Unknown


def plain(value: Any) -> Any:
    """`value` as data that JSON can hold: dataclasses by their fields, sets in order, all else as it prints."""
    if value is None or isinstance(value, (bool, int, str)):
        return value.value if isinstance(value, Enum) else value
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if isinstance(value, Unknown):
        return {"unknown": value.reason}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (set, frozenset)):
        return sorted((plain(item) for item in value), key=str)
    if isinstance(value, (bytes, bytearray)):
        return bytes(value).decode("utf-8", "backslashreplace")
    return str(value.value if isinstance(value, Enum) else value)


def facts(found: Facts) -> dict[str, Any]:
    """The facts of one machine as they were understood."""
    return {
        "machine": found.machine,
        "asked_ns": found.asked_ns,
        "facts": {name: plain(value) for name, value in sorted(found.values.items())},
    }
