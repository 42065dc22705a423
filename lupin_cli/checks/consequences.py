"""What goes away by itself once machines hear each other again: one root explains all of it.

The names are those of findings, not of checks. A finding that no graph can cause never stands here.
"""

from __future__ import annotations

# Seen over DDS: where discovery or the way is broken, they tell of the break and not of the robot.
SEEN_OVER_THE_GRAPH = frozenset(
    {
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

# The robot can't be asked at all.
NOBODY_ANSWERS = frozenset({"robot-unreachable"})
