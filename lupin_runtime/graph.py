"""The contract of the ROS graph: every topic, service, action and frame, each defined once with its type and QoS.

A topic row also says who publishes it, how it is recorded, and who watches it. Nodes, recorder, graph monitor, doctor and docs
read these rows, so adding a topic is adding one line. Names are written only here, because the vendor's names differ from what
one would guess (`/battery_state`, `/imu/data` and `cmd_vel_unstamped` do not exist on the robot).

This module does not import rclpy: `lupin_runtime.ros` turns the rows into publishers and subscriptions.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from math import inf
from typing import TypeVar

# -- frames (REP-105; there is no base_footprint) ---------------------------------------------------------------------
MAP_FRAME = "map"
ODOM_FRAME = "odom"
BASE_FRAME = "base_link"
LASER_FRAME = "laser"
BODY_CAMERA_FRAME = "camera_color_optical_frame"
GRIPPER_CAMERA_FRAME = "gripper_camera_optical_frame"
TAG_FRAME_PREFIX = "tag_"

ARM_JOINTS = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_joint")
GRIPPER_JOINT = "gripper_joint"
WHEEL_JOINTS = ("front_left_wheel_joint", "rear_left_wheel_joint", "rear_right_wheel_joint", "front_right_wheel_joint")

CONTROLLERS = (
    "joint_state_broadcaster",
    "mirte_master_arm_controller",
    "mirte_master_gripper_controller",
    "pid_wheels_controller",
    "mirte_base_controller",
)


@dataclass(frozen=True)
class Qos:
    """The quality of service that a publisher offers. `depth` is the queue length, in messages, for a slow or late reader."""

    reliable: bool
    latched: bool = False
    depth: int = 10


# REL: reliable, BEST: best effort; the number is the depth.
LATCHED1 = Qos(reliable=True, latched=True, depth=1)
LATCHED50 = Qos(reliable=True, latched=True, depth=50)
STATIC_TF = Qos(reliable=True, latched=True, depth=100)
REL1 = Qos(reliable=True, depth=1)
REL5 = Qos(reliable=True, depth=5)
REL10 = Qos(reliable=True, depth=10)
REL100 = Qos(reliable=True, depth=100)
BEST1 = Qos(reliable=False, depth=1)
BEST5 = Qos(reliable=False, depth=5)
BEST100 = Qos(reliable=False, depth=100)

# Publishers: a process of the stack table (`lupin_runtime.stack.table`) by its name, or one of these. In a simulated run the
# process `sim` publishes what the vendor's software publishes on the robot.
LIDAR = "vendor: lidar"
ROS2_CONTROL = "vendor: ros2_control"
MOTOR_BOARD = "vendor: motor board"
CAMERAS = "vendor: cameras"
OPERATOR = "operator"  # a console, a gamepad or RViz
EVERY_NODE = "every node"
VENDOR_PUBLISHERS = (LIDAR, ROS2_CONTROL, MOTOR_BOARD, CAMERAS)
EXTERNAL_PUBLISHERS = (*VENDOR_PUBLISHERS, OPERATOR, EVERY_NODE)

# Who may publish a topic, call a service or send a goal through the console: nobody, every client, or only the session
# that has control.
BY_NOBODY = ""
BY_VIEWER = "viewer"
BY_OPERATOR = "operator"

MIN_RATE = 0.4  # share of its nominal rate below which a topic is of no use
UNTIMED_HZ = 1.0  # up to this nominal rate, one sample is enough: nobody waits for the next one
ALL = inf  # as `recorded_hz`: every message is recorded


@dataclass(frozen=True)
class Topic:
    """A topic and every fact that the rest of the system needs about it.

    `type` is `package/msg/Name`, `qos` is what the publisher offers, and `rate_hz` is the nominal rate (None: published on
    change). `publishers` names processes of the stack table or EXTERNAL_PUBLISHERS.

    `recorded_hz` is the highest rate in a run's recording: ALL records every message, 0 records none.
    `repeats`: it is published continuously while its publisher works, so silence is a fault that the doctor reports.
    `probed`: the doctor waits for a sample although the topic may be silent on a healthy graph.
    `monitored`: `lupin up` measures its rate, and reports silence if the topic also repeats.
    `console`: who may publish it through the console, as one of the BY constants.
    `moves`: it can lead to motion of the wheels or the arm, so a page sends it only once its operator has opened it for that.
    `frame`: the frame in its header; empty if any will do, None if the message has no header.
    """

    name: str
    type: str
    qos: Qos
    rate_hz: float | None = None
    publishers: tuple[str, ...] = ()
    recorded_hz: float = 0.0
    repeats: bool = False
    probed: bool = False
    monitored: bool = False
    note: str = ""
    console: str = BY_NOBODY
    moves: bool = False
    frame: str | None = None

    @property
    def from_vendor(self) -> bool:
        """Whether the vendor's software publishes it on the robot."""
        return any(publisher in VENDOR_PUBLISHERS for publisher in self.publishers)


