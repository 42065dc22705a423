"""The ROS graph, once: every topic, service, action and frame with its type and QoS.

Nodes, the stack table, the recorder and the documentation take names from here. The vendor's names differ from what
intuition says (`/battery_state`, `/imu/data` and `cmd_vel_unstamped` exist nowhere on the robot), so nobody types them twice.
Nothing here imports rclpy: `lupin_runtime.ros` turns these rows into publishers and subscriptions.
"""

from __future__ import annotations

from dataclasses import dataclass

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
    """A quality of service. `depth` counts messages kept for a slow or late reader."""

    reliable: bool
    latched: bool = False
    depth: int = 10


LATCHED1 = Qos(reliable=True, latched=True, depth=1)
LATCHED50 = Qos(reliable=True, latched=True, depth=50)
STATIC_TF = Qos(reliable=True, latched=True, depth=100)
REL1 = Qos(reliable=True, depth=1)
REL5 = Qos(reliable=True, depth=5)
REL10 = Qos(reliable=True, depth=10)
REL100 = Qos(reliable=True, depth=100)
BEST1 = Qos(reliable=False, depth=1)
BEST5 = Qos(reliable=False, depth=5)


@dataclass(frozen=True)
class Topic:
    """A topic: its name, its type as `package/msg/Name`, the QoS its publisher offers, its nominal rate (None: on change)."""

    name: str
    type: str
    qos: Qos
    rate_hz: float | None = None
    note: str = ""


@dataclass(frozen=True)
class Service:
    """A service: its name and its type as `package/srv/Name`."""

    name: str
    type: str
    note: str = ""


@dataclass(frozen=True)
class Action:
    """An action: its name and its type as `package/action/Name`."""

    name: str
    type: str
    note: str = ""


# -- the drive bus ----------------------------------------------------------------------------------------------------
# The sink is best effort on both targets: a reliable subscriber there would hear nothing, without an error.
CMD_VEL_JOY = Topic("/cmd_vel_joy", "geometry_msgs/msg/Twist", REL10, 20.0, "Xbox dead-man; silent when released")
CMD_VEL_MANUAL = Topic("/cmd_vel_manual", "geometry_msgs/msg/Twist", REL10, 20.0, "console joystick")
CMD_VEL_NAV = Topic("/cmd_vel_nav", "geometry_msgs/msg/Twist", REL10, 20.0, "controller server -> velocity smoother")
CMD_VEL_AUTO = Topic("/cmd_vel_auto", "geometry_msgs/msg/Twist", REL10, 20.0, "velocity smoother -> twist_mux")
ZERO_CMD_VEL = Topic("/zero_cmd_vel", "geometry_msgs/msg/Twist", REL10, 10.0, "simulation's idle stop")
CMD_VEL_SINK_ROBOT = Topic("/mirte_base_controller/cmd_vel", "geometry_msgs/msg/Twist", BEST1, 20.0, "drive sink, robot")
CMD_VEL_SINK_SIM = Topic("/cmd_vel", "geometry_msgs/msg/Twist", BEST1, 20.0, "drive sink, simulation")
DRIVE_STATUS = Topic("/lupin/drive/status", "std_msgs/msg/String", LATCHED1, 1.0, "JSON: who holds the bus, locks, ages")

# -- sensors and state of the vehicle ---------------------------------------------------------------------------------
CLOCK = Topic("/clock", "rosgraph_msgs/msg/Clock", BEST1, 100.0, "simulation only")
ODOM = Topic("/mirte_base_controller/odom", "nav_msgs/msg/Odometry", REL10, 50.0)
ODOM_SIM = Topic("/odom", "nav_msgs/msg/Odometry", REL10, 50.0, "simulation only: the same odometry under Gazebo's name")
SCAN = Topic("/scan", "sensor_msgs/msg/LaserScan", BEST5, 10.0)
IMU = Topic("/io/imu/movement/data", "sensor_msgs/msg/Imu", REL10, 50.0)
BATTERY = Topic("/io/power/power_watcher", "sensor_msgs/msg/BatteryState", REL10, 1.0)
JOINT_STATES = Topic("/joint_states", "sensor_msgs/msg/JointState", REL10, 50.0)
ESTOP_BUTTON = Topic("/io/intensity/emergency_button/digital", "mirte_msgs/msg/IntensityDigital", REL10, 10.0)
TF = Topic("/tf", "tf2_msgs/msg/TFMessage", REL100, 50.0)
TF_STATIC = Topic("/tf_static", "tf2_msgs/msg/TFMessage", STATIC_TF)

