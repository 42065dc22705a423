"""Converts the values of parameters between ROS and the JSON text that rosapi has them in."""

from __future__ import annotations

import json
import math
from typing import Any

import yaml
from rcl_interfaces.msg import ParameterType, ParameterValue
from rclpy.parameter import parameter_value_to_python

# Longer text in a JSON string is a string without a look: YAML takes seconds for a megabyte, on the executor's thread.
MAX_YAML_CHARACTERS = 4096
_KINDS = ((bool, "bool"), (int, "integer"), (float, "double"), (str, "string"))


def normalize_json(text: str) -> str:
    """JSON text as Python writes it; an empty JSON string for anything else."""
    try:
        return json.dumps(json.loads(text), allow_nan=False)
    except (ValueError, RecursionError):
        return '""'


def plain_value(value: ParameterValue) -> Any:
    """A parameter's value for JSON, which has neither bytes nor NaN."""

    def plain(item: Any) -> Any:
        if isinstance(item, bytes):
            return item[0]
        return None if isinstance(item, float) and not math.isfinite(item) else item

    python = parameter_value_to_python(value)
    return [plain(item) for item in python] if isinstance(python, list) else plain(python)


def typed_value(text: str) -> dict[str, Any]:
    """The values of the ParameterValue that JSON text stands for.

    A JSON string holds YAML, as on ROS 2's command line: "5" is an integer, and "fast" a string. What no parameter can hold,
    e.g. an object, is a string with the text. Raises ValueError, and RecursionError for text that is nested too deeply.
    """
    value = json.loads(text)
    if isinstance(value, str):
        text = value
        value = _read_yaml(value)
    for kind, name in _KINDS:
        if isinstance(value, kind):
            return {"type": getattr(ParameterType, f"PARAMETER_{name.upper()}"), f"{name}_value": value}
        if isinstance(value, list) and all(isinstance(item, kind) for item in value):
            items = [kind(item) for item in value]
            return {"type": getattr(ParameterType, f"PARAMETER_{name.upper()}_ARRAY"), f"{name}_array_value": items}
    return {"type": ParameterType.PARAMETER_STRING, "string_value": text}


def _read_yaml(text: str) -> Any:
    if len(text) > MAX_YAML_CHARACTERS:
        return text
    try:
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError):  # ValueError: of a date such as 2024-13-45
        return text