@dataclass(frozen=True)
class Service:
    """A service: name, type as `package/srv/Name`, who may call it through the console, and whether it `moves`, as of a Topic."""

    name: str
    type: str
    note: str = ""
    console: str = BY_NOBODY
    moves: bool = False


@dataclass(frozen=True)
class Action:
    """An action: name, type as `package/action/Name`, who may send goals through the console, and whether it `moves`."""

    name: str
    type: str
    note: str = ""
    console: str = BY_NOBODY
    moves: bool = False


_Row = TypeVar("_Row", Topic, Service, Action)

# fmt: off
# -- the drive bus ----------------------------------------------------------------------------------------------------
# The sinks are best effort on both targets: a reliable subscriber would receive nothing, and no error would be reported.
CMD_VEL_JOY = Topic("/cmd_vel_joy", "geometry_msgs/msg/Twist", REL10, 20.0, (OPERATOR, "joystick"), ALL, note="gamepad with a dead-man button; silent when it is released")
CMD_VEL_MANUAL = Topic("/cmd_vel_manual", "geometry_msgs/msg/Twist", REL10, 20.0, (OPERATOR, "console"), ALL, note="joystick of a console", console=BY_OPERATOR, moves=True)
CMD_VEL_ENGINE = Topic("/lupin/nav/cmd_vel", "geometry_msgs/msg/Twist", REL10, 20.0, ("nav",), ALL, note="with `--engine nav2=system`: Nav2's controller and behaviors -> the gate before `/cmd_vel_nav`")
CMD_VEL_NAV = Topic("/cmd_vel_nav", "geometry_msgs/msg/Twist", REL10, 20.0, ("nav",), ALL, monitored=True, note="navigation's controller -> velocity smoother")
CMD_VEL_AUTO = Topic("/cmd_vel_auto", "geometry_msgs/msg/Twist", REL10, 20.0, ("nav",), ALL, note="velocity smoother -> drive bus")
ZERO_CMD_VEL = Topic("/zero_cmd_vel", "geometry_msgs/msg/Twist", REL10, 10.0, ("drive",), note="simulation only: a constant zero, the drive bus's input of lowest priority")
CMD_VEL_SINK_ROBOT = Topic("/mirte_base_controller/cmd_vel", "geometry_msgs/msg/Twist", BEST1, 20.0, ("drive",), ALL, note="what the drive bus sends to the robot's base")
CMD_VEL_SINK_SIM = Topic("/cmd_vel", "geometry_msgs/msg/Twist", BEST1, 20.0, ("drive",), ALL, note="what the drive bus sends to the simulated base")
DRIVE_STATUS = Topic("/lupin/drive/status", "std_msgs/msg/String", LATCHED1, 1.0, ("drive",), probed=True, note="JSON: the input that drives, why the bus is locked, alarms, and the age of each input")