# The body camera keeps the name of each target: a console or an annotator takes the one of the target it runs against.
BODY_IMAGE_SIM = Topic("/camera/image_raw", "sensor_msgs/msg/Image", REL1, 10.0)
BODY_IMAGE_ROBOT = Topic("/camera/color/image_raw", "sensor_msgs/msg/Image", REL1, 30.0)
GRIPPER_IMAGE = Topic("/gripper_camera/image_raw", "sensor_msgs/msg/Image", REL1, 10.0)


def compressed(image: Topic) -> Topic:
    """The JPEG companion of a raw image topic."""
    return Topic(image.name + "/compressed", "sensor_msgs/msg/CompressedImage", image.qos, image.rate_hz)


def camera_info(image: Topic) -> Topic:
    """The calibration published beside a raw image topic."""
    return Topic(image.name.rsplit("/", 1)[0] + "/camera_info", "sensor_msgs/msg/CameraInfo", image.qos, image.rate_hz)


# -- safety -----------------------------------------------------------------------------------------------------------
ESTOP_STATE = Topic("/e_stop_state", "std_msgs/msg/Bool", REL10, 5.0, "estop_bridge is its only publisher")
HMI_ESTOP = Topic("/lupin/hmi/estop", "std_msgs/msg/Bool", REL10, 2.0, "a console's own stop; its value expires")
ESTOP_STATUS = Topic("/lupin/estop/status", "std_msgs/msg/String", LATCHED1, 1.0, "JSON: every reason of the e-stop")

# -- mapping and navigation -------------------------------------------------------------------------------------------
MAP = Topic("/map", "nav_msgs/msg/OccupancyGrid", LATCHED1, 0.2)
AMCL_POSE = Topic("/amcl_pose", "geometry_msgs/msg/PoseWithCovarianceStamped", LATCHED1)
INITIAL_POSE = Topic("/initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped", REL1)
PLAN = Topic("/plan", "nav_msgs/msg/Path", REL1)
GOAL_POSE = Topic("/goal_pose", "geometry_msgs/msg/PoseStamped", REL1)
GLOBAL_COSTMAP = Topic("/global_costmap/costmap", "nav_msgs/msg/OccupancyGrid", LATCHED1, 1.0)
LOCAL_COSTMAP = Topic("/local_costmap/costmap", "nav_msgs/msg/OccupancyGrid", LATCHED1, 2.0)

# -- perception, greenhouse, mission, twin ------------------------------------------------------------------------------
TAG_DETECTIONS = Topic("/camera/tag_detections_json", "std_msgs/msg/String", REL5)
FLOWER_DETECTIONS = Topic("/yolo/detections", "std_msgs/msg/String", REL5)
YOLO_OVERLAY = Topic("/yolo/image_detections", "sensor_msgs/msg/Image", REL1)
FLOWER_OVERLAY = Topic("/sim_flower/overlay", "sensor_msgs/msg/Image", REL1)
BOX_GEOMETRY = Topic("/perception/box_geometry_json", "std_msgs/msg/String", LATCHED1)
DISCOVERED_TAGS = Topic("/perception/discovered_tags", "lupin_msgs/msg/DiscoveredTags", LATCHED1, 2.0)
OBSERVATIONS = Topic("/floranova/observations", "lupin_msgs/msg/Observation", LATCHED50)
MISSION_STATE = Topic("/mission/state", "lupin_msgs/msg/MissionState", LATCHED1, 5.0)
TWIN_STATE = Topic("/twin/state", "lupin_msgs/msg/TwinState", LATCHED1, 1.0)

# -- arm, lights, log -------------------------------------------------------------------------------------------------
ARM_TRAJECTORY = Topic("/mirte_master_arm_controller/joint_trajectory", "trajectory_msgs/msg/JointTrajectory", REL10)
JOY = Topic("/joy", "sensor_msgs/msg/Joy", REL10, 20.0)
# One servo each of the vendor's bus; the last part is an arm joint without its suffix, or `gripper`.
SERVO_NAMESPACE = "/io/servo/hiwonder"
SERVOS = (*(joint[: -len("_joint")] for joint in ARM_JOINTS), "gripper")
ARM_LIBRARY_STATE = Topic("/lupin/arm/library/state", "std_msgs/msg/String", LATCHED1, 5.0)
ROSOUT = Topic("/rosout", "rcl_interfaces/msg/Log", REL100)

