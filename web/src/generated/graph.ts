// Generated: `python -m tools.write_page_types`.
export const TOPICS = {
  "CMD_VEL_JOY": {
    "name": "/cmd_vel_joy",
    "type": "geometry_msgs/msg/Twist",
    "console": "",
    "moves": false,
    "rateHz": 20.0
  },
  "CMD_VEL_MANUAL": {
    "name": "/cmd_vel_manual",
    "type": "geometry_msgs/msg/Twist",
    "console": "operator",
    "moves": true,
    "rateHz": 20.0
  },
  "CMD_VEL_NAV": {
    "name": "/cmd_vel_nav",
    "type": "geometry_msgs/msg/Twist",
    "console": "",
    "moves": false,
    "rateHz": 20.0
  },
  "CMD_VEL_AUTO": {
    "name": "/cmd_vel_auto",
    "type": "geometry_msgs/msg/Twist",
    "console": "",
    "moves": false,
    "rateHz": 20.0
  },
  "ZERO_CMD_VEL": {
    "name": "/zero_cmd_vel",
    "type": "geometry_msgs/msg/Twist",
    "console": "",
    "moves": false,
    "rateHz": 10.0
  },
  "CMD_VEL_SINK_ROBOT": {
    "name": "/mirte_base_controller/cmd_vel",
    "type": "geometry_msgs/msg/Twist",
    "console": "",
    "moves": false,
    "rateHz": 20.0
  },
  "CMD_VEL_SINK_SIM": {
    "name": "/cmd_vel",
    "type": "geometry_msgs/msg/Twist",
    "console": "",
    "moves": false,
    "rateHz": 20.0
  },
  "DRIVE_STATUS": {
    "name": "/lupin/drive/status",
    "type": "std_msgs/msg/String",
    "console": "",
    "moves": false,
    "rateHz": 1.0
  },
  "CLOCK": {
    "name": "/clock",
    "type": "rosgraph_msgs/msg/Clock",
    "console": "",
    "moves": false,
    "rateHz": 100.0
  },
  "ODOM": {
    "name": "/mirte_base_controller/odom",
    "type": "nav_msgs/msg/Odometry",
    "console": "",
    "moves": false,
    "rateHz": 50.0
  },
  "ODOM_SIM": {
    "name": "/odom",
    "type": "nav_msgs/msg/Odometry",
    "console": "",
    "moves": false,
    "rateHz": 50.0
  },
  "SCAN": {
    "name": "/scan",
    "type": "sensor_msgs/msg/LaserScan",
    "console": "",
    "moves": false,
    "rateHz": 10.0
  },
  "IMU": {
    "name": "/io/imu/movement/data",
    "type": "sensor_msgs/msg/Imu",
    "console": "",
    "moves": false,
    "rateHz": 50.0
  },
  "BATTERY": {
    "name": "/io/power/power_watcher",
    "type": "sensor_msgs/msg/BatteryState",
    "console": "",
    "moves": false,
    "rateHz": 1.0
  },
  "JOINT_STATES": {
    "name": "/joint_states",
    "type": "sensor_msgs/msg/JointState",
    "console": "",
    "moves": false,
    "rateHz": 50.0
  },
  "ESTOP_BUTTON": {
    "name": "/io/intensity/emergency_button/digital",
    "type": "mirte_msgs/msg/IntensityDigital",
    "console": "",
    "moves": false,
    "rateHz": 10.0
  },
  "TF": {
    "name": "/tf",
    "type": "tf2_msgs/msg/TFMessage",
    "console": "",
    "moves": false,
    "rateHz": 50.0
  },
  "TF_STATIC": {
    "name": "/tf_static",
    "type": "tf2_msgs/msg/TFMessage",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "ROBOT_DESCRIPTION": {
    "name": "/robot_description",
    "type": "std_msgs/msg/String",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "BODY_IMAGE_SIM": {
    "name": "/camera/image_raw",
    "type": "sensor_msgs/msg/Image",
    "console": "",
    "moves": false,
    "rateHz": 10.0
  },
  "BODY_IMAGE_ROBOT": {
    "name": "/camera/color/image_raw",
    "type": "sensor_msgs/msg/Image",
    "console": "",
    "moves": false,
    "rateHz": 30.0
  },
  "GRIPPER_IMAGE": {
    "name": "/gripper_camera/image_raw",
    "type": "sensor_msgs/msg/Image",
    "console": "",
    "moves": false,
    "rateHz": 10.0
  },
  "ESTOP_STATE": {
    "name": "/e_stop_state",
    "type": "std_msgs/msg/Bool",
    "console": "",
    "moves": false,
    "rateHz": 5.0
  },
  "HMI_ESTOP": {
    "name": "/lupin/hmi/estop",
    "type": "std_msgs/msg/Bool",
    "console": "operator",
    "moves": false,
    "rateHz": 2.0
  },
  "CONSOLE_STOP": {
    "name": "/lupin/console/stop",
    "type": "std_msgs/msg/String",
    "console": "",
    "moves": false,
    "rateHz": 2.0
  },
  "ESTOP_MISSED_PRESS": {
    "name": "/lupin/estop/missed_press",
    "type": "std_msgs/msg/Bool",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "ESTOP_STATUS": {
    "name": "/lupin/estop/status",
    "type": "std_msgs/msg/String",
    "console": "",
    "moves": false,
    "rateHz": 1.0
  },
  "MAP": {
    "name": "/map",
    "type": "nav_msgs/msg/OccupancyGrid",
    "console": "",
    "moves": false,
    "rateHz": 0.2
  },
  "AMCL_POSE": {
    "name": "/amcl_pose",
    "type": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "INITIAL_POSE": {
    "name": "/initialpose",
    "type": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "console": "operator",
    "moves": false,
    "rateHz": null
  },
  "PLAN": {
    "name": "/plan",
    "type": "nav_msgs/msg/Path",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "GOAL_POSE": {
    "name": "/goal_pose",
    "type": "geometry_msgs/msg/PoseStamped",
    "console": "operator",
    "moves": true,
    "rateHz": null
  },
  "GOAL_MARKERS": {
    "name": "/lupin/markers/goals",
    "type": "visualization_msgs/msg/MarkerArray",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "GLOBAL_COSTMAP": {
    "name": "/global_costmap/costmap",
    "type": "nav_msgs/msg/OccupancyGrid",
    "console": "",
    "moves": false,
    "rateHz": 1.0
  },
  "LOCAL_COSTMAP": {
    "name": "/local_costmap/costmap",
    "type": "nav_msgs/msg/OccupancyGrid",
    "console": "",
    "moves": false,
    "rateHz": 2.0
  },
  "TAG_DETECTIONS": {
    "name": "/camera/tag_detections_json",
    "type": "std_msgs/msg/String",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "FLOWER_DETECTIONS": {
    "name": "/yolo/detections",
    "type": "std_msgs/msg/String",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "YOLO_OVERLAY": {
    "name": "/yolo/image_detections",
    "type": "sensor_msgs/msg/Image",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "FLOWER_OVERLAY": {
    "name": "/sim_flower/overlay",
    "type": "sensor_msgs/msg/Image",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "BOX_GEOMETRY": {
    "name": "/perception/box_geometry_json",
    "type": "std_msgs/msg/String",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "DISCOVERED_TAGS": {
    "name": "/perception/discovered_tags",
    "type": "lupin_msgs/msg/DiscoveredTags",
    "console": "",
    "moves": false,
    "rateHz": 2.0
  },
  "TAG_MARKERS": {
    "name": "/lupin/markers/tags",
    "type": "visualization_msgs/msg/MarkerArray",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "BOX_MARKERS": {
    "name": "/lupin/markers/boxes",
    "type": "visualization_msgs/msg/MarkerArray",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "OBSERVATIONS": {
    "name": "/floranova/observations",
    "type": "lupin_msgs/msg/Observation",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "MISSION_STATE": {
    "name": "/mission/state",
    "type": "lupin_msgs/msg/MissionState",
    "console": "",
    "moves": false,
    "rateHz": 5.0
  },
  "TWIN_STATE": {
    "name": "/twin/state",
    "type": "lupin_msgs/msg/TwinState",
    "console": "",
    "moves": false,
    "rateHz": 1.0
  },
  "ARM_TRAJECTORY": {
    "name": "/mirte_master_arm_controller/joint_trajectory",
    "type": "trajectory_msgs/msg/JointTrajectory",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "JOY": {
    "name": "/joy",
    "type": "sensor_msgs/msg/Joy",
    "console": "",
    "moves": false,
    "rateHz": 20.0
  },
  "ARM_LIBRARY_STATE": {
    "name": "/lupin/arm/library/state",
    "type": "std_msgs/msg/String",
    "console": "",
    "moves": false,
    "rateHz": 5.0
  },
  "ROSOUT": {
    "name": "/rosout",
    "type": "rcl_interfaces/msg/Log",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "SIM_BATTERY": {
    "name": "/sim/battery_percentage",
    "type": "std_msgs/msg/Float32",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "SIM_FAULT": {
    "name": "/sim/fault",
    "type": "std_msgs/msg/String",
    "console": "",
    "moves": false,
    "rateHz": null
  },
  "BODY_IMAGE_SIM_INFO": {
    "name": "/camera/camera_info",
    "type": "sensor_msgs/msg/CameraInfo",
    "console": "",
    "moves": false,
    "rateHz": 10.0
  },
  "BODY_IMAGE_ROBOT_INFO": {
    "name": "/camera/color/camera_info",
    "type": "sensor_msgs/msg/CameraInfo",
    "console": "",
    "moves": false,
    "rateHz": 30.0
  },
  "GRIPPER_IMAGE_INFO": {
    "name": "/gripper_camera/camera_info",
    "type": "sensor_msgs/msg/CameraInfo",
    "console": "",
    "moves": false,
    "rateHz": 10.0
  }
} as const;
export const SERVICES = {
  "MISSION_START": {
    "name": "/mission/start",
    "type": "lupin_msgs/srv/StartMission",
    "console": "operator",
    "moves": true
  },
  "MISSION_PAUSE": {
    "name": "/mission/pause",
    "type": "std_srvs/srv/Trigger",
    "console": "operator",
    "moves": false
  },
  "MISSION_RESUME": {
    "name": "/mission/resume",
    "type": "std_srvs/srv/Trigger",
    "console": "operator",
    "moves": true
  },
  "MISSION_ABORT": {
    "name": "/mission/abort",
    "type": "std_srvs/srv/Trigger",
    "console": "operator",
    "moves": true
  },
  "MISSION_SKIP": {
    "name": "/mission/skip_current",
    "type": "std_srvs/srv/Trigger",
    "console": "operator",
    "moves": true
  },
  "MISSION_DOCK": {
    "name": "/mission/dock",
    "type": "std_srvs/srv/Trigger",
    "console": "operator",
    "moves": true
  },
  "MISSION_RESET": {
    "name": "/mission/reset",
    "type": "std_srvs/srv/Trigger",
    "console": "operator",
    "moves": false
  },
  "GET_TAG_READING": {
    "name": "/greenhouse_bridge/get_tag_reading",
    "type": "lupin_msgs/srv/GetTagReading",
    "console": "viewer",
    "moves": false
  },
  "CONFIRM_TAG": {
    "name": "/perception/confirm_tag",
    "type": "lupin_msgs/srv/ConfirmTag",
    "console": "",
    "moves": false
  },
  "GET_FIELD": {
    "name": "/twin/get_field",
    "type": "lupin_msgs/srv/GetField",
    "console": "viewer",
    "moves": false
  },
  "CLEAR_MAP": {
    "name": "/lupin/nav/clear_map",
    "type": "std_srvs/srv/Trigger",
    "console": "operator",
    "moves": false
  },
  "SLAM_SAVE_MAP": {
    "name": "/slam_toolbox/save_map",
    "type": "slam_toolbox/srv/SaveMap",
    "console": "operator",
    "moves": false
  },
  "SLAM_RESET": {
    "name": "/slam_toolbox/reset",
    "type": "slam_toolbox/srv/Reset",
    "console": "",
    "moves": false
  },
  "SLAM_PAUSE": {
    "name": "/slam_toolbox/pause_new_measurements",
    "type": "slam_toolbox/srv/Pause",
    "console": "",
    "moves": false
  },
  "SLAM_SERIALIZE": {
    "name": "/slam_toolbox/serialize_map",
    "type": "slam_toolbox/srv/SerializePoseGraph",
    "console": "operator",
    "moves": false
  },
  "SLAM_DESERIALIZE": {
    "name": "/slam_toolbox/deserialize_map",
    "type": "slam_toolbox/srv/DeserializePoseGraph",
    "console": "",
    "moves": false
  },
  "SLAM_DYNAMIC_MAP": {
    "name": "/slam_toolbox/dynamic_map",
    "type": "nav_msgs/srv/GetMap",
    "console": "",
    "moves": false
  },
  "MAP_SERVER_MAP": {
    "name": "/map_server/map",
    "type": "nav_msgs/srv/GetMap",
    "console": "",
    "moves": false
  },
  "MAP_SERVER_LOAD_MAP": {
    "name": "/map_server/load_map",
    "type": "nav2_msgs/srv/LoadMap",
    "console": "",
    "moves": false
  },
  "BT_NAVIGATOR_STATE": {
    "name": "/bt_navigator/get_state",
    "type": "lifecycle_msgs/srv/GetState",
    "console": "",
    "moves": false
  },
  "SLAM_STATE": {
    "name": "/slam_toolbox/get_state",
    "type": "lifecycle_msgs/srv/GetState",
    "console": "",
    "moves": false
  },
  "AMCL_STATE": {
    "name": "/amcl/get_state",
    "type": "lifecycle_msgs/srv/GetState",
    "console": "",
    "moves": false
  },
  "MAP_SERVER_STATE": {
    "name": "/map_server/get_state",
    "type": "lifecycle_msgs/srv/GetState",
    "console": "",
    "moves": false
  },
  "GET_LOCAL_COSTMAP": {
    "name": "/local_costmap/get_costmap",
    "type": "nav2_msgs/srv/GetCostmap",
    "console": "",
    "moves": false
  },
  "GET_GLOBAL_COSTMAP": {
    "name": "/global_costmap/get_costmap",
    "type": "nav2_msgs/srv/GetCostmap",
    "console": "",
    "moves": false
  },
  "CLEAR_LOCAL_COSTMAP": {
    "name": "/local_costmap/clear_entirely_local_costmap",
    "type": "nav2_msgs/srv/ClearEntireCostmap",
    "console": "",
    "moves": false
  },
  "CLEAR_GLOBAL_COSTMAP": {
    "name": "/global_costmap/clear_entirely_global_costmap",
    "type": "nav2_msgs/srv/ClearEntireCostmap",
    "console": "",
    "moves": false
  },
  "ARM_PRESET": {
    "name": "/lupin/arm/preset",
    "type": "lupin_msgs/srv/SetArmPreset",
    "console": "operator",
    "moves": true
  },
  "ARM_SET_TORQUE": {
    "name": "/lupin/arm/set_torque",
    "type": "std_srvs/srv/SetBool",
    "console": "operator",
    "moves": false
  },
  "ARM_INIT": {
    "name": "/lupin/arm/init",
    "type": "std_srvs/srv/Trigger",
    "console": "operator",
    "moves": true
  },
  "ARM_CALIBRATE": {
    "name": "/lupin/arm/calibrate",
    "type": "lupin_msgs/srv/CalibrateArm",
    "console": "operator",
    "moves": true
  },
  "ARM_LIBRARY_LIST": {
    "name": "/lupin/arm/library/list",
    "type": "lupin_msgs/srv/GetArmLibrary",
    "console": "viewer",
    "moves": false
  },
  "ARM_LIBRARY_SAVE_POSE": {
    "name": "/lupin/arm/library/save_pose",
    "type": "lupin_msgs/srv/SaveArmPose",
    "console": "operator",
    "moves": false
  },
  "ARM_LIBRARY_GOTO_POSE": {
    "name": "/lupin/arm/library/goto_pose",
    "type": "lupin_msgs/srv/SetArmPreset",
    "console": "operator",
    "moves": true
  },
  "ARM_LIBRARY_RECORD": {
    "name": "/lupin/arm/library/record",
    "type": "lupin_msgs/srv/ArmRecord",
    "console": "operator",
    "moves": false
  },
  "ARM_LIBRARY_PLAY": {
    "name": "/lupin/arm/library/play",
    "type": "lupin_msgs/srv/PlayArmSequence",
    "console": "operator",
    "moves": true
  },
  "ARM_LIBRARY_STOP": {
    "name": "/lupin/arm/library/stop",
    "type": "std_srvs/srv/Trigger",
    "console": "viewer",
    "moves": false
  },
  "ARM_LIBRARY_DELETE": {
    "name": "/lupin/arm/library/delete",
    "type": "lupin_msgs/srv/ArmLibraryEdit",
    "console": "operator",
    "moves": false
  },
  "GRIPPER_ANGLE": {
    "name": "/lupin/gripper/set_angle_with_speed",
    "type": "mirte_msgs/srv/SetServoAngleWithSpeed",
    "console": "operator",
    "moves": true
  },
  "LEDS_SET": {
    "name": "/lupin/leds/set",
    "type": "mirte_msgs/srv/SetNeopixel",
    "console": "operator",
    "moves": false
  },
  "LEDS_AUTO": {
    "name": "/lupin/leds/auto",
    "type": "std_srvs/srv/Trigger",
    "console": "operator",
    "moves": false
  },
  "VENDOR_LEDS": {
    "name": "/io/leds/leds/set_color",
    "type": "mirte_msgs/srv/SetNeopixel",
    "console": "",
    "moves": false
  },
  "VENDOR_TORQUE": {
    "name": "/io/servo/hiwonder/enable_all_servos",
    "type": "std_srvs/srv/SetBool",
    "console": "",
    "moves": false
  },
  "VENDOR_ARM_GATE": {
    "name": "/enable_arm_control",
    "type": "std_srvs/srv/SetBool",
    "console": "",
    "moves": false
  },
  "LIST_CONTROLLERS": {
    "name": "/controller_manager/list_controllers",
    "type": "controller_manager_msgs/srv/ListControllers",
    "console": "",
    "moves": false
  },
  "LOAD_CONTROLLER": {
    "name": "/controller_manager/load_controller",
    "type": "controller_manager_msgs/srv/LoadController",
    "console": "",
    "moves": false
  },
  "CONFIGURE_CONTROLLER": {
    "name": "/controller_manager/configure_controller",
    "type": "controller_manager_msgs/srv/ConfigureController",
    "console": "",
    "moves": false
  },
  "SWITCH_CONTROLLER": {
    "name": "/controller_manager/switch_controller",
    "type": "controller_manager_msgs/srv/SwitchController",
    "console": "",
    "moves": false
  },
  "SIM_PRESS_ESTOP": {
    "name": "/sim/press_estop",
    "type": "std_srvs/srv/SetBool",
    "console": "",
    "moves": false
  },
  "GET_TIME": {
    "name": "/rosapi/get_time",
    "type": "rosapi_msgs/srv/GetTime",
    "console": "viewer",
    "moves": false
  },
  "TOPICS": {
    "name": "/rosapi/topics",
    "type": "rosapi_msgs/srv/Topics",
    "console": "viewer",
    "moves": false
  },
  "SUBSCRIBERS": {
    "name": "/rosapi/subscribers",
    "type": "rosapi_msgs/srv/Subscribers",
    "console": "viewer",
    "moves": false
  },
  "CANCEL_NAVIGATE_TO_POSE": {
    "name": "/navigate_to_pose/_action/cancel_goal",
    "type": "action_msgs/srv/CancelGoal",
    "console": "viewer",
    "moves": false
  },
  "CANCEL_NAVIGATE_THROUGH_POSES": {
    "name": "/navigate_through_poses/_action/cancel_goal",
    "type": "action_msgs/srv/CancelGoal",
    "console": "viewer",
    "moves": false
  },
  "CANCEL_FOLLOW_WAYPOINTS": {
    "name": "/follow_waypoints/_action/cancel_goal",
    "type": "action_msgs/srv/CancelGoal",
    "console": "viewer",
    "moves": false
  }
} as const;
export const ACTIONS = {
  "NAVIGATE_TO_POSE": {
    "name": "/navigate_to_pose",
    "type": "nav2_msgs/action/NavigateToPose",
    "console": "operator",
    "moves": true
  },
  "NAVIGATE_THROUGH_POSES": {
    "name": "/navigate_through_poses",
    "type": "nav2_msgs/action/NavigateThroughPoses",
    "console": "operator",
    "moves": true
  },
  "FOLLOW_WAYPOINTS": {
    "name": "/follow_waypoints",
    "type": "nav2_msgs/action/FollowWaypoints",
    "console": "operator",
    "moves": true
  },
  "COMPUTE_PATH_TO_POSE": {
    "name": "/compute_path_to_pose",
    "type": "nav2_msgs/action/ComputePathToPose",
    "console": "viewer",
    "moves": false
  },
  "GRIPPER_COMMAND": {
    "name": "/mirte_master_gripper_controller/gripper_cmd",
    "type": "control_msgs/action/GripperCommand",
    "console": "",
    "moves": false
  },
  "ARM_FOLLOW_TRAJECTORY": {
    "name": "/mirte_master_arm_controller/follow_joint_trajectory",
    "type": "control_msgs/action/FollowJointTrajectory",
    "console": "",
    "moves": false
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
    "console": "operator",
    "moves": true
  },
  "shoulder_lift_joint": {
    "name": "/lupin/arm/shoulder_lift/set_angle_with_speed",
    "type": "mirte_msgs/srv/SetServoAngleWithSpeed",
    "console": "operator",
    "moves": true
  },
  "elbow_joint": {
    "name": "/lupin/arm/elbow/set_angle_with_speed",
    "type": "mirte_msgs/srv/SetServoAngleWithSpeed",
    "console": "operator",
    "moves": true
  },
  "wrist_joint": {
    "name": "/lupin/arm/wrist/set_angle_with_speed",
    "type": "mirte_msgs/srv/SetServoAngleWithSpeed",
    "console": "operator",
    "moves": true
  },
  "gripper_joint": {
    "name": "/lupin/gripper/set_angle_with_speed",
    "type": "mirte_msgs/srv/SetServoAngleWithSpeed",
    "console": "operator",
    "moves": true
  }
} as const;
export const FRAMES = {
  "map": "map",
  "odom": "odom",
  "base": "base_link",
  "laser": "laser"
} as const;
