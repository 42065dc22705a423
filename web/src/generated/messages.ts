// Generated: `python -m tools.write_page_types`.
// Messages as the console's server sends them in CBOR: arrays of numbers are typed arrays, NaN is NaN.
export interface action_msgs_CancelGoal_Request {
  goal_info: action_msgs_GoalInfo;
}
export interface action_msgs_CancelGoal_Response {
  return_code: number;
  goals_canceling: action_msgs_GoalInfo[];
}
export const action_msgs_CancelGoal_Response = { ERROR_GOAL_TERMINATED: 3, ERROR_NONE: 0, ERROR_REJECTED: 1, ERROR_UNKNOWN_GOAL_ID: 2 } as const;
export interface action_msgs_GoalInfo {
  goal_id: unique_identifier_msgs_UUID;
  stamp: builtin_interfaces_Time;
}
export interface builtin_interfaces_Duration {
  sec: number;
  nanosec: number;
}
export interface builtin_interfaces_Time {
  sec: number;
  nanosec: number;
}
export interface control_msgs_FollowJointTrajectory_Feedback {
  header: std_msgs_Header;
  joint_names: string[];
  desired: trajectory_msgs_JointTrajectoryPoint;
  actual: trajectory_msgs_JointTrajectoryPoint;
  error: trajectory_msgs_JointTrajectoryPoint;
  multi_dof_joint_names: string[];
  multi_dof_desired: trajectory_msgs_MultiDOFJointTrajectoryPoint;
  multi_dof_actual: trajectory_msgs_MultiDOFJointTrajectoryPoint;
  multi_dof_error: trajectory_msgs_MultiDOFJointTrajectoryPoint;
}
export interface control_msgs_FollowJointTrajectory_Goal {
  trajectory: trajectory_msgs_JointTrajectory;
  multi_dof_trajectory: trajectory_msgs_MultiDOFJointTrajectory;
  path_tolerance: control_msgs_JointTolerance[];
  component_path_tolerance: control_msgs_JointComponentTolerance[];
  goal_tolerance: control_msgs_JointTolerance[];
  component_goal_tolerance: control_msgs_JointComponentTolerance[];
  goal_time_tolerance: builtin_interfaces_Duration;
}
export interface control_msgs_FollowJointTrajectory_Result {
  error_code: number;
  error_string: string;
}
export const control_msgs_FollowJointTrajectory_Result = { GOAL_TOLERANCE_VIOLATED: -5, INVALID_GOAL: -1, INVALID_JOINTS: -2, OLD_HEADER_TIMESTAMP: -3, PATH_TOLERANCE_VIOLATED: -4, SUCCESSFUL: 0 } as const;
export interface control_msgs_GripperCommand {
  position: number;
  max_effort: number;
}
export interface control_msgs_GripperCommand_Feedback {
  position: number;
  effort: number;
  stalled: boolean;
  reached_goal: boolean;
}
export interface control_msgs_GripperCommand_Goal {
  command: control_msgs_GripperCommand;
}
export interface control_msgs_GripperCommand_Result {
  position: number;
  effort: number;
  stalled: boolean;
  reached_goal: boolean;
}
export interface control_msgs_JointComponentTolerance {
  joint_name: string;
  component: number;
  position: number;
  velocity: number;
  acceleration: number;
}
export const control_msgs_JointComponentTolerance = { ROTATION: 5, TRANSLATION: 4, X_AXIS: 1, Y_AXIS: 2, Z_AXIS: 3 } as const;
export interface control_msgs_JointTolerance {
  name: string;
  position: number;
  velocity: number;
  acceleration: number;
}
export interface controller_manager_msgs_ChainConnection {
  name: string;
  reference_interfaces: string[];
}
export interface controller_manager_msgs_ConfigureController_Request {
  name: string;
}
export interface controller_manager_msgs_ConfigureController_Response {
  ok: boolean;
}
export interface controller_manager_msgs_ControllerState {
  name: string;
  state: string;
  type: string;
  claimed_interfaces: string[];
  required_command_interfaces: string[];
  required_state_interfaces: string[];
  is_chainable: boolean;
  is_chained: boolean;
  reference_interfaces: string[];
  chain_connections: controller_manager_msgs_ChainConnection[];
}
export interface controller_manager_msgs_ListControllers_Request {
}
export interface controller_manager_msgs_ListControllers_Response {
  controller: controller_manager_msgs_ControllerState[];
}
export interface controller_manager_msgs_LoadController_Request {
  name: string;
}
export interface controller_manager_msgs_LoadController_Response {
  ok: boolean;
}
export interface controller_manager_msgs_SwitchController_Request {
  activate_controllers: string[];
  deactivate_controllers: string[];
  start_controllers: string[];
  stop_controllers: string[];
  strictness: number;
  start_asap: boolean;
  activate_asap: boolean;
  timeout: builtin_interfaces_Duration;
}
export const controller_manager_msgs_SwitchController_Request = { BEST_EFFORT: 1, STRICT: 2 } as const;
export interface controller_manager_msgs_SwitchController_Response {
  ok: boolean;
}
export interface geometry_msgs_Point {
  x: number;
  y: number;
  z: number;
}
export interface geometry_msgs_Point32 {
  x: number;
  y: number;
  z: number;
}
export interface geometry_msgs_Polygon {
  points: geometry_msgs_Point32[];
}
export interface geometry_msgs_Pose {
  position: geometry_msgs_Point;
  orientation: geometry_msgs_Quaternion;
}
export interface geometry_msgs_Pose2D {
  x: number;
  y: number;
  theta: number;
}
export interface geometry_msgs_PoseStamped {
  header: std_msgs_Header;
  pose: geometry_msgs_Pose;
}
export interface geometry_msgs_PoseWithCovariance {
  pose: geometry_msgs_Pose;
  covariance: Float64Array;
}
export interface geometry_msgs_PoseWithCovarianceStamped {
  header: std_msgs_Header;
  pose: geometry_msgs_PoseWithCovariance;
}
export interface geometry_msgs_Quaternion {
  x: number;
  y: number;
  z: number;
  w: number;
}
export const geometry_msgs_Quaternion = { W__DEFAULT: 1.0, X__DEFAULT: 0.0, Y__DEFAULT: 0.0, Z__DEFAULT: 0.0 } as const;
export interface geometry_msgs_Transform {
  translation: geometry_msgs_Vector3;
  rotation: geometry_msgs_Quaternion;
}
export interface geometry_msgs_TransformStamped {
  header: std_msgs_Header;
  child_frame_id: string;
  transform: geometry_msgs_Transform;
}
export interface geometry_msgs_Twist {
  linear: geometry_msgs_Vector3;
  angular: geometry_msgs_Vector3;
}
export interface geometry_msgs_TwistStamped {
  header: std_msgs_Header;
  twist: geometry_msgs_Twist;
}
export interface geometry_msgs_TwistWithCovariance {
  twist: geometry_msgs_Twist;
  covariance: Float64Array;
}
export interface geometry_msgs_Vector3 {
  x: number;
  y: number;
  z: number;
}
export interface lifecycle_msgs_GetState_Request {
}
export interface lifecycle_msgs_GetState_Response {
  current_state: lifecycle_msgs_State;
}
export interface lifecycle_msgs_State {
  id: number;
  label: string;
}
export const lifecycle_msgs_State = { PRIMARY_STATE_ACTIVE: 3, PRIMARY_STATE_FINALIZED: 4, PRIMARY_STATE_INACTIVE: 2, PRIMARY_STATE_UNCONFIGURED: 1, PRIMARY_STATE_UNKNOWN: 0, TRANSITION_STATE_ACTIVATING: 13, TRANSITION_STATE_CLEANINGUP: 11, TRANSITION_STATE_CONFIGURING: 10, TRANSITION_STATE_DEACTIVATING: 14, TRANSITION_STATE_ERRORPROCESSING: 15, TRANSITION_STATE_SHUTTINGDOWN: 12 } as const;
export interface lupin_msgs_AnomalyReport {
  pose: geometry_msgs_PoseStamped;
  description: string;
  severity: number;
}
export interface lupin_msgs_ArmLibraryEdit_Request {
  kind: string;
  name: string;
  new_name: string;
}
export interface lupin_msgs_ArmLibraryEdit_Response {
  success: boolean;
  message: string;
}
export interface lupin_msgs_ArmRecord_Request {
  action: string;
  name: string;
  mode: string;
  include_gripper: boolean;
  overwrite: boolean;
}
export interface lupin_msgs_ArmRecord_Response {
  success: boolean;
  message: string;
  duration_s: number;
  n_waypoints: number;
}
export interface lupin_msgs_CalibrateArm_Request {
  action: string;
}
export interface lupin_msgs_CalibrateArm_Response {
  success: boolean;
  state: string;
  message: string;
  joint_names: string[];
  offsets_applied: Int32Array;
  diffs_observed: Int32Array;
}
export interface lupin_msgs_ConfirmTag_Request {
  expected_tag_id: string;
}
export interface lupin_msgs_ConfirmTag_Response {
  detected: boolean;
  detection_confidence: number;
  tag_pose_in_map: geometry_msgs_Pose;
  error_message: string;
}
export interface lupin_msgs_DiscoveredTag {
  tag_id: string;
  pose_in_map: geometry_msgs_Pose;
  species: string;
  species_confidence: number;
  anomaly: boolean;
  sightings: number;
}
export interface lupin_msgs_DiscoveredTags {
  header: std_msgs_Header;
  tags: lupin_msgs_DiscoveredTag[];
}
export interface lupin_msgs_FlowerObservation {
  tag_id: string;
  pose: geometry_msgs_PoseStamped;
  species: string;
  confidence: number;
  anomaly: boolean;
  flower_count: number;
  bug_count: number;
  flowers: lupin_msgs_FlowerPoint[];
  box_footprint: geometry_msgs_Polygon;
}
export interface lupin_msgs_FlowerPoint {
  position: geometry_msgs_Point;
  height_m: number;
  species: string;
  confidence: number;
  anomaly: boolean;
}
export interface lupin_msgs_GetArmLibrary_Request {
}
export interface lupin_msgs_GetArmLibrary_Response {
  success: boolean;
  json: string;
}
export interface lupin_msgs_GetField_Request {
  sensor_type: string;
  resolution: number;
  bbox_min_x: number;
  bbox_min_y: number;
  bbox_max_x: number;
  bbox_max_y: number;
}
export interface lupin_msgs_GetField_Response {
  ok: boolean;
  error_message: string;
  values: Float32Array;
  width: number;
  height: number;
  origin_x: number;
  origin_y: number;
  resolution_used: number;
  value_min: number;
  value_max: number;
  sample_count: number;
}
export interface lupin_msgs_GetTagReading_Request {
  tag_id: string;
}
export interface lupin_msgs_GetTagReading_Response {
  status: number;
  error_message: string;
  reading: lupin_msgs_TagReading;
}
export const lupin_msgs_GetTagReading_Response = { STATUS_OK: 0, STATUS_UNKNOWN_TAG: 1 } as const;
export interface lupin_msgs_MissionState {
  header: std_msgs_Header;
  mission_id: string;
  mission_type: string;
  lifecycle_state: string;
  mission_phase: string;
  current_target: string;
  targets_total: number;
  targets_completed: number;
  targets_failed: number;
  targets_unreachable: number;
  targets_skipped: number;
  last_error: string;
  last_event: string;
  last_event_severity: number;
  tags_discovered: number;
  discovery_goal: number;
  estop_engaged: boolean;
  paused: boolean;
  battery_percentage: number;
  battery_low: boolean;
  started_at: builtin_interfaces_Time;
}
export const lupin_msgs_MissionState = { SEVERITY_ERROR: 2, SEVERITY_INFO: 0, SEVERITY_WARN: 1 } as const;
export interface lupin_msgs_Observation {
  header: std_msgs_Header;
  mission_id: string;
  source: string;
  kind: number;
  status: number;
  status_detail: string;
  tag_reading: lupin_msgs_TagReading;
  flower: lupin_msgs_FlowerObservation;
  anomaly: lupin_msgs_AnomalyReport;
  tag_pose_in_map: geometry_msgs_Pose;
}
export const lupin_msgs_Observation = { KIND_ANOMALY: 2, KIND_FLOWER: 1, KIND_TAG_READING: 0, STATUS_OK: 0, STATUS_SCAN_FAILED: 2, STATUS_SKIPPED: 3, STATUS_UNREACHABLE: 1 } as const;
export interface lupin_msgs_PlayArmSequence_Request {
  name: string;
  speed: number;
}
export interface lupin_msgs_PlayArmSequence_Response {
  success: boolean;
  message: string;
}
export interface lupin_msgs_SaveArmPose_Request {
  name: string;
  from_current: boolean;
  arm_rad: Float64Array;
  gripper_rad: number;
  has_gripper: boolean;
  overwrite: boolean;
}
export interface lupin_msgs_SaveArmPose_Response {
  success: boolean;
  message: string;
}
export interface lupin_msgs_SensorReading {
  name: string;
  value: number;
}
export interface lupin_msgs_SetArmPreset_Request {
  name: string;
}
export interface lupin_msgs_SetArmPreset_Response {
  success: boolean;
  message: string;
}
export interface lupin_msgs_StartMission_Request {
  mission_type: string;
  tag_sequence: string[];
  discovery_goal: number;
}
export interface lupin_msgs_StartMission_Response {
  accepted: boolean;
  mission_id: string;
  error_message: string;
}
export interface lupin_msgs_TagReading {
  tag_id: string;
  stamp: builtin_interfaces_Time;
  sim_time_of_day_seconds: number;
  readings: lupin_msgs_SensorReading[];
}
export interface lupin_msgs_TwinState {
  header: std_msgs_Header;
  tags: lupin_msgs_TwinTagState[];
}
export interface lupin_msgs_TwinTagState {
  tag_id: string;
  pose: geometry_msgs_Pose;
  readings: lupin_msgs_SensorReading[];
  last_observed: builtin_interfaces_Time;
  stale_seconds: number;
  species: string;
  species_confidence: number;
  anomaly: boolean;
  flower_count: number;
  bug_count: number;
  flowers: lupin_msgs_FlowerPoint[];
  box_footprint: geometry_msgs_Polygon;
}
export interface mirte_msgs_GetServoOffset_Request {
}
export interface mirte_msgs_GetServoOffset_Response {
  centidegrees: number;
}
export interface mirte_msgs_GetServoRange_Request {
}
export interface mirte_msgs_GetServoRange_Response {
  min: number;
  max: number;
}
export interface mirte_msgs_IntensityDigital {
  header: std_msgs_Header;
  value: boolean;
}
export interface mirte_msgs_NeopixelColor {
  r: number;
  g: number;
  b: number;
}
export interface mirte_msgs_ServoPosition {
  header: std_msgs_Header;
  angle: number;
  raw: number;
}
export interface mirte_msgs_SetNeopixel_Request {
  color: mirte_msgs_NeopixelColor;
}
export interface mirte_msgs_SetNeopixel_Response {
  status: boolean;
}
export interface mirte_msgs_SetServoAngleWithSpeed_Request {
  angle: number;
  rate: number;
  degrees: boolean;
}
export const mirte_msgs_SetServoAngleWithSpeed_Request = { DEGREES: true, DEGREES__DEFAULT: true, RADIANS: false } as const;
export interface mirte_msgs_SetServoAngleWithSpeed_Response {
  status: boolean;
}
export interface mirte_msgs_SetServoAngle_Request {
  angle: number;
  degrees: boolean;
}
export const mirte_msgs_SetServoAngle_Request = { DEGREES: true, DEGREES__DEFAULT: true, RADIANS: false } as const;
export interface mirte_msgs_SetServoAngle_Response {
  status: boolean;
}
export interface mirte_msgs_SetServoOffset_Request {
  centidegrees: number;
}
export interface mirte_msgs_SetServoOffset_Response {
}
export interface nav2_msgs_ClearEntireCostmap_Request {
  request: std_msgs_Empty;
}
export interface nav2_msgs_ClearEntireCostmap_Response {
  response: std_msgs_Empty;
}
export interface nav2_msgs_ComputePathToPose_Feedback {
}
export interface nav2_msgs_ComputePathToPose_Goal {
  goal: geometry_msgs_PoseStamped;
  start: geometry_msgs_PoseStamped;
  planner_id: string;
  use_start: boolean;
}
export interface nav2_msgs_ComputePathToPose_Result {
  path: nav_msgs_Path;
  planning_time: builtin_interfaces_Duration;
  error_code: number;
  error_msg: string;
}
export const nav2_msgs_ComputePathToPose_Result = { GOAL_OCCUPIED: 206, GOAL_OUTSIDE_MAP: 204, INVALID_PLANNER: 201, NONE: 0, NO_VALID_PATH: 208, START_OCCUPIED: 205, START_OUTSIDE_MAP: 203, TF_ERROR: 202, TIMEOUT: 207, UNKNOWN: 200 } as const;
export interface nav2_msgs_Costmap {
  header: std_msgs_Header;
  metadata: nav2_msgs_CostmapMetaData;
  data: Uint8Array;
}
export interface nav2_msgs_CostmapMetaData {
  map_load_time: builtin_interfaces_Time;
  update_time: builtin_interfaces_Time;
  layer: string;
  resolution: number;
  size_x: number;
  size_y: number;
  origin: geometry_msgs_Pose;
}
export interface nav2_msgs_FollowWaypoints_Feedback {
  current_waypoint: number;
}
export interface nav2_msgs_FollowWaypoints_Goal {
  number_of_loops: number;
  goal_index: number;
  poses: geometry_msgs_PoseStamped[];
}
export const nav2_msgs_FollowWaypoints_Goal = { GOAL_INDEX__DEFAULT: 0 } as const;
export interface nav2_msgs_FollowWaypoints_Result {
  missed_waypoints: nav2_msgs_MissedWaypoint[];
  error_code: number;
  error_msg: string;
}
export const nav2_msgs_FollowWaypoints_Result = { NONE: 0, TASK_EXECUTOR_FAILED: 601, UNKNOWN: 600 } as const;
export interface nav2_msgs_GetCostmap_Request {
  specs: nav2_msgs_CostmapMetaData;
}
export interface nav2_msgs_GetCostmap_Response {
  map: nav2_msgs_Costmap;
}
export interface nav2_msgs_LoadMap_Request {
  map_url: string;
}
export interface nav2_msgs_LoadMap_Response {
  map: nav_msgs_OccupancyGrid;
  result: number;
}
export const nav2_msgs_LoadMap_Response = { RESULT_INVALID_MAP_DATA: 2, RESULT_INVALID_MAP_METADATA: 3, RESULT_MAP_DOES_NOT_EXIST: 1, RESULT_SUCCESS: 0, RESULT_UNDEFINED_FAILURE: 255 } as const;
export interface nav2_msgs_MissedWaypoint {
  index: number;
  goal: geometry_msgs_PoseStamped;
  error_code: number;
}
export interface nav2_msgs_NavigateThroughPoses_Feedback {
  current_pose: geometry_msgs_PoseStamped;
  navigation_time: builtin_interfaces_Duration;
  estimated_time_remaining: builtin_interfaces_Duration;
  number_of_recoveries: number;
  distance_remaining: number;
  number_of_poses_remaining: number;
}
export interface nav2_msgs_NavigateThroughPoses_Goal {
  poses: geometry_msgs_PoseStamped[];
  behavior_tree: string;
}
export interface nav2_msgs_NavigateThroughPoses_Result {
  error_code: number;
  error_msg: string;
}
export const nav2_msgs_NavigateThroughPoses_Result = { NONE: 0 } as const;
export interface nav2_msgs_NavigateToPose_Feedback {
  current_pose: geometry_msgs_PoseStamped;
  navigation_time: builtin_interfaces_Duration;
  estimated_time_remaining: builtin_interfaces_Duration;
  number_of_recoveries: number;
  distance_remaining: number;
}
export interface nav2_msgs_NavigateToPose_Goal {
  pose: geometry_msgs_PoseStamped;
  behavior_tree: string;
}
export interface nav2_msgs_NavigateToPose_Result {
  error_code: number;
  error_msg: string;
}
export const nav2_msgs_NavigateToPose_Result = { NONE: 0 } as const;
export interface nav_msgs_GetMap_Request {
}
export interface nav_msgs_GetMap_Response {
  map: nav_msgs_OccupancyGrid;
}
export interface nav_msgs_MapMetaData {
  map_load_time: builtin_interfaces_Time;
  resolution: number;
  width: number;
  height: number;
  origin: geometry_msgs_Pose;
}
export interface nav_msgs_OccupancyGrid {
  header: std_msgs_Header;
  info: nav_msgs_MapMetaData;
  data: Int8Array;
}
export interface nav_msgs_Odometry {
  header: std_msgs_Header;
  child_frame_id: string;
  pose: geometry_msgs_PoseWithCovariance;
  twist: geometry_msgs_TwistWithCovariance;
}
export interface nav_msgs_Path {
  header: std_msgs_Header;
  poses: geometry_msgs_PoseStamped[];
}
export interface rcl_interfaces_Log {
  stamp: builtin_interfaces_Time;
  level: number;
  name: string;
  msg: string;
  file: string;
  function: string;
  line: number;
}
export const rcl_interfaces_Log = { DEBUG: 10, ERROR: 40, FATAL: 50, INFO: 20, WARN: 30 } as const;
export interface rosapi_msgs_GetTime_Request {
}
export interface rosapi_msgs_GetTime_Response {
  time: builtin_interfaces_Time;
}
export interface rosapi_msgs_Subscribers_Request {
  topic: string;
}
export interface rosapi_msgs_Subscribers_Response {
  subscribers: string[];
}
export interface rosapi_msgs_Topics_Request {
}
export interface rosapi_msgs_Topics_Response {
  topics: string[];
  types: string[];
}
export interface rosgraph_msgs_Clock {
  clock: builtin_interfaces_Time;
}
export interface sensor_msgs_BatteryState {
  header: std_msgs_Header;
  voltage: number;
  temperature: number;
  current: number;
  charge: number;
  capacity: number;
  design_capacity: number;
  percentage: number;
  power_supply_status: number;
  power_supply_health: number;
  power_supply_technology: number;
  present: boolean;
  cell_voltage: Float32Array;
  cell_temperature: Float32Array;
  location: string;
  serial_number: string;
}
export const sensor_msgs_BatteryState = { POWER_SUPPLY_HEALTH_COLD: 6, POWER_SUPPLY_HEALTH_DEAD: 3, POWER_SUPPLY_HEALTH_GOOD: 1, POWER_SUPPLY_HEALTH_OVERHEAT: 2, POWER_SUPPLY_HEALTH_OVERVOLTAGE: 4, POWER_SUPPLY_HEALTH_SAFETY_TIMER_EXPIRE: 8, POWER_SUPPLY_HEALTH_UNKNOWN: 0, POWER_SUPPLY_HEALTH_UNSPEC_FAILURE: 5, POWER_SUPPLY_HEALTH_WATCHDOG_TIMER_EXPIRE: 7, POWER_SUPPLY_STATUS_CHARGING: 1, POWER_SUPPLY_STATUS_DISCHARGING: 2, POWER_SUPPLY_STATUS_FULL: 4, POWER_SUPPLY_STATUS_NOT_CHARGING: 3, POWER_SUPPLY_STATUS_UNKNOWN: 0, POWER_SUPPLY_TECHNOLOGY_LIFE: 4, POWER_SUPPLY_TECHNOLOGY_LIMN: 6, POWER_SUPPLY_TECHNOLOGY_LION: 2, POWER_SUPPLY_TECHNOLOGY_LIPO: 3, POWER_SUPPLY_TECHNOLOGY_NICD: 5, POWER_SUPPLY_TECHNOLOGY_NIMH: 1, POWER_SUPPLY_TECHNOLOGY_TERNARY: 7, POWER_SUPPLY_TECHNOLOGY_UNKNOWN: 0, POWER_SUPPLY_TECHNOLOGY_VRLA: 8 } as const;
export interface sensor_msgs_CameraInfo {
  header: std_msgs_Header;
  height: number;
  width: number;
  distortion_model: string;
  d: Float64Array;
  k: Float64Array;
  r: Float64Array;
  p: Float64Array;
  binning_x: number;
  binning_y: number;
  roi: sensor_msgs_RegionOfInterest;
}
export interface sensor_msgs_CompressedImage {
  header: std_msgs_Header;
  format: string;
  data: Uint8Array;
}
export interface sensor_msgs_Image {
  header: std_msgs_Header;
  height: number;
  width: number;
  encoding: string;
  is_bigendian: number;
  step: number;
  data: Uint8Array;
}
export interface sensor_msgs_Imu {
  header: std_msgs_Header;
  orientation: geometry_msgs_Quaternion;
  orientation_covariance: Float64Array;
  angular_velocity: geometry_msgs_Vector3;
  angular_velocity_covariance: Float64Array;
  linear_acceleration: geometry_msgs_Vector3;
  linear_acceleration_covariance: Float64Array;
}
export interface sensor_msgs_JointState {
  header: std_msgs_Header;
  name: string[];
  position: Float64Array;
  velocity: Float64Array;
  effort: Float64Array;
}
export interface sensor_msgs_Joy {
  header: std_msgs_Header;
  axes: Float32Array;
  buttons: Int32Array;
}
export interface sensor_msgs_LaserScan {
  header: std_msgs_Header;
  angle_min: number;
  angle_max: number;
  angle_increment: number;
  time_increment: number;
  scan_time: number;
  range_min: number;
  range_max: number;
  ranges: Float32Array;
  intensities: Float32Array;
}
export interface sensor_msgs_RegionOfInterest {
  x_offset: number;
  y_offset: number;
  height: number;
  width: number;
  do_rectify: boolean;
}
export interface slam_toolbox_DeserializePoseGraph_Request {
  filename: string;
  match_type: number;
  initial_pose: geometry_msgs_Pose2D;
}
export const slam_toolbox_DeserializePoseGraph_Request = { LOCALIZE_AT_POSE: 3, START_AT_FIRST_NODE: 1, START_AT_GIVEN_POSE: 2, UNSET: 0 } as const;
export interface slam_toolbox_DeserializePoseGraph_Response {
}
export interface slam_toolbox_Pause_Request {
}
export interface slam_toolbox_Pause_Response {
  status: boolean;
}
export interface slam_toolbox_Reset_Request {
  pause_new_measurements: boolean;
}
export const slam_toolbox_Reset_Request = { PAUSE_NEW_MEASUREMENTS__DEFAULT: false } as const;
export interface slam_toolbox_Reset_Response {
  result: number;
}
export const slam_toolbox_Reset_Response = { RESULT_SUCCESS: 0 } as const;
export interface slam_toolbox_SaveMap_Request {
  name: std_msgs_String;
}
export interface slam_toolbox_SaveMap_Response {
  result: number;
}
export const slam_toolbox_SaveMap_Response = { RESULT_NO_MAP_RECEIEVD: 1, RESULT_SUCCESS: 0, RESULT_UNDEFINED_FAILURE: 255 } as const;
export interface slam_toolbox_SerializePoseGraph_Request {
  filename: string;
}
export interface slam_toolbox_SerializePoseGraph_Response {
  result: number;
}
export const slam_toolbox_SerializePoseGraph_Response = { RESULT_FAILED_TO_WRITE_FILE: 255, RESULT_SUCCESS: 0 } as const;
export interface std_msgs_Bool {
  data: boolean;
}
export interface std_msgs_ColorRGBA {
  r: number;
  g: number;
  b: number;
  a: number;
}
export interface std_msgs_Empty {
}
export interface std_msgs_Float32 {
  data: number;
}
export interface std_msgs_Header {
  stamp: builtin_interfaces_Time;
  frame_id: string;
}
export interface std_msgs_String {
  data: string;
}
export interface std_srvs_SetBool_Request {
  data: boolean;
}
export interface std_srvs_SetBool_Response {
  success: boolean;
  message: string;
}
export interface std_srvs_Trigger_Request {
}
export interface std_srvs_Trigger_Response {
  success: boolean;
  message: string;
}
export interface tf2_msgs_TFMessage {
  transforms: geometry_msgs_TransformStamped[];
}
export interface trajectory_msgs_JointTrajectory {
  header: std_msgs_Header;
  joint_names: string[];
  points: trajectory_msgs_JointTrajectoryPoint[];
}
export interface trajectory_msgs_JointTrajectoryPoint {
  positions: Float64Array;
  velocities: Float64Array;
  accelerations: Float64Array;
  effort: Float64Array;
  time_from_start: builtin_interfaces_Duration;
}
export interface trajectory_msgs_MultiDOFJointTrajectory {
  header: std_msgs_Header;
  joint_names: string[];
  points: trajectory_msgs_MultiDOFJointTrajectoryPoint[];
}
export interface trajectory_msgs_MultiDOFJointTrajectoryPoint {
  transforms: geometry_msgs_Transform[];
  velocities: geometry_msgs_Twist[];
  accelerations: geometry_msgs_Twist[];
  time_from_start: builtin_interfaces_Duration;
}
export interface unique_identifier_msgs_UUID {
  uuid: Uint8Array;
}
export interface visualization_msgs_Marker {
  header: std_msgs_Header;
  ns: string;
  id: number;
  type: number;
  action: number;
  pose: geometry_msgs_Pose;
  scale: geometry_msgs_Vector3;
  color: std_msgs_ColorRGBA;
  lifetime: builtin_interfaces_Duration;
  frame_locked: boolean;
  points: geometry_msgs_Point[];
  colors: std_msgs_ColorRGBA[];
  texture_resource: string;
  texture: sensor_msgs_CompressedImage;
  uv_coordinates: visualization_msgs_UVCoordinate[];
  text: string;
  mesh_resource: string;
  mesh_file: visualization_msgs_MeshFile;
  mesh_use_embedded_materials: boolean;
}
export const visualization_msgs_Marker = { ADD: 0, ARROW: 0, ARROW_STRIP: 12, CUBE: 1, CUBE_LIST: 6, CYLINDER: 3, DELETE: 2, DELETEALL: 3, LINE_LIST: 5, LINE_STRIP: 4, MESH_RESOURCE: 10, MODIFY: 0, POINTS: 8, SPHERE: 2, SPHERE_LIST: 7, TEXT_VIEW_FACING: 9, TRIANGLE_LIST: 11 } as const;
export interface visualization_msgs_MarkerArray {
  markers: visualization_msgs_Marker[];
}
export interface visualization_msgs_MeshFile {
  filename: string;
  data: Uint8Array;
}
export interface visualization_msgs_UVCoordinate {
  u: number;
  v: number;
}
export interface MessageTypes {
  "geometry_msgs/msg/PoseStamped": geometry_msgs_PoseStamped;
  "geometry_msgs/msg/PoseWithCovarianceStamped": geometry_msgs_PoseWithCovarianceStamped;
  "geometry_msgs/msg/Twist": geometry_msgs_Twist;
  "geometry_msgs/msg/TwistStamped": geometry_msgs_TwistStamped;
  "lupin_msgs/msg/DiscoveredTags": lupin_msgs_DiscoveredTags;
  "lupin_msgs/msg/MissionState": lupin_msgs_MissionState;
  "lupin_msgs/msg/Observation": lupin_msgs_Observation;
  "lupin_msgs/msg/TwinState": lupin_msgs_TwinState;
  "mirte_msgs/msg/IntensityDigital": mirte_msgs_IntensityDigital;
  "mirte_msgs/msg/ServoPosition": mirte_msgs_ServoPosition;
  "nav_msgs/msg/OccupancyGrid": nav_msgs_OccupancyGrid;
  "nav_msgs/msg/Odometry": nav_msgs_Odometry;
  "nav_msgs/msg/Path": nav_msgs_Path;
  "rcl_interfaces/msg/Log": rcl_interfaces_Log;
  "rosgraph_msgs/msg/Clock": rosgraph_msgs_Clock;
  "sensor_msgs/msg/BatteryState": sensor_msgs_BatteryState;
  "sensor_msgs/msg/CameraInfo": sensor_msgs_CameraInfo;
  "sensor_msgs/msg/CompressedImage": sensor_msgs_CompressedImage;
  "sensor_msgs/msg/Image": sensor_msgs_Image;
  "sensor_msgs/msg/Imu": sensor_msgs_Imu;
  "sensor_msgs/msg/JointState": sensor_msgs_JointState;
  "sensor_msgs/msg/Joy": sensor_msgs_Joy;
  "sensor_msgs/msg/LaserScan": sensor_msgs_LaserScan;
  "std_msgs/msg/Bool": std_msgs_Bool;
  "std_msgs/msg/Float32": std_msgs_Float32;
  "std_msgs/msg/String": std_msgs_String;
  "tf2_msgs/msg/TFMessage": tf2_msgs_TFMessage;
  "trajectory_msgs/msg/JointTrajectory": trajectory_msgs_JointTrajectory;
  "visualization_msgs/msg/MarkerArray": visualization_msgs_MarkerArray;
}
export interface ServiceTypes {
  "action_msgs/srv/CancelGoal": { request: action_msgs_CancelGoal_Request; response: action_msgs_CancelGoal_Response };
  "controller_manager_msgs/srv/ConfigureController": { request: controller_manager_msgs_ConfigureController_Request; response: controller_manager_msgs_ConfigureController_Response };
  "controller_manager_msgs/srv/ListControllers": { request: controller_manager_msgs_ListControllers_Request; response: controller_manager_msgs_ListControllers_Response };
  "controller_manager_msgs/srv/LoadController": { request: controller_manager_msgs_LoadController_Request; response: controller_manager_msgs_LoadController_Response };
  "controller_manager_msgs/srv/SwitchController": { request: controller_manager_msgs_SwitchController_Request; response: controller_manager_msgs_SwitchController_Response };
  "lifecycle_msgs/srv/GetState": { request: lifecycle_msgs_GetState_Request; response: lifecycle_msgs_GetState_Response };
  "lupin_msgs/srv/ArmLibraryEdit": { request: lupin_msgs_ArmLibraryEdit_Request; response: lupin_msgs_ArmLibraryEdit_Response };
  "lupin_msgs/srv/ArmRecord": { request: lupin_msgs_ArmRecord_Request; response: lupin_msgs_ArmRecord_Response };
  "lupin_msgs/srv/CalibrateArm": { request: lupin_msgs_CalibrateArm_Request; response: lupin_msgs_CalibrateArm_Response };
  "lupin_msgs/srv/ConfirmTag": { request: lupin_msgs_ConfirmTag_Request; response: lupin_msgs_ConfirmTag_Response };
  "lupin_msgs/srv/GetArmLibrary": { request: lupin_msgs_GetArmLibrary_Request; response: lupin_msgs_GetArmLibrary_Response };
  "lupin_msgs/srv/GetField": { request: lupin_msgs_GetField_Request; response: lupin_msgs_GetField_Response };
  "lupin_msgs/srv/GetTagReading": { request: lupin_msgs_GetTagReading_Request; response: lupin_msgs_GetTagReading_Response };
  "lupin_msgs/srv/PlayArmSequence": { request: lupin_msgs_PlayArmSequence_Request; response: lupin_msgs_PlayArmSequence_Response };
  "lupin_msgs/srv/SaveArmPose": { request: lupin_msgs_SaveArmPose_Request; response: lupin_msgs_SaveArmPose_Response };
  "lupin_msgs/srv/SetArmPreset": { request: lupin_msgs_SetArmPreset_Request; response: lupin_msgs_SetArmPreset_Response };
  "lupin_msgs/srv/StartMission": { request: lupin_msgs_StartMission_Request; response: lupin_msgs_StartMission_Response };
  "mirte_msgs/srv/GetServoOffset": { request: mirte_msgs_GetServoOffset_Request; response: mirte_msgs_GetServoOffset_Response };
  "mirte_msgs/srv/GetServoRange": { request: mirte_msgs_GetServoRange_Request; response: mirte_msgs_GetServoRange_Response };
  "mirte_msgs/srv/SetNeopixel": { request: mirte_msgs_SetNeopixel_Request; response: mirte_msgs_SetNeopixel_Response };
  "mirte_msgs/srv/SetServoAngle": { request: mirte_msgs_SetServoAngle_Request; response: mirte_msgs_SetServoAngle_Response };
  "mirte_msgs/srv/SetServoAngleWithSpeed": { request: mirte_msgs_SetServoAngleWithSpeed_Request; response: mirte_msgs_SetServoAngleWithSpeed_Response };
  "mirte_msgs/srv/SetServoOffset": { request: mirte_msgs_SetServoOffset_Request; response: mirte_msgs_SetServoOffset_Response };
  "nav2_msgs/srv/ClearEntireCostmap": { request: nav2_msgs_ClearEntireCostmap_Request; response: nav2_msgs_ClearEntireCostmap_Response };
  "nav2_msgs/srv/GetCostmap": { request: nav2_msgs_GetCostmap_Request; response: nav2_msgs_GetCostmap_Response };
  "nav2_msgs/srv/LoadMap": { request: nav2_msgs_LoadMap_Request; response: nav2_msgs_LoadMap_Response };
  "nav_msgs/srv/GetMap": { request: nav_msgs_GetMap_Request; response: nav_msgs_GetMap_Response };
  "rosapi_msgs/srv/GetTime": { request: rosapi_msgs_GetTime_Request; response: rosapi_msgs_GetTime_Response };
  "rosapi_msgs/srv/Subscribers": { request: rosapi_msgs_Subscribers_Request; response: rosapi_msgs_Subscribers_Response };
  "rosapi_msgs/srv/Topics": { request: rosapi_msgs_Topics_Request; response: rosapi_msgs_Topics_Response };
  "slam_toolbox/srv/DeserializePoseGraph": { request: slam_toolbox_DeserializePoseGraph_Request; response: slam_toolbox_DeserializePoseGraph_Response };
  "slam_toolbox/srv/Pause": { request: slam_toolbox_Pause_Request; response: slam_toolbox_Pause_Response };
  "slam_toolbox/srv/Reset": { request: slam_toolbox_Reset_Request; response: slam_toolbox_Reset_Response };
  "slam_toolbox/srv/SaveMap": { request: slam_toolbox_SaveMap_Request; response: slam_toolbox_SaveMap_Response };
  "slam_toolbox/srv/SerializePoseGraph": { request: slam_toolbox_SerializePoseGraph_Request; response: slam_toolbox_SerializePoseGraph_Response };
  "std_srvs/srv/SetBool": { request: std_srvs_SetBool_Request; response: std_srvs_SetBool_Response };
  "std_srvs/srv/Trigger": { request: std_srvs_Trigger_Request; response: std_srvs_Trigger_Response };
}
export interface ActionTypes {
  "control_msgs/action/FollowJointTrajectory": { goal: control_msgs_FollowJointTrajectory_Goal; result: control_msgs_FollowJointTrajectory_Result; feedback: control_msgs_FollowJointTrajectory_Feedback };
  "control_msgs/action/GripperCommand": { goal: control_msgs_GripperCommand_Goal; result: control_msgs_GripperCommand_Result; feedback: control_msgs_GripperCommand_Feedback };
  "nav2_msgs/action/ComputePathToPose": { goal: nav2_msgs_ComputePathToPose_Goal; result: nav2_msgs_ComputePathToPose_Result; feedback: nav2_msgs_ComputePathToPose_Feedback };
  "nav2_msgs/action/FollowWaypoints": { goal: nav2_msgs_FollowWaypoints_Goal; result: nav2_msgs_FollowWaypoints_Result; feedback: nav2_msgs_FollowWaypoints_Feedback };
  "nav2_msgs/action/NavigateThroughPoses": { goal: nav2_msgs_NavigateThroughPoses_Goal; result: nav2_msgs_NavigateThroughPoses_Result; feedback: nav2_msgs_NavigateThroughPoses_Feedback };
  "nav2_msgs/action/NavigateToPose": { goal: nav2_msgs_NavigateToPose_Goal; result: nav2_msgs_NavigateToPose_Result; feedback: nav2_msgs_NavigateToPose_Feedback };
}
