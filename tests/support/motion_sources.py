"""All sources of motion, for `ReleaseRig.measure`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

from lupin_runtime import graph
from tests.support.release_rig import ReleaseRig


def _nothing(_: ReleaseRig) -> None:
    return


@dataclass(frozen=True)
class MotionSource:
    """A source of motion: how it starts, acts while the e-stop is engaged, gives a newer command, and stops."""

    name: str
    start: Callable[[ReleaseRig], None]
    newer_command: Callable[[ReleaseRig], None]
    while_engaged: Callable[[ReleaseRig], None] = _nothing
    stop: Callable[[ReleaseRig], None] = _nothing


def _stream(name: str, row: graph.Topic, silent_s: float = 0.0) -> MotionSource:
    """Return a stream that ignores the e-stop. Its newer command follows zero, or `silent_s` without messages."""
    return MotionSource(name, lambda rig: rig.zero_then_stream(row), lambda rig: rig.zero_then_stream(row, silent_s))


def _stream_beside_resting_console(rig: ReleaseRig) -> None:
    rig.zero_then_stream(graph.CMD_VEL_MANUAL)


def _start_resting_console(rig: ReleaseRig) -> None:
    rig.stream(graph.CMD_VEL_MANUAL, 0.0, number=1)


def _stop_resting_console(rig: ReleaseRig) -> None:
    rig.stream(graph.CMD_VEL_MANUAL, None, number=1)
    rig.zero_then_stream(graph.CMD_VEL_MANUAL)


SOURCES = (
    MotionSource("NavigateToPose of another client", ReleaseRig.go, ReleaseRig.go, stop=ReleaseRig.cancel),
    MotionSource("NavigateToPose, sent again while engaged", ReleaseRig.go, ReleaseRig.go, ReleaseRig.go, ReleaseRig.cancel),
    MotionSource("NavigateThroughPoses", ReleaseRig.go_through, ReleaseRig.go_through, stop=ReleaseRig.cancel),
    MotionSource(
        "/goal_pose",
        ReleaseRig.publish_goal_pose,
        ReleaseRig.publish_goal_pose,
        ReleaseRig.publish_goal_pose,
        ReleaseRig.cancel,
    ),
    _stream("stick held, /cmd_vel_manual", graph.CMD_VEL_MANUAL),
    _stream("stick held, /cmd_vel_joy", graph.CMD_VEL_JOY),
    MotionSource(
        "stick held beside a console at rest, /cmd_vel_manual",
        _stream_beside_resting_console,
        _stop_resting_console,
        _start_resting_console,
    ),
    _stream("stream of another publisher, /cmd_vel_auto, sends zero", graph.CMD_VEL_AUTO),
    _stream("stream of another publisher, /cmd_vel_auto, goes silent", graph.CMD_VEL_AUTO, silent_s=3.0),
    _stream("stream of another publisher, /cmd_vel_nav", graph.CMD_VEL_NAV),
    _stream("jog held, /lupin/arm/jog", graph.ARM_JOG),
    MotionSource("arm preset", ReleaseRig.other_preset, ReleaseRig.other_preset),
    MotionSource("arm replay", ReleaseRig.play, ReleaseRig.play, stop=lambda rig: rig.call(graph.ARM_LIBRARY_STOP)),
    MotionSource(
        "arm trajectory of another publisher",
        ReleaseRig.send_trajectory,
        ReleaseRig.send_trajectory,
        ReleaseRig.send_trajectory,
    ),
    MotionSource("gripper goal of another client", ReleaseRig.grip, ReleaseRig.grip),
    MotionSource(
        "mission",
        ReleaseRig.start_mission,
        lambda rig: rig.call(graph.MISSION_RESUME),
        stop=ReleaseRig.abort_mission,
    ),
)


def find_source(name: str) -> MotionSource:
    """Return the source with this name."""
    return next(source for source in SOURCES if source.name == name)


def combined(*sources: MotionSource) -> MotionSource:
    """Return the source that consists of several, which act at once. Its newer command is that of the last one."""

    def start(rig: ReleaseRig) -> None:
        for one in sources:
            one.start(rig)

    def act_while_engaged(rig: ReleaseRig) -> None:
        for one in sources:
            one.while_engaged(rig)

    def stop(rig: ReleaseRig) -> None:
        for one in sources:
            one.stop(rig)

    return MotionSource(" + ".join(one.name for one in sources), start, sources[-1].newer_command, act_while_engaged, stop)


# In this order: the first ones take longest to start.
_COMBINED = tuple(
    map(find_source, ("mission", "arm replay", "/goal_pose", "NavigateToPose of another client", "stick held, /cmd_vel_manual"))
)
COMBINATIONS = tuple(combined(*chosen) for size in range(2, len(_COMBINED) + 1) for chosen in combinations(_COMBINED, size))
ALL_AT_ONCE = combined(*_COMBINED[1:2], *_COMBINED[3:])
