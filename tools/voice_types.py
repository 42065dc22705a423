"""What the page knows of the voice agent's tools: their table, and the TypeScript types of their arguments."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from lupin_runtime.voice.arguments import Argument, Kind
from lupin_runtime.voice.tools import TOOLS


def described_tools() -> dict[str, dict[str, Any]]:
    """Return each tool's columns by its name."""
    return {
        tool.name: {
            "effect": tool.effect.name.lower(),
            "gate": tool.gate.name.lower(),
            "needsPose": tool.needs_pose,
            "isReadBack": bool(tool.read_back),
            "results": tool.results,
        }
        for tool in TOOLS
    }


def argument_types() -> Iterator[str]:
    """Return a row of an interface for each tool: its name, and the type of its arguments."""
    for tool in TOOLS:
        fields = "; ".join(_field(argument) for argument in tool.parameters)
        yield f"{tool.name}: {f'{{ {fields} }}' if fields else 'object'};"


def _field(argument: Argument) -> str:
    choices = " | ".join(json.dumps(choice) for choice in argument.choices)
    kinds = {Kind.NUMBER: "number", Kind.CHOICE: choices, Kind.CHOICES: f"({choices})[]"}
    return f"{argument.name}{'' if argument.required else '?'}: {kinds.get(argument.kind, 'string')}"
