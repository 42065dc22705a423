"""Ids of findings that disappear once the machines can communicate again; a broken link or discovery explains them.

Only findings about what is observed over a graph belong here.
"""

from __future__ import annotations

# These are observed over DDS: while discovery or the link is broken, they describe that fault and not the robot.
SEEN_OVER_THE_GRAPH = frozenset(
    {
        "camera-silent",
        "controller-manager-missing",
        "controller-manager-silent",
        "controllers-not-active",
        "drive-sink-unheard",
        "graph-not-visited",
        "names-no-samples",
        "one-way-data",
        "topic-silent",
    }
)

# The robot cannot be asked at all.
ROBOT_UNREACHABLE = frozenset({"robot-unreachable"})
