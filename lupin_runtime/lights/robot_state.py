"""What the robot is doing, as its own processes know it without a laptop."""

from __future__ import annotations

import enum
import json
from dataclasses import dataclass
from typing import NamedTuple

from lupin_runtime.home_report import ACTIVATING, ESTOPPED, FAILED, HOME, HOMING, RETRYING, RUNNING, HomeReport

JOINTS_SILENT_S = 3.0  # the vendor publishes joint states at 50 Hz or more
VENDOR_START_S = 120.0  # a vendor's stack without joint states after this time does not come up by itself
VENDOR_RETURN_S = (
    10.0  # a restart of the vendor's stack restarts this process, too: in a running one, joint states do not pause
)
AUTO_HOME_START_S = 10.0  # auto-home starts after this process is up; until then the arm may still move by itself


class RobotState(enum.Enum):
    """What the robot is doing."""

    WAITING = "waiting for vendor"
    HOMING = "homing"
    READY = "ready"
    HELP = "needs help"


class Judgement(NamedTuple):
    """The state, and why; the reason is empty for a robot that is ready."""

    state: RobotState
    reason: str = ""


@dataclass(frozen=True)
class Facts:
    """What the light strip's process knows. `joints_age_s` is None before the first joint states of the arm."""

    up_s: float
    joints_age_s: float | None
    home: HomeReport | None = None
    moves_home: bool = False  # auto-home has just sent the arm home, and it is still moving
    mission_lost: bool = False
    started_s: float = 0.0  # when this process started, in seconds since the boot


def judge(facts: Facts) -> Judgement:
    """Return what the robot is doing. What needs a person comes first, and what the arm waits for before what it does."""
    found = _judge_alone(facts)
    if not facts.mission_lost:
        return found
    reasons = ("the laptop fell silent during its mission: the robot stands", found.reason)
    return Judgement(RobotState.HELP, "; ".join(reason for reason in reasons if reason))


def _judge_alone(facts: Facts) -> Judgement:
    joints_age_s, home = facts.joints_age_s, facts.home
    if joints_age_s is None or joints_age_s > JOINTS_SILENT_S:
        is_late = facts.up_s > VENDOR_START_S if joints_age_s is None else joints_age_s > VENDOR_RETURN_S
        seen = "has not published the arm's joint states" if joints_age_s is None else "no longer publishes joint states"
        return Judgement(RobotState.HELP if is_late else RobotState.WAITING, f"the vendor's stack {seen}")
    is_earlier = home is not None and home.state not in RUNNING and home.at_s < facts.started_s  # of an earlier start
    if (home is None or is_earlier) and facts.up_s < AUTO_HOME_START_S:
        return Judgement(RobotState.WAITING, "auto-home may start yet")
    if home is None:
        return Judgement(RobotState.READY)
    if home.state == RETRYING:
        return Judgement(RobotState.WAITING, f"auto-home tries again, and then moves the arm: {home.reason}")
    if home.state == ACTIVATING:
        return Judgement(RobotState.WAITING, "auto-home activates the vendor's controllers")
    if home.state == HOMING or (home.state == HOME and facts.moves_home):
        return Judgement(RobotState.HOMING, "auto-home moves the arm")
    if home.state in (FAILED, ESTOPPED):
        return Judgement(RobotState.HELP, f"the arm is not home: {home.reason}")
    return Judgement(RobotState.READY)


NAME = "robot.json"


def state_text(judgement: Judgement, light: str, arm: bool, since_s: float) -> str:
    """Return the content of the file for `lupin onboard status`.

    `light` is the rule that the strip follows, `arm` whether joint states of the arm arrive, and `since_s` when this became so,
    in seconds since the boot.
    """
    plain = {"state": judgement.state.value, "reason": judgement.reason, "light": light, "arm": arm, "since_s": since_s}
    return json.dumps(plain) + "\n"