# -- sensors and state of the vehicle ---------------------------------------------------------------------------------
CLOCK = Topic("/clock", "rosgraph_msgs/msg/Clock", BEST1, 100.0, ("sim",), repeats=True, note="simulation only")
ODOM = Topic("/mirte_base_controller/odom", "nav_msgs/msg/Odometry", REL10, 50.0, (ROS2_CONTROL,), ALL, repeats=True, frame=ODOM_FRAME)
ODOM_SIM = Topic("/odom", "nav_msgs/msg/Odometry", REL10, 50.0, ("sim",), note="simulation only: the same odometry under Gazebo's name")
SCAN = Topic("/scan", "sensor_msgs/msg/LaserScan", BEST5, 10.0, (LIDAR,), ALL, repeats=True, monitored=True, frame=LASER_FRAME)
IMU = Topic("/io/imu/movement/data", "sensor_msgs/msg/Imu", REL10, 50.0, (MOTOR_BOARD,), 10.0, repeats=True, frame="")
BATTERY = Topic("/io/power/power_watcher", "sensor_msgs/msg/BatteryState", REL10, 1.0, (MOTOR_BOARD,), ALL, repeats=True)
JOINT_STATES = Topic("/joint_states", "sensor_msgs/msg/JointState", REL10, 50.0, (ROS2_CONTROL,), 10.0, repeats=True, frame="")
ESTOP_BUTTON = Topic("/io/intensity/emergency_button/digital", "mirte_msgs/msg/IntensityDigital", REL10, 10.0, (MOTOR_BOARD,), 2.0, repeats=True)
TF = Topic("/tf", "tf2_msgs/msg/TFMessage", REL100, 50.0, (ROS2_CONTROL, "slam", "localization", "perception"), ALL, repeats=True)
TF_STATIC = Topic("/tf_static", "tf2_msgs/msg/TFMessage", STATIC_TF, None, (ROS2_CONTROL,), ALL)
ROBOT_DESCRIPTION = Topic("/robot_description", "std_msgs/msg/String", LATCHED1, None, (ROS2_CONTROL,), ALL, note="the URDF; its links are frames of /tf")

# The body camera has a different topic name on each target; a console or an annotator uses the name of its target.
BODY_IMAGE_SIM = Topic("/camera/image_raw", "sensor_msgs/msg/Image", REL1, 10.0, ("sim",))
BODY_IMAGE_ROBOT = Topic("/camera/color/image_raw", "sensor_msgs/msg/Image", REL1, 30.0, (CAMERAS,))
GRIPPER_IMAGE = Topic("/gripper_camera/image_raw", "sensor_msgs/msg/Image", REL1, 10.0, (CAMERAS,))

# -- safety -----------------------------------------------------------------------------------------------------------
ESTOP_STATE = Topic("/e_stop_state", "std_msgs/msg/Bool", REL10, 5.0, ("estop",), ALL, repeats=True, monitored=True)
HMI_ESTOP = Topic("/lupin/hmi/estop", "std_msgs/msg/Bool", REL10, 2.0, (OPERATOR,), ALL, note="stop button of one console; true engages the e-stop, and so does silence of all consoles after a first message", console=BY_OPERATOR)
CONSOLE_STOP = Topic("/lupin/console/stop", "std_msgs/msg/String", REL10, 2.0, ("console",), ALL, note="JSON: whether a client of the console engages the stop, whether one is driving, and how often the stop was released")
ESTOP_MISSED_PRESS = Topic("/lupin/estop/missed_press", "std_msgs/msg/Bool", LATCHED1, None, ("drive",), ALL, note="true after a press that the e-stop's process missed because it hung or was being replaced, until the e-stop has engaged; also while the button, once received, is silent, and while the button is held or a lost console has left its stop after that process was gone")
ESTOP_STATUS = Topic("/lupin/estop/status", "std_msgs/msg/String", LATCHED1, 1.0, ("estop",), probed=True, note="JSON: every reason for the e-stop, how often it was pressed, and how long ago it was engaged")

