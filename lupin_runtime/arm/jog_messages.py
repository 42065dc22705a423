"""The message of a jog: rates by the names of joints, in a JointState, whose `frame_id` names the source."""

from __future__ import annotations

from typing import Any

from lupin_runtime.arm.jog import AXES, JogRates

_MAX_SOURCE = 100  # letters of its name, which the arm's status and the log repeat


def jog_rates(message: Any) -> JogRates:
    """Return the rates (rad/s) of a JointState; joints that are not named rest.

    Raises ValueError for a joint that is not the arm's, is named twice or has no rate, as of any message from the network.
    """
    names, rates = list(message.name), list(message.velocity)
    if len(names) != len(rates) or len(set(names)) != len(names) or not set(names) <= set(AXES):
        raise ValueError(
            f"expected a rate for each of some joints of {', '.join(AXES)}; found {names[:8]} with {len(rates)} rates"
        )
    by_name = dict(zip(names, rates))
    pan, lift, elbow, wrist, gripper = (float(by_name.get(joint, 0.0)) for joint in AXES)
    source = "".join(letter for letter in message.header.frame_id[:_MAX_SOURCE] if letter.isprintable())
    return JogRates(source or "an unnamed source", (pan, lift, elbow, wrist), gripper)