# -- services ---------------------------------------------------------------------------------------------------------
MISSION_START = Service("/mission/start", "lupin_msgs/srv/StartMission")
MISSION_PAUSE = Service("/mission/pause", "std_srvs/srv/Trigger")
MISSION_RESUME = Service("/mission/resume", "std_srvs/srv/Trigger")
MISSION_ABORT = Service("/mission/abort", "std_srvs/srv/Trigger")
MISSION_SKIP = Service("/mission/skip_current", "std_srvs/srv/Trigger")
MISSION_DOCK = Service("/mission/dock", "std_srvs/srv/Trigger")
MISSION_RESET = Service("/mission/reset", "std_srvs/srv/Trigger")
GET_TAG_READING = Service("/greenhouse_bridge/get_tag_reading", "lupin_msgs/srv/GetTagReading")
CONFIRM_TAG = Service("/perception/confirm_tag", "lupin_msgs/srv/ConfirmTag")
GET_FIELD = Service("/twin/get_field", "lupin_msgs/srv/GetField")
CLEAR_MAP = Service("/lupin/nav/clear_map", "std_srvs/srv/Trigger")
SLAM_SAVE_MAP = Service("/slam_toolbox/save_map", "slam_toolbox/srv/SaveMap")
SLAM_RESET = Service("/slam_toolbox/reset", "slam_toolbox/srv/Reset")
SLAM_PAUSE = Service("/slam_toolbox/pause_new_measurements", "slam_toolbox/srv/Pause", "a toggle")
SLAM_SERIALIZE = Service("/slam_toolbox/serialize_map", "slam_toolbox/srv/SerializePoseGraph")
SLAM_DESERIALIZE = Service("/slam_toolbox/deserialize_map", "slam_toolbox/srv/DeserializePoseGraph")
CLEAR_LOCAL_COSTMAP = Service("/local_costmap/clear_entirely_local_costmap", "nav2_msgs/srv/ClearEntireCostmap")
CLEAR_GLOBAL_COSTMAP = Service("/global_costmap/clear_entirely_global_costmap", "nav2_msgs/srv/ClearEntireCostmap")
ARM_PRESET = Service("/lupin/arm/preset", "lupin_msgs/srv/SetArmPreset")
ARM_SET_TORQUE = Service("/lupin/arm/set_torque", "std_srvs/srv/SetBool")
ARM_INIT = Service("/lupin/arm/init", "std_srvs/srv/Trigger")
ARM_CALIBRATE = Service("/lupin/arm/calibrate", "lupin_msgs/srv/CalibrateArm", "hardware only")
ARM_LIBRARY_LIST = Service("/lupin/arm/library/list", "lupin_msgs/srv/GetArmLibrary")
ARM_LIBRARY_SAVE_POSE = Service("/lupin/arm/library/save_pose", "lupin_msgs/srv/SaveArmPose")
ARM_LIBRARY_GOTO_POSE = Service("/lupin/arm/library/goto_pose", "lupin_msgs/srv/SetArmPreset")
ARM_LIBRARY_RECORD = Service("/lupin/arm/library/record", "lupin_msgs/srv/ArmRecord")
ARM_LIBRARY_PLAY = Service("/lupin/arm/library/play", "lupin_msgs/srv/PlayArmSequence")
ARM_LIBRARY_STOP = Service("/lupin/arm/library/stop", "std_srvs/srv/Trigger")
ARM_LIBRARY_DELETE = Service("/lupin/arm/library/delete", "lupin_msgs/srv/ArmLibraryEdit")
GRIPPER_ANGLE = Service("/lupin/gripper/set_angle_with_speed", "mirte_msgs/srv/SetServoAngleWithSpeed")
LEDS_SET = Service("/lupin/leds/set", "mirte_msgs/srv/SetNeopixel")
LEDS_AUTO = Service("/lupin/leds/auto", "std_srvs/srv/Trigger")
VENDOR_LEDS = Service("/io/leds/leds/set_color", "mirte_msgs/srv/SetNeopixel")
VENDOR_TORQUE = Service("/io/servo/hiwonder/enable_all_servos", "std_srvs/srv/SetBool")
VENDOR_ARM_GATE = Service("/enable_arm_control", "std_srvs/srv/SetBool")
LIST_CONTROLLERS = Service("/controller_manager/list_controllers", "controller_manager_msgs/srv/ListControllers")
LOAD_CONTROLLER = Service("/controller_manager/load_controller", "controller_manager_msgs/srv/LoadController")
CONFIGURE_CONTROLLER = Service("/controller_manager/configure_controller", "controller_manager_msgs/srv/ConfigureController")
SWITCH_CONTROLLER = Service("/controller_manager/switch_controller", "controller_manager_msgs/srv/SwitchController")
SIM_BATTERY = Topic("/sim/battery_percentage", "std_msgs/msg/Float32", REL10, None, "simulation only: sets it, 0..1")
SIM_FAULT = Topic("/sim/fault", "std_msgs/msg/String", REL10, None, "simulation only: break a sensor, e.g. `scan frozen`")
SIM_PRESS_ESTOP = Service("/sim/press_estop", "std_srvs/srv/SetBool", "simulation only: true presses the red button")