# -- mapping and navigation -------------------------------------------------------------------------------------------
MAP = Topic("/map", "nav_msgs/msg/OccupancyGrid", LATCHED1, 0.2, ("slam", "localization"), ALL, monitored=True)
AMCL_POSE = Topic("/amcl_pose", "geometry_msgs/msg/PoseWithCovarianceStamped", LATCHED1, None, ("localization", "mission"), ALL)
INITIAL_POSE = Topic("/initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped", REL1, None, (OPERATOR,), console=BY_OPERATOR)
PLAN = Topic("/plan", "nav_msgs/msg/Path", REL1, None, ("nav",), 2.0)
GOAL_POSE = Topic("/goal_pose", "geometry_msgs/msg/PoseStamped", REL1, None, (OPERATOR,), ALL, console=BY_OPERATOR, moves=True)
GOAL_MARKERS = Topic("/lupin/markers/goals", "visualization_msgs/msg/MarkerArray", LATCHED1, None, ("nav",), ALL, note="the poses of the active goal")
GLOBAL_COSTMAP = Topic("/global_costmap/costmap", "nav_msgs/msg/OccupancyGrid", LATCHED1, 1.0, ("nav",), 0.2)
LOCAL_COSTMAP = Topic("/local_costmap/costmap", "nav_msgs/msg/OccupancyGrid", LATCHED1, 2.0, ("nav",), 1.0)

# -- perception, greenhouse, mission, twin ------------------------------------------------------------------------------
TAG_DETECTIONS = Topic("/camera/tag_detections_json", "std_msgs/msg/String", REL5, None, ("perception",), ALL)
FLOWER_DETECTIONS = Topic("/yolo/detections", "std_msgs/msg/String", REL5, None, ("perception",), ALL)
YOLO_OVERLAY = Topic("/yolo/image_detections", "sensor_msgs/msg/Image", REL1, None, ("perception",))
FLOWER_OVERLAY = Topic("/sim_flower/overlay", "sensor_msgs/msg/Image", REL1, None, ("perception",))
BOX_GEOMETRY = Topic("/perception/box_geometry_json", "std_msgs/msg/String", LATCHED1, None, ("perception",), ALL)
DISCOVERED_TAGS = Topic("/perception/discovered_tags", "lupin_msgs/msg/DiscoveredTags", LATCHED1, 2.0, ("perception",), ALL)
TAG_MARKERS = Topic("/lupin/markers/tags", "visualization_msgs/msg/MarkerArray", LATCHED1, None, ("perception",), ALL, note="the discovered tags")
BOX_MARKERS = Topic("/lupin/markers/boxes", "visualization_msgs/msg/MarkerArray", LATCHED1, None, ("perception",), ALL, note="the boxes behind the discovered tags")
OBSERVATIONS = Topic("/floranova/observations", "lupin_msgs/msg/Observation", LATCHED50, None, ("perception", "mission"), ALL)
MISSION_STATE = Topic("/mission/state", "lupin_msgs/msg/MissionState", LATCHED1, 5.0, ("mission",), ALL, probed=True, monitored=True)
TWIN_STATE = Topic("/twin/state", "lupin_msgs/msg/TwinState", LATCHED1, 1.0, ("twin",), ALL, probed=True)

# -- arm, lights, log -------------------------------------------------------------------------------------------------
ARM_TRAJECTORY = Topic("/mirte_master_arm_controller/joint_trajectory", "trajectory_msgs/msg/JointTrajectory", REL10, None, ("body", "drive"), ALL)
ARM_JOG = Topic("/lupin/arm/jog", "sensor_msgs/msg/JointState", REL10, 20.0, (OPERATOR, "joystick"), ALL, note="rates (`velocity`, rad/s) of arm joints and gripper while a gamepad moves them, zeros before and after, else silent; `frame_id` names the source")
ARM_STATUS = Topic("/lupin/arm/status", "std_msgs/msg/String", LATCHED1, 1.0, ("body",), ALL, note="JSON: what has reserved the arm, whether it moves, why a jog is refused, joints that do not follow, how long the arm was held extended, alarms")
JOY = Topic("/joy", "sensor_msgs/msg/Joy", REL10, 20.0, (OPERATOR, "joystick"), note="while a gamepad is connected: left, forward and turn as -1..1; dead-man and turbo button")
LEDS_STATUS = Topic("/lupin/leds/status", "std_msgs/msg/String", LATCHED1, None, ("body",), note="the rule by which the light strip shows its light, such as `set by hand`")
ARM_LIBRARY_STATE = Topic("/lupin/arm/library/state", "std_msgs/msg/String", LATCHED1, 5.0, ("body",))
ROSOUT = Topic("/rosout", "rcl_interfaces/msg/Log", REL100, None, (EVERY_NODE,), ALL)

