"""The layers of the path between laptop and robot, lowest first, and the parts of a robot that deliver data over it.

A fault in one layer breaks those above it: the first failing layer is the cause, and the others are consequences. Every
finding belongs to a layer.
"""

from __future__ import annotations

from lupin_runtime.graph import LIDAR, MOTOR_BOARD, ROS2_CONTROL, Topic

# Layer → what a fault in it is about. The order is that of the path.
LAYERS = {
    "carrier": "interfaces, cable, radio",
    "address": "the addresses in use",
    "route": "routes in both directions",
    "mtu": "packets of DDS size",
    "loss": "packets lost or late at random",
    "ports": "UDP ports in both directions",
    "login": "SSH and the robot's account",
    "machine": "disk, memory, heat",
    "clock": "wall clocks",
    "release": "Lupin's files on the robot",
    "processes": "units and processes",
    "devices": "cameras, motor board, battery",
    "shared-memory": "files in /dev/shm",
    "discovery": "the discovery server",
    "profile": "Fast DDS profiles",
    "environment": "variables of processes and shells",
    "endpoints": "publishers and subscriptions that do not match",
    "samples": "topics, stamps, commands",
}

# Parts of a robot whose data is lost together: its publishers by `lupin_runtime.graph`, and what a drive command needs.
EVERYTHING = "everything"
LUPIN = "Lupin's onboard service"
DRIVE = "drive commands"
STAMPS = "current stamps"  # not a part: data that arrives with stamps too far from the clock is lost to its users
LIDAR_PART, BASE_PART, BOARD_PART = (name.removeprefix("vendor: ") for name in (LIDAR, ROS2_CONTROL, MOTOR_BOARD))
ONBOARD_PROCESSES = ("drive", "estop", "body")


def part_of(topic: Topic) -> str:
    """Return the part of the robot that publishes a topic."""
    if any(publisher in ONBOARD_PROCESSES for publisher in topic.publishers) and not topic.from_vendor:
        return LUPIN
    return topic.publishers[0].removeprefix("vendor: ")
