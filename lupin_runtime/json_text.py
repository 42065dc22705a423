"""Parses JSON that comes from elsewhere: from a file, a robot, a topic or a client; and gives it the expected shape."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from typing import Any

# No count, time or size is larger.
_MAX_NUMBER = 1e18


def parse_json(text: str | bytes) -> Any:
    """Return the value of a JSON text. Raises ValueError for any malformed text, also for one that is nested too deeply.

    `json.loads` raises RecursionError for the latter, which callers forget. An integer that does not fit a float becomes
    infinite, like any other number: as an integer it would raise OverflowError in the first calculation.
    """
    try:
        return json.loads(text, parse_int=_integer)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


def _integer(digits: str) -> int | float:
    value = int(digits)
    return value if abs(value) <= sys.float_info.max else float(digits)


def conform(value: Any, shape: Any) -> Any:
    """Return a JSON value in the shape of another, so that readers find every key, and in it a value of the expected type.

    An object gets the keys of `shape` that it lacks, and keeps those that `shape` does not have. A list keeps the items that
    have the type of the only item of `shape`; an object without keys, and an empty list, take anything. Any other value is
    replaced by `shape` itself if it has another type, or is a number that is not finite; None in `shape` stands for an
    optional number.
    """
    if isinstance(shape, Mapping):
        if not isinstance(value, dict):
            return {key: conform(None, inner) for key, inner in shape.items()}
        return {**value, **{key: conform(value.get(key), inner) for key, inner in shape.items()}}
    if isinstance(shape, list):
        items = value if isinstance(value, list) else []
        return [conform(item, shape[0]) for item in items if isinstance(item, type(shape[0]))] if shape else list(items)
    if shape is None or type(shape) in (int, float):
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        return value if is_number and abs(value) <= _MAX_NUMBER and math.isfinite(value) else shape
    return value if type(value) is type(shape) else shape