# -- the simulator's own inputs ---------------------------------------------------------------------------------------
SIM_BATTERY = Topic("/sim/battery_percentage", "std_msgs/msg/Float32", REL10, None, (OPERATOR,), note="simulation only: sets the charge, 0..1")
SIM_FAULT = Topic("/sim/fault", "std_msgs/msg/String", REL10, None, (OPERATOR,), note="simulation only: breaks a sensor, e.g. `scan frozen`")
# fmt: on

# Servos of the vendor's bus: an arm joint without its suffix, or `gripper`.
SERVO_NAMESPACE = "/io/servo/hiwonder"
SERVOS = (*(joint[: -len("_joint")] for joint in ARM_JOINTS), "gripper")


def compressed(image: Topic) -> Topic:
    """Return the JPEG topic that belongs to a raw image topic."""
    return replace(image, name=image.name + "/compressed", type="sensor_msgs/msg/CompressedImage")


def camera_info(image: Topic) -> Topic:
    """Return the topic of a camera's calibration, which comes with every raw image. The doctor waits for it, since it is small."""
    name = image.name.rsplit("/", 1)[0] + "/camera_info"
    return replace(image, name=name, type="sensor_msgs/msg/CameraInfo", probed=True, recorded_hz=1.0)


# -- services ---------------------------------------------------------------------------------------------------------
MISSION_START = Service("/mission/start", "lupin_msgs/srv/StartMission", console=BY_OPERATOR, moves=True)
MISSION_PAUSE = Service("/mission/pause", "std_srvs/srv/Trigger", console=BY_OPERATOR)
MISSION_RESUME = Service("/mission/resume", "std_srvs/srv/Trigger", console=BY_OPERATOR, moves=True)
MISSION_ABORT = Service("/mission/abort", "std_srvs/srv/Trigger", "drives to the dock", console=BY_OPERATOR, moves=True)
MISSION_SKIP = Service("/mission/skip_current", "std_srvs/srv/Trigger", console=BY_OPERATOR, moves=True)
MISSION_DOCK = Service("/mission/dock", "std_srvs/srv/Trigger", console=BY_OPERATOR, moves=True)
MISSION_RESET = Service("/mission/reset", "std_srvs/srv/Trigger", console=BY_OPERATOR)
GET_TAG_READING = Service("/greenhouse_bridge/get_tag_reading", "lupin_msgs/srv/GetTagReading", console=BY_VIEWER)
CONFIRM_TAG = Service("/perception/confirm_tag", "lupin_msgs/srv/ConfirmTag")
GET_FIELD = Service("/twin/get_field", "lupin_msgs/srv/GetField", console=BY_VIEWER)
CLEAR_MAP = Service("/lupin/nav/clear_map", "std_srvs/srv/Trigger", console=BY_OPERATOR)
SLAM_SAVE_MAP = Service("/slam_toolbox/save_map", "slam_toolbox/srv/SaveMap", console=BY_OPERATOR)
SLAM_RESET = Service("/slam_toolbox/reset", "slam_toolbox/srv/Reset")
SLAM_PAUSE = Service("/slam_toolbox/pause_new_measurements", "slam_toolbox/srv/Pause", "toggles between paused and running")
SLAM_SERIALIZE = Service("/slam_toolbox/serialize_map", "slam_toolbox/srv/SerializePoseGraph", console=BY_OPERATOR)
SLAM_DESERIALIZE = Service("/slam_toolbox/deserialize_map", "slam_toolbox/srv/DeserializePoseGraph")
SLAM_DYNAMIC_MAP = Service("/slam_toolbox/dynamic_map", "nav_msgs/srv/GetMap")
MAP_SERVER_MAP = Service("/map_server/map", "nav_msgs/srv/GetMap")
MAP_SERVER_LOAD_MAP = Service("/map_server/load_map", "nav2_msgs/srv/LoadMap")
# Clients of Nav2 wait until these answer `active`.
BT_NAVIGATOR_STATE = Service("/bt_navigator/get_state", "lifecycle_msgs/srv/GetState")
SLAM_STATE = Service("/slam_toolbox/get_state", "lifecycle_msgs/srv/GetState")
AMCL_STATE = Service("/amcl/get_state", "lifecycle_msgs/srv/GetState")
MAP_SERVER_STATE = Service("/map_server/get_state", "lifecycle_msgs/srv/GetState")
GET_LOCAL_COSTMAP = Service("/local_costmap/get_costmap", "nav2_msgs/srv/GetCostmap")
GET_GLOBAL_COSTMAP = Service("/global_costmap/get_costmap", "nav2_msgs/srv/GetCostmap")
CLEAR_LOCAL_COSTMAP = Service("/local_costmap/clear_entirely_local_costmap", "nav2_msgs/srv/ClearEntireCostmap")
CLEAR_GLOBAL_COSTMAP = Service("/global_costmap/clear_entirely_global_costmap", "nav2_msgs/srv/ClearEntireCostmap")
ARM_PRESET = Service("/lupin/arm/preset", "lupin_msgs/srv/SetArmPreset", console=BY_OPERATOR, moves=True)
ARM_SET_TORQUE = Service("/lupin/arm/set_torque", "std_srvs/srv/SetBool", console=BY_OPERATOR)
ARM_INIT = Service("/lupin/arm/init", "std_srvs/srv/Trigger", "moves all arm joints to 0", console=BY_OPERATOR, moves=True)
ARM_CALIBRATE = Service("/lupin/arm/calibrate", "lupin_msgs/srv/CalibrateArm", "robot only", console=BY_OPERATOR, moves=True)
ARM_LIBRARY_LIST = Service("/lupin/arm/library/list", "lupin_msgs/srv/GetArmLibrary", console=BY_VIEWER)
ARM_LIBRARY_SAVE_POSE = Service("/lupin/arm/library/save_pose", "lupin_msgs/srv/SaveArmPose", console=BY_OPERATOR)
ARM_LIBRARY_GOTO_POSE = Service("/lupin/arm/library/goto_pose", "lupin_msgs/srv/SetArmPreset", console=BY_OPERATOR, moves=True)
ARM_LIBRARY_RECORD = Service("/lupin/arm/library/record", "lupin_msgs/srv/ArmRecord", console=BY_OPERATOR)
ARM_LIBRARY_PLAY = Service("/lupin/arm/library/play", "lupin_msgs/srv/PlayArmSequence", console=BY_OPERATOR, moves=True)
ARM_LIBRARY_STOP = Service("/lupin/arm/library/stop", "std_srvs/srv/Trigger", console=BY_VIEWER)
ARM_LIBRARY_DELETE = Service("/lupin/arm/library/delete", "lupin_msgs/srv/ArmLibraryEdit", console=BY_OPERATOR)
GRIPPER_ANGLE = Service(
    "/lupin/gripper/set_angle_with_speed", "mirte_msgs/srv/SetServoAngleWithSpeed", console=BY_OPERATOR, moves=True
)
LEDS_SET = Service("/lupin/leds/set", "mirte_msgs/srv/SetNeopixel", console=BY_OPERATOR)
LEDS_AUTO = Service("/lupin/leds/auto", "std_srvs/srv/Trigger", console=BY_OPERATOR)
VENDOR_LEDS = Service("/io/leds/leds/set_color", "mirte_msgs/srv/SetNeopixel")
VENDOR_TORQUE = Service("/io/servo/hiwonder/enable_all_servos", "std_srvs/srv/SetBool")
VENDOR_ARM_GATE = Service("/enable_arm_control", "std_srvs/srv/SetBool")
LIST_CONTROLLERS = Service("/controller_manager/list_controllers", "controller_manager_msgs/srv/ListControllers")
LOAD_CONTROLLER = Service("/controller_manager/load_controller", "controller_manager_msgs/srv/LoadController")
CONFIGURE_CONTROLLER = Service("/controller_manager/configure_controller", "controller_manager_msgs/srv/ConfigureController")
SWITCH_CONTROLLER = Service("/controller_manager/switch_controller", "controller_manager_msgs/srv/SwitchController")
SIM_PRESS_ESTOP = Service("/sim/press_estop", "std_srvs/srv/SetBool", "simulation only: true presses the red button")


