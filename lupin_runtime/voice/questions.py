"""What the operator is asked about a call that its sender doubts, whatever the tool."""

from __future__ import annotations

import contextlib

from lupin_runtime.voice.arguments import Values
from lupin_runtime.voice.tools import Tool

ASK = "ask"  # as the confirmation of a call: it is read back, whatever it is
# By tool and action, as the sentences of `Tool.read_back` are; of several templates, the first one whose arguments are given.
QUESTIONS: dict[str, dict[str, tuple[str, ...]]] = {
    "drive": {
        "": (
            "drive {linear_x:+g} m/s forward and {linear_y:+g} m/s to the left, turning by {angular_z:+g} rad/s, "
            "for {duration_s:g} s",
        )
    },
    "set_speed_cap": {"": ("set the speed cap to {value:g}",)},
    "save_named_location": {"": ("save the robot's place as {name}",)},
    "arm_save_pose": {"": ("save the arm's pose as {name}",)},
    "arm_record": {"save": ("save the recording as {name}", "save the recording"), "cancel": ("discard the recording",)},
    "calibrate_arm": {"cancel": ("cancel the calibration",)},
    "set_light": {"": ("let the light strip show the robot's state ({mode})", "set the light strip to {color}")},
}


def question(tool: Tool, arguments: Values) -> str:
    """Return what is asked of a call with these checked arguments: what is read back in any case, or a sentence like it."""
    for template in QUESTIONS.get(tool.name, {}).get(arguments.get("action", ""), ()):
        with contextlib.suppress(KeyError):  # of an argument that is absent
            return template.format(**arguments)
    fields = ", ".join(f"{name} {value}" for name, value in arguments.items())
    return tool.sentence(arguments) or f"{tool.name.replace('_', ' ')}: {fields}".removesuffix(": ")
