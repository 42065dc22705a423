"""Converts parameter values between ROS and the JSON text that rosapi uses for them."""

from __future__ import annotations

import json
import math
from typing import Any

import yaml
from rcl_interfaces.msg import ParameterType, ParameterValue
from rclpy.parameter import parameter_value_to_python

from lupin_runtime.json_text import parse_json
from lupin_runtime.yaml_text import load_yaml

# Longer text is not parsed as YAML: for a megabyte that would block the executor's thread for seconds.
MAX_YAML_CHARACTERS = 4096
_KINDS = ((bool, "bool"), (int, "integer"), (float, "double"), (str, "string"))


def normalize_json(text: str) -> str:
    """Return JSON text in Python's format; an empty JSON string if `text` is not JSON."""
    try:
        return json.dumps(parse_json(text), allow_nan=False)
    except ValueError:
        return '""'


def plain_value(value: ParameterValue) -> Any:
    """Convert a parameter's value for JSON, which has neither bytes nor NaN."""

    def plain(item: Any) -> Any:
        if isinstance(item, bytes):
            return item[0]
        return None if isinstance(item, float) and not math.isfinite(item) else item

    python = parameter_value_to_python(value)
    return [plain(item) for item in python] if isinstance(python, list) else plain(python)


def typed_value(text: str) -> dict[str, Any]:
    """Convert JSON text to the fields of a ParameterValue.

    The content of a JSON string is YAML, as on ROS 2's command line: "5" is an integer, "fast" a string. A value that no
    parameter can have, such as an object, becomes a string with the text. Raises ValueError.
    """
    value = parse_json(text)
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
        return load_yaml(text)
    except (yaml.YAMLError, ValueError, RecursionError):  # ValueError: for a date such as 2024-13-45
        return text
