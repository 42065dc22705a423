"""Every source of motion, as ReleaseRig measures it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from lupin_runtime import graph
from tests.support.release_rig import ReleaseRig


def _nothing(_: ReleaseRig) -> None:
    return


@dataclass(frozen=True)
class Case:
    """A source of motion: how it starts, what it does while the e-stop is engaged, a newer command, and its end."""

    name: str
    start: Callable[[ReleaseRig], None]
    newer: Callable[[ReleaseRig], None]
    engaged: Callable[[ReleaseRig], None] = _nothing
    end: Callable[[ReleaseRig], None] = _nothing


def _held(name: str, row: graph.Topic, silent_s: float = 0.0) -> Case:
    """A stream that never rests, whatever the e-stop does."""
    return Case(name, lambda rig: rig.rest_then_stream(row), lambda rig: rig.rest_then_stream(row, silent_s))


def _hold_beside_console_at_rest(rig: ReleaseRig) -> None:
    rig.rest_then_stream(graph.CMD_VEL_MANUAL)


def _rest_on_another_console(rig: ReleaseRig) -> None:
    rig.stream(graph.CMD_VEL_MANUAL, 0.0, number=1)


def _leave_one_console(rig: ReleaseRig) -> None:
    rig.stream(graph.CMD_VEL_MANUAL, None, number=1)
    rig.rest_then_stream(graph.CMD_VEL_MANUAL)


CASES = (
    Case("NavigateToPose of another client", ReleaseRig.go, ReleaseRig.go, end=ReleaseRig.cancel),
    Case("NavigateToPose, sent again while engaged", ReleaseRig.go, ReleaseRig.go, ReleaseRig.go, ReleaseRig.cancel),
    Case("NavigateThroughPoses", ReleaseRig.go_through, ReleaseRig.go_through, end=ReleaseRig.cancel),
    Case("/goal_pose", ReleaseRig.click, ReleaseRig.click, ReleaseRig.click, ReleaseRig.cancel),
    _held("stick held, /cmd_vel_manual", graph.CMD_VEL_MANUAL),
    _held("stick held, /cmd_vel_joy", graph.CMD_VEL_JOY),
    Case(
        "stick held beside a console at rest, /cmd_vel_manual",
        _hold_beside_console_at_rest,
        _leave_one_console,
        _rest_on_another_console,
    ),
    _held("foreign stream, /cmd_vel_auto, rests", graph.CMD_VEL_AUTO),
    _held("foreign stream, /cmd_vel_auto, goes silent", graph.CMD_VEL_AUTO, silent_s=3.0),
    _held("foreign stream, /cmd_vel_nav", graph.CMD_VEL_NAV),
    Case("arm preset", ReleaseRig.other_preset, ReleaseRig.other_preset),
    Case("arm replay", ReleaseRig.play, ReleaseRig.play, end=lambda rig: rig.call(graph.ARM_LIBRARY_STOP)),
    Case(
        "arm trajectory of another publisher",
        ReleaseRig.send_trajectory,
        ReleaseRig.send_trajectory,
        ReleaseRig.send_trajectory,
    ),
    Case("gripper goal of another client", ReleaseRig.grip, ReleaseRig.grip),
    Case(
        "mission",
        ReleaseRig.start_mission,
        lambda rig: rig.call(graph.MISSION_RESUME),
        end=ReleaseRig.abort_mission,
    ),
)