def servo_position(servo: str) -> Topic:
    """What one servo's encoder says; `servo` is a name of SERVOS."""
    return Topic(f"{SERVO_NAMESPACE}/{servo}/position", "mirte_msgs/msg/ServoPosition", REL10, 10.0)


def servo_set_angle(servo: str) -> Service:
    """Send one servo somewhere, past its controller: the controller sends it back."""
    return Service(f"{SERVO_NAMESPACE}/{servo}/set_angle", "mirte_msgs/srv/SetServoAngle")


def servo_range(servo: str) -> Service:
    """The limits of one servo, radians."""
    return Service(f"{SERVO_NAMESPACE}/{servo}/get_range", "mirte_msgs/srv/GetServoRange")


def servo_offset(servo: str) -> Service:
    """The zero offset of one servo. The field says centidegrees and carries raw ticks."""
    return Service(f"{SERVO_NAMESPACE}/{servo}/_offset", "mirte_msgs/srv/GetServoOffset")


def servo_set_offset(servo: str) -> Service:
    """Write the zero offset of one servo, in raw ticks."""
    return Service(f"{SERVO_NAMESPACE}/{servo}/_set_offset", "mirte_msgs/srv/SetServoOffset")


def arm_joint_angle(joint: str) -> Service:
    """The per-joint command of the arm bridge; `joint` is a name of ARM_JOINTS."""
    return Service(f"/lupin/arm/{joint.removesuffix('_joint')}/set_angle_with_speed", GRIPPER_ANGLE.type)


# -- actions ----------------------------------------------------------------------------------------------------------
NAVIGATE_TO_POSE = Action("navigate_to_pose", "nav2_msgs/action/NavigateToPose")
NAVIGATE_THROUGH_POSES = Action("navigate_through_poses", "nav2_msgs/action/NavigateThroughPoses")
COMPUTE_PATH_TO_POSE = Action("compute_path_to_pose", "nav2_msgs/action/ComputePathToPose")
GRIPPER_COMMAND = Action("/mirte_master_gripper_controller/gripper_cmd", "control_msgs/action/GripperCommand")
ARM_FOLLOW_TRAJECTORY = Action(
    "/mirte_master_arm_controller/follow_joint_trajectory", "control_msgs/action/FollowJointTrajectory"
)


def _rows(kind: type) -> tuple:
    return tuple(row for row in globals().values() if isinstance(row, kind))


def topics() -> tuple[Topic, ...]:
    """Every topic of the graph, with the companions of the raw images."""
    images = (BODY_IMAGE_SIM, BODY_IMAGE_ROBOT, GRIPPER_IMAGE)
    companions = tuple(f(image) for image in images for f in (compressed, camera_info))
    return _rows(Topic) + companions + tuple(servo_position(servo) for servo in SERVOS)


def services() -> tuple[Service, ...]:
    """Every service of the graph."""
    of_servo = (servo_set_angle, servo_range, servo_offset, servo_set_offset)
    of_servos = tuple(row(servo) for servo in SERVOS for row in of_servo)
    return _rows(Service) + tuple(arm_joint_angle(joint) for joint in ARM_JOINTS) + of_servos


def actions() -> tuple[Action, ...]:
    """Every action of the graph."""
    return _rows(Action)
