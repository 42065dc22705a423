"""A program as a user of roslibpy writes it: it drives the robot, reads its odometry, and stops it. It uses nothing of Lupin.

    python roslibpy_program.py PORT

Prints what it saw as JSON. Exits with 1 if something does not happen within TIMEOUT_S.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable
from typing import Any

import roslibpy

TIMEOUT_S = 30.0
PERIOD_S = 0.1
LET_GO_EVERY = 15  # messages
SPEED_M_S = 0.2
REST_M_S = 0.005
DISTANCE_M = 0.05

robot = roslibpy.Ros("127.0.0.1", int(sys.argv[1]))
robot.run(timeout=TIMEOUT_S)

seen: dict[str, Any] = {"fastest_m_s": 0.0, "driven_m": 0.0}
state: dict[str, Any] = {"speed_m_s": None, "start": None, "stopped": None}


def receive_odometry(message: dict[str, Any]) -> None:
    """Keep the robot's speed and the distance from its start."""
    velocity, position = message["twist"]["twist"]["linear"], message["pose"]["pose"]["position"]
    state["start"] = state["start"] or position
    state["speed_m_s"] = math.hypot(velocity["x"], velocity["y"])
    seen["fastest_m_s"] = max(seen["fastest_m_s"], state["speed_m_s"])
    seen["driven_m"] = math.hypot(position["x"] - state["start"]["x"], position["y"] - state["start"]["y"])


def drive_until(condition: Callable[[], bool], what: str, speed: float = SPEED_M_S) -> None:
    """Send a velocity until the condition holds.

    After a stop of any kind, the drive bus ignores a stick until it was let go of. A busy machine may stop the robot for a
    moment when a process does not respond, so the stick is let go of now and then.
    """
    deadline_s = time.monotonic() + TIMEOUT_S
    sent = 0
    while not condition():
        if time.monotonic() > deadline_s:
            sys.exit(f"waited {TIMEOUT_S:g} s for {what}: {seen} {state}")
        drive.publish(roslibpy.Message({"linear": {"x": speed if sent % LET_GO_EVERY else 0.0}}))
        sent += 1
        time.sleep(PERIOD_S)


odometry = roslibpy.Topic(robot, "/mirte_base_controller/odom", "nav_msgs/Odometry")
odometry.subscribe(receive_odometry)
stop_state = roslibpy.Topic(robot, "/e_stop_state", "std_msgs/Bool")
stop_state.subscribe(lambda message: state.update(stopped=message["data"]))
drive = roslibpy.Topic(robot, "/cmd_vel_manual", "geometry_msgs/Twist")
stop = roslibpy.Topic(robot, "/lupin/hmi/estop", "std_msgs/Bool")

drive_until(lambda: seen["driven_m"] > DISTANCE_M, "motion")
stop.publish(roslibpy.Message({"data": True}))
drive_until(lambda: state["stopped"] is True and state["speed_m_s"] < REST_M_S, "a stop")
seen.update(was_stopped=state["stopped"], speed_while_stopped_m_s=state["speed_m_s"])
stop.publish(roslibpy.Message({"data": False}))
drive_until(lambda: state["stopped"] is False, "the release", speed=0.0)
seen.update(is_stopped=state["stopped"])
seen["topics"] = roslibpy.Service(robot, "/rosapi/topics", "rosapi/Topics").call(roslibpy.ServiceRequest(), timeout=TIMEOUT_S)[
    "topics"
]
robot.terminate()
print(json.dumps(seen))