def servo_position(servo: str) -> Topic:
    """Return the topic of one servo's encoder position; `servo` is a name of SERVOS."""
    return Topic(f"{SERVO_NAMESPACE}/{servo}/position", "mirte_msgs/msg/ServoPosition", REL10, 10.0, (MOTOR_BOARD,))


def servo_set_angle(servo: str) -> Service:
    """Return the service that commands one servo directly. The servo's controller is not informed and moves it back."""
    return Service(f"{SERVO_NAMESPACE}/{servo}/set_angle", "mirte_msgs/srv/SetServoAngle")


def servo_range(servo: str) -> Service:
    """Return the service that reads the limits of one servo, in radians."""
    return Service(f"{SERVO_NAMESPACE}/{servo}/get_range", "mirte_msgs/srv/GetServoRange")


def servo_offset(servo: str) -> Service:
    """Return the service that reads a servo's zero offset. Its field is documented as centidegrees but carries raw ticks."""
    return Service(f"{SERVO_NAMESPACE}/{servo}/_offset", "mirte_msgs/srv/GetServoOffset")


def servo_set_offset(servo: str) -> Service:
    """Return the service that writes the zero offset of one servo, in raw ticks."""
    return Service(f"{SERVO_NAMESPACE}/{servo}/_set_offset", "mirte_msgs/srv/SetServoOffset")


