"""The tools as a model gets them: function declarations with the JSON schema of the arguments."""

from __future__ import annotations

from typing import Any

from lupin_runtime.voice.tools import TOOLS, Tool


def function_declarations() -> list[dict[str, Any]]:
    """Return the `functionDeclarations` of Gemini's Live API (https://ai.google.dev/api/caching#FunctionDeclaration)."""
    return [_declaration(tool) for tool in TOOLS]


def _declaration(tool: Tool) -> dict[str, Any]:
    declared: dict[str, Any] = {"name": tool.name, "description": tool.description}
    if tool.parameters:
        declared["parameters"] = {
            "type": "object",
            "properties": {argument.name: argument.schema() for argument in tool.parameters},
            "required": [argument.name for argument in tool.parameters if argument.required],
        }
    return declared
