// Generated: `python -m tools.write_page_types`.
export const SETTINGS_VERSION = 5;
export const OLDEST_SETTINGS_VERSION = 2;
export interface Settings {
  cmdVelTopic: string;
  cmdVelType: "geometry_msgs/msg/Twist" | "geometry_msgs/msg/TwistStamped";
  imuTopic: string;
  batteryTopic: string;
  scanTopic: string;
  odomTopic: string;
  jointStatesTopic: string;
  rosoutTopic: string;
  cameraTopic: string;
  mapTopic: string;
  planTopic: string;
  goalPoseTopic: string;
  rosUrl: string;
  webVideoServerUrl: string;
  mapFrame: string;
  baseFrame: string;
  speedScale: number;
  armServoNamespace: string;
  armRateDegPerSec: number;
  geminiModel: string;
  voiceLanguage: string;
  voicePushToTalk: boolean;
  voiceVadEnabled: boolean;
  voiceVadEndHoldMs: number;
  voiceVadStartThreshold: number;
  voiceVadEndThreshold: number;
  voiceVadMaxUtteranceMs: number;
  voiceMaxLinearMps: number;
  voiceMaxAngularRps: number;
  voiceSystemPrompt: string;
  theme: "dark" | "light";
  surfaceContrast: "normal" | "high";
  reduceTransparency: boolean;
  debugPublish: boolean;
  estopAutoOnFocusLoss: boolean;
  polarityInvertHmi: boolean;
}
export const SETTINGS = {
  "cmdVelTopic": {
    "default": "/cmd_vel_manual",
    "unit": "",
    "ros_name": true
  },
  "cmdVelType": {
    "default": "geometry_msgs/msg/Twist",
    "unit": "",
    "choices": [
      "geometry_msgs/msg/Twist",
      "geometry_msgs/msg/TwistStamped"
    ]
  },
  "imuTopic": {
    "default": "/io/imu/movement/data",
    "unit": "",
    "ros_name": true
  },
  "batteryTopic": {
    "default": "/io/power/power_watcher",
    "unit": "",
    "ros_name": true
  },
  "scanTopic": {
    "default": "/scan",
    "unit": "",
    "ros_name": true
  },
  "odomTopic": {
    "default": "/mirte_base_controller/odom",
    "unit": "",
    "ros_name": true
  },
  "jointStatesTopic": {
    "default": "/joint_states",
    "unit": "",
    "ros_name": true
  },
  "rosoutTopic": {
    "default": "/rosout",
    "unit": "",
    "ros_name": true
  },
  "cameraTopic": {
    "default": "/camera/color/image_raw",
    "unit": "",
    "ros_name": true
  },
  "mapTopic": {
    "default": "/map",
    "unit": "",
    "ros_name": true
  },
  "planTopic": {
    "default": "/plan",
    "unit": "",
    "ros_name": true
  },
  "goalPoseTopic": {
    "default": "/goal_pose",
    "unit": "",
    "ros_name": true
  },
  "rosUrl": {
    "default": "",
    "unit": "",
    "schemes": [
      "ws",
      "wss"
    ],
    "max_length": 256,
    "shared": false
  },
  "webVideoServerUrl": {
    "default": "",
    "unit": "",
    "schemes": [
      "http",
      "https"
    ],
    "max_length": 256
  },
  "mapFrame": {
    "default": "map",
    "unit": "",
    "ros_name": true
  },
  "baseFrame": {
    "default": "base_link",
    "unit": "",
    "ros_name": true
  },
  "speedScale": {
    "default": 0.5,
    "unit": "",
    "low": 0.05,
    "high": 1.0
  },
  "armServoNamespace": {
    "default": "/io/servo/hiwonder",
    "unit": "",
    "ros_name": true
  },
  "armRateDegPerSec": {
    "default": 60.0,
    "unit": "deg/s",
    "low": 1.0,
    "high": 180.0
  },
  "geminiModel": {
    "default": "models/gemini-3.1-flash-live-preview",
    "unit": "",
    "max_length": 256,
    "shared": false
  },
  "voiceLanguage": {
    "default": "en-US",
    "unit": "",
    "max_length": 35,
    "shared": false
  },
  "voicePushToTalk": {
    "default": true,
    "unit": "",
    "shared": false
  },
  "voiceVadEnabled": {
    "default": true,
    "unit": "",
    "shared": false
  },
  "voiceVadEndHoldMs": {
    "default": 800,
    "unit": "ms",
    "low": 100,
    "high": 10000,
    "shared": false
  },
  "voiceVadStartThreshold": {
    "default": 0.02,
    "unit": "",
    "low": 0.0,
    "high": 1.0,
    "shared": false
  },
  "voiceVadEndThreshold": {
    "default": 0.012,
    "unit": "",
    "low": 0.0,
    "high": 1.0,
    "shared": false
  },
  "voiceVadMaxUtteranceMs": {
    "default": 15000,
    "unit": "ms",
    "low": 1000,
    "high": 120000,
    "shared": false
  },
  "voiceMaxLinearMps": {
    "default": 0.3,
    "unit": "m/s",
    "low": 0.0,
    "high": 0.6
  },
  "voiceMaxAngularRps": {
    "default": 0.8,
    "unit": "rad/s",
    "low": 0.0,
    "high": 1.9
  },
  "voiceSystemPrompt": {
    "default": "",
    "unit": "",
    "max_length": 20000,
    "shared": false
  },
  "theme": {
    "default": "dark",
    "unit": "",
    "choices": [
      "dark",
      "light"
    ],
    "shared": false
  },
  "surfaceContrast": {
    "default": "normal",
    "unit": "",
    "choices": [
      "normal",
      "high"
    ],
    "shared": false
  },
  "reduceTransparency": {
    "default": false,
    "unit": "",
    "shared": false
  },
  "debugPublish": {
    "default": false,
    "unit": "",
    "shared": false
  },
  "estopAutoOnFocusLoss": {
    "default": true,
    "unit": "",
    "shared": false
  },
  "polarityInvertHmi": {
    "default": false,
    "unit": ""
  }
} as const;
