// Generated: `python -m tools.write_page_types`.
export const TOPICS = {
  "CMD_VEL_JOY": {
    "name": "/cmd_vel_joy",
    "type": "geometry_msgs/msg/Twist",
    "console": "",
    "rateHz": 20.0
  },
  "CMD_VEL_MANUAL": {
    "name": "/cmd_vel_manual",
    "type": "geometry_msgs/msg/Twist",
    "console": "operator",
    "rateHz": 20.0
  },
  "CMD_VEL_NAV": {
    "name": "/cmd_vel_nav",
    "type": "geometry_msgs/msg/Twist",
    "console": "",
    "rateHz": 20.0
  },
  "CMD_VEL_AUTO": {
    "name": "/cmd_vel_auto",
    "type": "geometry_msgs/msg/Twist",
    "console": "",
    "rateHz": 20.0
  },
  "ZERO_CMD_VEL": {
    "name": "/zero_cmd_vel",
    "type": "geometry_msgs/msg/Twist",
    "console": "",
    "rateHz": 10.0
  },
  "CMD_VEL_SINK_ROBOT": {
    "name": "/mirte_base_controller/cmd_vel",
    "type": "geometry_msgs/msg/Twist",
    "console": "",
    "rateHz": 20.0
  },
  "CMD_VEL_SINK_SIM": {
    "name": "/cmd_vel",
    "type": "geometry_msgs/msg/Twist",
    "console": "",
    "rateHz": 20.0
  },
  "DRIVE_STATUS": {
    "name": "/lupin/drive/status",
    "type": "std_msgs/msg/String",
    "console": "",
    "rateHz": 1.0
  },
  "CLOCK": {
    "name": "/clock",
    "type": "rosgraph_msgs/msg/Clock",
    "console": "",
    "rateHz": 100.0
  },
  "ODOM": {
    "name": "/mirte_base_controller/odom",
    "type": "nav_msgs/msg/Odometry",
    "console": "",
    "rateHz": 50.0
  },
  "ODOM_SIM": {
    "name": "/odom",
    "type": "nav_msgs/msg/Odometry",
    "console": "",
    "rateHz": 50.0
  },
  "SCAN": {
    "name": "/scan",
    "type": "sensor_msgs/msg/LaserScan",
    "console": "",
    "rateHz": 10.0
  },
  "IMU": {
    "name": "/io/imu/movement/data",
    "type": "sensor_msgs/msg/Imu",
    "console": "",
    "rateHz": 50.0
  },
  "BATTERY": {
    "name": "/io/power/power_watcher",
    "type": "sensor_msgs/msg/BatteryState",
    "console": "",
    "rateHz": 1.0
  },
  "JOINT_STATES": {
    "name": "/joint_states",
    "type": "sensor_msgs/msg/JointState",
    "console": "",
    "rateHz": 50.0
  },
  "ESTOP_BUTTON": {
    "name": "/io/intensity/emergency_button/digital",
    "type": "mirte_msgs/msg/IntensityDigital",
    "console": "",
    "rateHz": 10.0
  },
  "TF": {
    "name": "/tf",
    "type": "tf2_msgs/msg/TFMessage",
    "console": "",
    "rateHz": 50.0
  },
  "TF_STATIC": {
    "name": "/tf_static",
    "type": "tf2_msgs/msg/TFMessage",
    "console": "",
    "rateHz": null
  },
  "ROBOT_DESCRIPTION": {
    "name": "/robot_description",
    "type": "std_msgs/msg/String",
    "console": "",
    "rateHz": null
  },
  "BODY_IMAGE_SIM": {
    "name": "/camera/image_raw",
    "type": "sensor_msgs/msg/Image",
    "console": "",
    "rateHz": 10.0
  },
  "BODY_IMAGE_ROBOT": {
    "name": "/camera/color/image_raw",
    "type": "sensor_msgs/msg/Image",
    "console": "",
    "rateHz": 30.0
  },
  "GRIPPER_IMAGE": {
    "name": "/gripper_camera/image_raw",
    "type": "sensor_msgs/msg/Image",
    "console": "",
    "rateHz": 10.0
  },
  "ESTOP_STATE": {
    "name": "/e_stop_state",
    "type": "std_msgs/msg/Bool",
    "console": "",
    "rateHz": 5.0
  },
  "HMI_ESTOP": {
    "name": "/lupin/hmi/estop",
    "type": "std_msgs/msg/Bool",
    "console": "operator",
    "rateHz": 2.0
  },
  "CONSOLE_STOP": {
    "name": "/lupin/console/stop",
    "type": "std_msgs/msg/String",
    "console": "",
    "rateHz": 2.0
  },
  "ESTOP_MISSED_PRESS": {
    "name": "/lupin/estop/missed_press",
    "type": "std_msgs/msg/Bool",
    "console": "",
    "rateHz": null
  },
  "ESTOP_STATUS": {
    "name": "/lupin/estop/status",
    "type": "std_msgs/msg/String",
    "console": "",
    "rateHz": 1.0
  },
  "MAP": {
    "name": "/map",
    "type": "nav_msgs/msg/OccupancyGrid",
    "console": "",
    "rateHz": 0.2
  },
  "AMCL_POSE": {
    "name": "/amcl_pose",
    "type": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "console": "",
    "rateHz": null
  },
  "INITIAL_POSE": {
    "name": "/initialpose",
    "type": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "console": "operator",
    "rateHz": null
  },
  "PLAN": {
    "name": "/plan",
    "type": "nav_msgs/msg/Path",
    "console": "",
    "rateHz": null
  },
  "GOAL_POSE": {
    "name": "/goal_pose",
    "type": "geometry_msgs/msg/PoseStamped",
    "console": "operator",
    "rateHz": null
  },
  "GOAL_MARKERS": {
    "name": "/lupin/markers/goals",
    "type": "visualization_msgs/msg/MarkerArray",
    "console": "",
    "rateHz": null
  },
  "GLOBAL_COSTMAP": {
    "name": "/global_costmap/costmap",
    "type": "nav_msgs/msg/OccupancyGrid",
    "console": "",
    "rateHz": 1.0
  },
  "LOCAL_COSTMAP": {
    "name": "/local_costmap/costmap",
    "type": "nav_msgs/msg/OccupancyGrid",
    "console": "",
    "rateHz": 2.0
  },
  "TAG_DETECTIONS": {
    "name": "/camera/tag_detections_json",
    "type": "std_msgs/msg/String",
    "console": "",
    "rateHz": null
  },
  "FLOWER_DETECTIONS": {
    "name": "/yolo/detections",
    "type": "std_msgs/msg/String",
    "console": "",
    "rateHz": null
  },
  "YOLO_OVERLAY": {
    "name": "/yolo/image_detections",
    "type": "sensor_msgs/msg/Image",
    "console": "",
    "rateHz": null
  },
  "FLOWER_OVERLAY": {
    "name": "/sim_flower/overlay",
    "type": "sensor_msgs/msg/Image",
    "console": "",
    "rateHz": null
  },
  "BOX_GEOMETRY": {
    "name": "/perception/box_geometry_json",
    "type": "std_msgs/msg/String",
    "console": "",
    "rateHz": null
  },
  "DISCOVERED_TAGS": {
    "name": "/perception/discovered_tags",
    "type": "lupin_msgs/msg/DiscoveredTags",
    "console": "",
    "rateHz": 2.0
  },
  "TAG_MARKERS": {
    "name": "/lupin/markers/tags",
    "type": "visualization_msgs/msg/MarkerArray",
    "console": "",
    "rateHz": null
  },
  "BOX_MARKERS": {
    "name": "/lupin/markers/boxes",
    "type": "visualization_msgs/msg/MarkerArray",
    "console": "",
    "rateHz": null
  },
  "OBSERVATIONS": {
    "name": "/floranova/observations",
    "type": "lupin_msgs/msg/Observation",
    "console": "",
    "rateHz": null
  },
  "MISSION_STATE": {
    "name": "/mission/state",
    "type": "lupin_msgs/msg/MissionState",
    "console": "",
    "rateHz": 5.0
  },
  "TWIN_STATE": {
    "name": "/twin/state",
    "type": "lupin_msgs/msg/TwinState",
    "console": "",
    "rateHz": 1.0
  },
  "ARM_TRAJECTORY": {
    "name": "/mirte_master_arm_controller/joint_trajectory",
    "type": "trajectory_msgs/msg/JointTrajectory",
    "console": "",
    "rateHz": null
  },
  "JOY": {
    "name": "/joy",
    "type": "sensor_msgs/msg/Joy",
    "console": "",
    "rateHz": 20.0
  },
  "ARM_LIBRARY_STATE": {
    "name": "/lupin/arm/library/state",
    "type": "std_msgs/msg/String",
    "console": "",
    "rateHz": 5.0
  },
  "ROSOUT": {
    "name": "/rosout",
    "type": "rcl_interfaces/msg/Log",
    "console": "",
    "rateHz": null
  },
  "SIM_BATTERY": {
    "name": "/sim/battery_percentage",
    "type": "std_msgs/msg/Float32",
    "console": "",
    "rateHz": null
  },
  "SIM_FAULT": {
    "name": "/sim/fault",
    "type": "std_msgs/msg/String",
    "console": "",
    "rateHz": null
  },
  "BODY_IMAGE_SIM_INFO": {
    "name": "/camera/camera_info",
    "type": "sensor_msgs/msg/CameraInfo",
    "console": "",
    "rateHz": 10.0
  },
  "BODY_IMAGE_ROBOT_INFO": {
    "name": "/camera/color/camera_info",
    "type": "sensor_msgs/msg/CameraInfo",
    "console": "",
    "rateHz": 30.0
  },
  "GRIPPER_IMAGE_INFO": {
    "name": "/gripper_camera/camera_info",
    "type": "sensor_msgs/msg/CameraInfo",
    "console": "",
    "rateHz": 10.0
  }
} as const;
export const SERVICES = {
  "MISSION_START": {
    "name": "/mission/start",
    "type": "lupin_msgs/srv/StartMission",
    "console": "operator"
  },
  "MISSION_PAUSE": {
    "name": "/mission/pause",
    "type": "std_srvs/srv/Trigger",
    "console": "operator"
  },
  "MISSION_RESUME": {
    "name": "/mission/resume",
    "type": "std_srvs/srv/Trigger",
    "console": "operator"
  },
  "MISSION_ABORT": {
    "name": "/mission/abort",
    "type": "std_srvs/srv/Trigger",
    "console": "operator"
  },
  "MISSION_SKIP": {
    "name": "/mission/skip_current",
    "type": "std_srvs/srv/Trigger",
    "console": "operator"
  },
  "MISSION_DOCK": {
    "name": "/mission/dock",
    "type": "std_srvs/srv/Trigger",
    "console": "operator"
  },
  "MISSION_RESET": {
    "name": "/mission/reset",
    "type": "std_srvs/srv/Trigger",
    "console": "operator"
  },
  "GET_TAG_READING": {
    "name": "/greenhouse_bridge/get_tag_reading",
    "type": "lupin_msgs/srv/GetTagReading",
    "console": "viewer"
  },
  "CONFIRM_TAG": {
    "name": "/perception/confirm_tag",
    "type": "lupin_msgs/srv/ConfirmTag",
    "console": ""
  },
  "GET_FIELD": {
    "name": "/twin/get_field",
    "type": "lupin_msgs/srv/GetField",
    "console": "viewer"
  },
  "CLEAR_MAP": {
    "name": "/lupin/nav/clear_map",
    "type": "std_srvs/srv/Trigger",
    "console": "operator"
  },
  "SLAM_SAVE_MAP": {
    "name": "/slam_toolbox/save_map",
    "type": "slam_toolbox/srv/SaveMap",
    "console": "operator"
  },
  "SLAM_RESET": {
    "name": "/slam_toolbox/reset",
    "type": "slam_toolbox/srv/Reset",
    "console": ""
  },
  "SLAM_PAUSE": {
    "name": "/slam_toolbox/pause_new_measurements",
    "type": "slam_toolbox/srv/Pause",
    "console": ""
  },
  "SLAM_SERIALIZE": {
    "name": "/slam_toolbox/serialize_map",
    "type": "slam_toolbox/srv/SerializePoseGraph",
    "console": "operator"
  },
  "SLAM_DESERIALIZE": {
    "name": "/slam_toolbox/deserialize_map",
    "type": "slam_toolbox/srv/DeserializePoseGraph",
    "console": ""
  },
  "SLAM_DYNAMIC_MAP": {
    "name": "/slam_toolbox/dynamic_map",
    "type": "nav_msgs/srv/GetMap",
    "console": ""
  },
  "MAP_SERVER_MAP": {
    "name": "/map_server/map",
    "type": "nav_msgs/srv/GetMap",
    "console": ""
  },
  "MAP_SERVER_LOAD_MAP": {
    "name": "/map_server/load_map",
    "type": "nav2_msgs/srv/LoadMap",
    "console": ""
  },
  "BT_NAVIGATOR_STATE": {
    "name": "/bt_navigator/get_state",
    "type": "lifecycle_msgs/srv/GetState",
    "console": ""
  },
  "SLAM_STATE": {
    "name": "/slam_toolbox/get_state",
    "type": "lifecycle_msgs/srv/GetState",
    "console": ""
  },
  "AMCL_STATE": {
    "name": "/amcl/get_state",
    "type": "lifecycle_msgs/srv/GetState",
    "console": ""
  },
  "MAP_SERVER_STATE": {
    "name": "/map_server/get_state",
    "type": "lifecycle_msgs/srv/GetState",
    "console": ""
  },
  "GET_LOCAL_COSTMAP": {
    "name": "/local_costmap/get_costmap",
    "type": "nav2_msgs/srv/GetCostmap",
    "console": ""
  },
  "GET_GLOBAL_COSTMAP": {
    "name": "/global_costmap/get_costmap",
    "type": "nav2_msgs/srv/GetCostmap",
    "console": ""
  },
  "CLEAR_LOCAL_COSTMAP": {
    "name": "/local_costmap/clear_entirely_local_costmap",
    "type": "nav2_msgs/srv/ClearEntireCostmap",
    "console": ""
  },
  "CLEAR_GLOBAL_COSTMAP": {
    "name": "/global_costmap/clear_entirely_global_costmap",
    "type": "nav2_msgs/srv/ClearEntireCostmap",
    "console": ""
  },
  "ARM_PRESET": {
    "name": "/lupin/arm/preset",
    "type": "lupin_msgs/srv/SetArmPreset",
    "console": "operator"
  },
  "ARM_SET_TORQUE": {
    "name": "/lupin/arm/set_torque",
    "type": "std_srvs/srv/SetBool",
    "console": "operator"
  },
  "ARM_INIT": {
    "name": "/lupin/arm/init",
    "type": "std_srvs/srv/Trigger",
    "console": "operator"
  },
  "ARM_CALIBRATE": {
    "name": "/lupin/arm/calibrate",
    "type": "lupin_msgs/srv/CalibrateArm",
    "console": "operator"
  },
  "ARM_LIBRARY_LIST": {
    "name": "/lupin/arm/library/list",
    "type": "lupin_msgs/srv/GetArmLibrary",
    "console": "viewer"
  },
  "ARM_LIBRARY_SAVE_POSE": {
    "name": "/lupin/arm/library/save_pose",
    "type": "lupin_msgs/srv/SaveArmPose",
    "console": "operator"
  },
  "ARM_LIBRARY_GOTO_POSE": {
    "name": "/lupin/arm/library/goto_pose",
    "type": "lupin_msgs/srv/SetArmPreset",
    "console": "operator"
  },
  "ARM_LIBRARY_RECORD": {
    "name": "/lupin/arm/library/record",
    "type": "lupin_msgs/srv/ArmRecord",
    "console": "operator"
  },
  "ARM_LIBRARY_PLAY": {
    "name": "/lupin/arm/library/play",
    "type": "lupin_msgs/srv/PlayArmSequence",
    "console": "operator"
  },
  "ARM_LIBRARY_STOP": {
    "name": "/lupin/arm/library/stop",
    "type": "std_srvs/srv/Trigger",
    "console": "viewer"
  },
  "ARM_LIBRARY_DELETE": {
    "name": "/lupin/arm/library/delete",
    "type": "lupin_msgs/srv/ArmLibraryEdit",
    "console": "operator"
  },
  "GRIPPER_ANGLE": {
    "name": "/lupin/gripper/set_angle_with_speed",
    "type": "mirte_msgs/srv/SetServoAngleWithSpeed",
    "console": "operator"
  },
  "LEDS_SET": {
    "name": "/lupin/leds/set",
    "type": "mirte_msgs/srv/SetNeopixel",
    "console": "operator"
  },
  "LEDS_AUTO": {
    "name": "/lupin/leds/auto",
    "type": "std_srvs/srv/Trigger",
    "console": "operator"
  },
  "VENDOR_LEDS": {
    "name": "/io/leds/leds/set_color",
    "type": "mirte_msgs/srv/SetNeopixel",
    "console": ""
  },
  "VENDOR_TORQUE": {
    "name": "/io/servo/hiwonder/enable_all_servos",
    "type": "std_srvs/srv/SetBool",
    "console": ""
  },
  "VENDOR_ARM_GATE": {
    "name": "/enable_arm_control",
    "type": "std_srvs/srv/SetBool",
    "console": ""
  },
  "LIST_CONTROLLERS": {
    "name": "/controller_manager/list_controllers",
    "type": "controller_manager_msgs/srv/ListControllers",
    "console": ""
  },
  "LOAD_CONTROLLER": {
    "name": "/controller_manager/load_controller",
    "type": "controller_manager_msgs/srv/LoadController",
    "console": ""
  },
  "CONFIGURE_CONTROLLER": {
    "name": "/controller_manager/configure_controller",
    "type": "controller_manager_msgs/srv/ConfigureController",
    "console": ""
  },
  "SWITCH_CONTROLLER": {
    "name": "/controller_manager/switch_controller",
    "type": "controller_manager_msgs/srv/SwitchController",
    "console": ""
  },
  "SIM_PRESS_ESTOP": {
    "name": "/sim/press_estop",
    "type": "std_srvs/srv/SetBool",
    "console": ""
  },
  "GET_TIME": {
    "name": "/rosapi/get_time",
    "type": "rosapi_msgs/srv/GetTime",
    "console": "viewer"
  },
  "TOPICS": {
    "name": "/rosapi/topics",
    "type": "rosapi_msgs/srv/Topics",
    "console": "viewer"
  },
  "SUBSCRIBERS": {
    "name": "/rosapi/subscribers",
    "type": "rosapi_msgs/srv/Subscribers",
    "console": "viewer"
  },
  "CANCEL_NAVIGATE_TO_POSE": {
    "name": "/navigate_to_pose/_action/cancel_goal",
    "type": "action_msgs/srv/CancelGoal",
    "console": "viewer"
  },
  "CANCEL_NAVIGATE_THROUGH_POSES": {
    "name": "/navigate_through_poses/_action/cancel_goal",
    "type": "action_msgs/srv/CancelGoal",
    "console": "viewer"
  },
  "CANCEL_FOLLOW_WAYPOINTS": {
    "name": "/follow_waypoints/_action/cancel_goal",
    "type": "action_msgs/srv/CancelGoal",
    "console": "viewer"
  }
} as const;
export const ACTIONS = {
  "NAVIGATE_TO_POSE": {
    "name": "/navigate_to_pose",
    "type": "nav2_msgs/action/NavigateToPose",
    "console": "operator"
  },
  "NAVIGATE_THROUGH_POSES": {
    "name": "/navigate_through_poses",
    "type": "nav2_msgs/action/NavigateThroughPoses",
    "console": "operator"
  },
  "FOLLOW_WAYPOINTS": {
    "name": "/follow_waypoints",
    "type": "nav2_msgs/action/FollowWaypoints",
    "console": "operator"
  },
  "COMPUTE_PATH_TO_POSE": {
    "name": "/compute_path_to_pose",
    "type": "nav2_msgs/action/ComputePathToPose",
    "console": "viewer"
  },
  "GRIPPER_COMMAND": {
    "name": "/mirte_master_gripper_controller/gripper_cmd",
    "type": "control_msgs/action/GripperCommand",
    "console": ""
  },
  "ARM_FOLLOW_TRAJECTORY": {
    "name": "/mirte_master_arm_controller/follow_joint_trajectory",
    "type": "control_msgs/action/FollowJointTrajectory",
    "console": ""
  }
} as const;
export const JOINTS = {
  "arm": [
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_joint"
  ],
  "gripper": "gripper_joint",
  "wheels": [
    "front_left_wheel_joint",
    "rear_left_wheel_joint",
    "rear_right_wheel_joint",
    "front_right_wheel_joint"
  ]
} as const;
export const JOINT_SERVICES = {
  "shoulder_pan_joint": {
    "name": "/lupin/arm/shoulder_pan/set_angle_with_speed",
    "type": "mirte_msgs/srv/SetServoAngleWithSpeed",
    "console": "operator"
  },
  "shoulder_lift_joint": {
    "name": "/lupin/arm/shoulder_lift/set_angle_with_speed",
    "type": "mirte_msgs/srv/SetServoAngleWithSpeed",
    "console": "operator"
  },
  "elbow_joint": {
    "name": "/lupin/arm/elbow/set_angle_with_speed",
    "type": "mirte_msgs/srv/SetServoAngleWithSpeed",
    "console": "operator"
  },
  "wrist_joint": {
    "name": "/lupin/arm/wrist/set_angle_with_speed",
    "type": "mirte_msgs/srv/SetServoAngleWithSpeed",
    "console": "operator"
  },
  "gripper_joint": {
    "name": "/lupin/gripper/set_angle_with_speed",
    "type": "mirte_msgs/srv/SetServoAngleWithSpeed",
    "console": "operator"
  }
} as const;
export const FRAMES = {
  "map": "map",
  "odom": "odom",
  "base": "base_link",
  "laser": "laser"
} as const;