def arm_joint_angle(joint: str) -> Service:
    """Return the service that commands one joint through the arm bridge; `joint` is a name of ARM_JOINTS."""
    return replace(GRIPPER_ANGLE, name=f"/lupin/arm/{joint.removesuffix('_joint')}/set_angle_with_speed")


# -- actions ----------------------------------------------------------------------------------------------------------
NAVIGATE_TO_POSE = Action("navigate_to_pose", "nav2_msgs/action/NavigateToPose", console=BY_OPERATOR, moves=True)
NAVIGATE_THROUGH_POSES = Action(
    "navigate_through_poses", "nav2_msgs/action/NavigateThroughPoses", console=BY_OPERATOR, moves=True
)
FOLLOW_WAYPOINTS = Action("follow_waypoints", "nav2_msgs/action/FollowWaypoints", console=BY_OPERATOR, moves=True)
COMPUTE_PATH_TO_POSE = Action("compute_path_to_pose", "nav2_msgs/action/ComputePathToPose", console=BY_VIEWER)
GRIPPER_COMMAND = Action("/mirte_master_gripper_controller/gripper_cmd", "control_msgs/action/GripperCommand")
ARM_FOLLOW_TRAJECTORY = Action(
    "/mirte_master_arm_controller/follow_joint_trajectory", "control_msgs/action/FollowJointTrajectory"
)


def _rows(kind: type[_Row]) -> tuple[_Row, ...]:
    return tuple(row for row in globals().values() if isinstance(row, kind))


def topics() -> tuple[Topic, ...]:
    """Return every topic of the graph, including those of the servos, JPEG images and calibrations."""
    images = (BODY_IMAGE_SIM, BODY_IMAGE_ROBOT, GRIPPER_IMAGE)
    companions = tuple(companion(image) for image in images for companion in (compressed, camera_info))
    return _rows(Topic) + companions + tuple(servo_position(servo) for servo in SERVOS)


@functools.cache
def _topics_by_name() -> dict[str, Topic]:
    return {row.name: row for row in topics()}


def topic(name: str) -> Topic | None:
    """Return the topic with this name, or None."""
    return _topics_by_name().get(name)


def services() -> tuple[Service, ...]:
    """Return every service of the graph."""
    per_servo = (servo_set_angle, servo_range, servo_offset, servo_set_offset)
    servos = tuple(service(servo) for servo in SERVOS for service in per_servo)
    return _rows(Service) + tuple(arm_joint_angle(joint) for joint in ARM_JOINTS) + servos


def actions() -> tuple[Action, ...]:
    """Return every action of the graph."""
    return _rows(Action)
