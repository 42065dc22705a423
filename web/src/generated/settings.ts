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
    "unit": ""
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
    "unit": ""
  },
  "batteryTopic": {
    "default": "/io/power/power_watcher",
    "unit": ""
  },
  "scanTopic": {
    "default": "/scan",
    "unit": ""
  },
  "odomTopic": {
    "default": "/mirte_base_controller/odom",
    "unit": ""
  },
  "jointStatesTopic": {
    "default": "/joint_states",
    "unit": ""
  },
  "rosoutTopic": {
    "default": "/rosout",
    "unit": ""
  },
  "cameraTopic": {
    "default": "/camera/color/image_raw",
    "unit": ""
  },
  "mapTopic": {
    "default": "/map",
    "unit": ""
  },
  "planTopic": {
    "default": "/plan",
    "unit": ""
  },
  "goalPoseTopic": {
    "default": "/goal_pose",
    "unit": ""
  },
  "mapFrame": {
    "default": "map",
    "unit": ""
  },
  "baseFrame": {
    "default": "base_link",
    "unit": ""
  },
  "speedScale": {
    "default": 0.5,
    "unit": "",
    "low": 0.05,
    "high": 1.0
  },
  "armServoNamespace": {
    "default": "/io/servo/hiwonder",
    "unit": ""
  },
  "armRateDegPerSec": {
    "default": 60.0,
    "unit": "deg/s",
    "low": 1.0,
    "high": 180.0
  },
  "geminiModel": {
    "default": "models/gemini-3.1-flash-live-preview",
    "unit": ""
  },
  "voiceLanguage": {
    "default": "en-US",
    "unit": ""
  },
  "voicePushToTalk": {
    "default": true,
    "unit": ""
  },
  "voiceVadEnabled": {
    "default": true,
    "unit": ""
  },
  "voiceVadEndHoldMs": {
    "default": 800,
    "unit": "ms",
    "low": 100,
    "high": 10000
  },
  "voiceVadStartThreshold": {
    "default": 0.02,
    "unit": "",
    "low": 0.0,
    "high": 1.0
  },
  "voiceVadEndThreshold": {
    "default": 0.012,
    "unit": "",
    "low": 0.0,
    "high": 1.0
  },
  "voiceVadMaxUtteranceMs": {
    "default": 15000,
    "unit": "ms",
    "low": 1000,
    "high": 120000
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
    "unit": ""
  },
  "theme": {
    "default": "dark",
    "unit": "",
    "choices": [
      "dark",
      "light"
    ]
  },
  "surfaceContrast": {
    "default": "normal",
    "unit": "",
    "choices": [
      "normal",
      "high"
    ]
  },
  "reduceTransparency": {
    "default": false,
    "unit": ""
  },
  "debugPublish": {
    "default": false,
    "unit": ""
  },
  "estopAutoOnFocusLoss": {
    "default": true,
    "unit": ""
  },
  "polarityInvertHmi": {
    "default": false,
    "unit": ""
  }
} as const;
