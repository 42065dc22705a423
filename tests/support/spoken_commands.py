"""Sentences for the voice agent as people say them: 60 commands with their calls, and 60 that ask for no motion."""

from __future__ import annotations

from typing import Any

from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.utterance import Context

NAMES = Names(
    locations=("home", "sink", "door", "charging station", "tag 5", "tag_6"),
    poses=("home", "high_look", "low-look"),
    sequences=("water", "wave", "prune_the_row"),
)
CONTEXT = Context(NAMES, speed_cap=0.5)

COMMANDS: dict[str, tuple[str, dict[str, Any]]] = {
    "drive forward half a metre per second for one second": ("drive", {"linear_x": 0.5, "duration_s": 1.0}),
    "drive back at point two metres per second for two seconds": ("drive", {"linear_x": -0.2, "duration_s": 2.0}),
    "drive sideways to the left at 0.1 metres per second for half a second": ("drive", {"linear_y": 0.1, "duration_s": 0.5}),
    "turn right at thirty degrees per second for one second": ("drive", {"angular_z": -0.523599, "duration_s": 1.0}),
    "brake": ("stop", {}),
    "stand still": ("stop", {}),
    "go to x two y minus one": ("nav_goto", {"x": 2.0, "y": -1.0}),
    "go to x one point five y three heading ninety degrees": ("nav_goto", {"x": 1.5, "y": 3.0, "yaw": 1.5708}),
    "go two metres forward": ("nav_forward", {"forward_m": 2.0}),
    "move back fifty centimetres": ("nav_forward", {"forward_m": -0.5}),
    "go one metre to the right": ("nav_forward", {"lateral_m": -1.0}),
    "go one and a half metres forward and one metre to the left": ("nav_forward", {"forward_m": 1.5, "lateral_m": 1.0}),
    "go two metres forward turned ninety degrees to the left": ("nav_forward", {"forward_m": 2.0, "rotate_deg": 90.0}),
    "turn left ninety degrees": ("rotate", {"angle_deg": 90.0}),
    "turn right by forty five degrees": ("rotate", {"angle_deg": -45.0}),
    "rotate one hundred and eighty degrees clockwise": ("rotate", {"angle_deg": -180.0}),
    "turn around": ("rotate", {"angle_deg": 180.0}),
    "make a quarter turn to the left": ("rotate", {"angle_deg": 90.0}),
    "speed cap fifty percent": ("set_speed_cap", {"value": 0.5}),
    "limit the speed to thirty percent": ("set_speed_cap", {"value": 0.3}),
    "full speed": ("set_speed_cap", {"value": 1.0}),
    "slower": ("set_speed_cap", {"value": 0.25}),
    "go faster": ("set_speed_cap", {"value": 1.0}),
    "cancel navigation": ("nav_cancel", {}),
    "cancel": ("nav_cancel", {}),
    "go to the sink": ("nav_goto_named", {"name": "sink"}),
    "go to tag five": ("nav_goto_named", {"name": "tag 5"}),
    "please return to the charging station": ("nav_goto_named", {"name": "charging station"}),
    "go home": ("nav_goto_named", {"name": "home"}),
    "list the locations": ("list_named_locations", {}),
    "which places do you know": ("list_named_locations", {}),
    "save here as kitchen": ("save_named_location", {"name": "kitchen"}),
    "remember this place as row two": ("save_named_location", {"name": "row 2"}),
    "open the gripper": ("gripper", {"action": "open"}),
    "close the gripper": ("gripper", {"action": "close"}),
    "gripper forty percent": ("gripper", {"action": "set", "percent": 40.0}),
    "open the gripper halfway": ("gripper", {"action": "set", "percent": 50.0}),
    "arm home": ("arm_preset", {"name": "home"}),
    "tuck the arm": ("arm_preset", {"name": "tuck"}),
    "move the arm to high look": ("arm_goto_pose", {"name": "high_look"}),
    "save the arm pose as over the pot": ("arm_save_pose", {"name": "over_the_pot"}),
    "list the poses and sequences": ("arm_list_library", {}),
    "run the sequence water at half speed": ("arm_run_sequence", {"name": "water", "speed": 0.5}),
    "play wave": ("arm_run_sequence", {"name": "wave"}),
    "freeze the arm": ("arm_stop", {}),
    "start recording": ("arm_record", {"action": "start"}),
    "start a kinesthetic recording called dance": ("arm_record", {"action": "start", "mode": "kinesthetic", "name": "dance"}),
    "save the recording as dance": ("arm_record", {"action": "save", "name": "dance"}),
    "discard the recording": ("arm_record", {"action": "cancel"}),
    "start calibration": ("calibrate_arm", {"action": "start"}),
    "commit": ("calibrate_arm", {"action": "commit"}),
    "cancel the calibration": ("calibrate_arm", {"action": "cancel"}),
    "calibration status": ("calibrate_arm", {"action": "status"}),
    "what is the battery": ("query_state", {"fields": ["battery"]}),
    "where are you": ("query_state", {"fields": ["pose"]}),
    "stop": ("engage_estop", {}),
    "stop the robot": ("engage_estop", {}),
    "say good morning": ("speak", {"text": "good morning"}),
    "lights blue": ("set_light", {"color": "blue"}),
    "lights automatic": ("set_light", {"mode": "auto"}),
}

NO_MOTION = (
    # negations
    "don't drive", "do not drive forward two metres", "never go to the sink", "do not open the gripper",
    "please don't turn left", "not the gripper", "no don't go home", "you shouldn't turn around",
    "don't you dare go to the sink",
    "go nowhere",
    # questions
    "can you drive?", "could you go to the sink?", "will you turn left ninety degrees", "did you go to the sink",
    "should I open the gripper", "go to the sink?", "why did you turn around", "is the gripper open", "how far is the sink",
    "what happens if you go two metres forward",
    # reported speech and talk
    "she said go to the sink", "he told me to open the gripper", "\"go to the sink\"", "I told it to turn left ninety degrees",
    "the manual says drive forward two metres", "yesterday it went to the sink", "I would go home if I were you",
    "we go to the sink every morning", "my arm hurts", "I'll be home at five", "the lights are blue today",
    "thank you for watching", "okay", "you", "let's have coffee", "turn it up a bit", "we are going to run out of water",
    "the tomatoes need water", "go on", "it is half past two",
    # two commands
    "go to the sink and open the gripper", "turn left ninety degrees then go two metres forward",
    "open the gripper and close the gripper", "go to the sink or the door", "arm home and lights blue",
    # out of range
    "go two hundred metres forward", "turn left five thousand degrees", "gripper three hundred percent",
    "drive forward at 0.2 metres per second for ten seconds", "drive forward at ninety metres per second for one second",
    "go to x five thousand y one", "run the sequence water at ten times speed",
    # incomplete
    "drive", "go forward", "turn left", "go two metres", "turn thirty degrees", "go to the", "run the sequence", "gripper",
)  # fmt: skip
