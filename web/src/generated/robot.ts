// Generated: `python -m tools.write_page_types`.
export const DRIVE = {
  "maxLinearMps": 0.6,
  "maxAngularRps": 1.9,
  "manualTimeoutS": 0.5
} as const;
export const JOINT_LIMITS = {
  "shoulder_pan_joint": {
    "servoLowerDeg": -86.0,
    "servoUpperDeg": 90.0,
    "lowerDeg": -86.0,
    "upperDeg": 90.0
  },
  "shoulder_lift_joint": {
    "servoLowerDeg": -86.2,
    "servoUpperDeg": 85.5,
    "lowerDeg": -86.0,
    "upperDeg": 85.0
  },
  "elbow_joint": {
    "servoLowerDeg": -116.3,
    "servoUpperDeg": 92.5,
    "lowerDeg": -90.0,
    "upperDeg": 90.0
  },
  "wrist_joint": {
    "servoLowerDeg": -110.7,
    "servoUpperDeg": 88.0,
    "lowerDeg": -90.0,
    "upperDeg": 88.0
  },
  "gripper_joint": {
    "servoLowerDeg": -43.6,
    "servoUpperDeg": 37.0,
    "lowerDeg": -30.0,
    "upperDeg": 30.0
  }
} as const;
export const GRIPPER = {
  "openDeg": -30.0,
  "closedDeg": 30.0,
  "openRad": -0.2,
  "closedRad": 0.25
} as const;
export const ARM_PRESETS = {
  "home": [
    0.04,
    -0.01,
    0.01,
    -1.57
  ],
  "zero": [
    0.0,
    0.0,
    0.0,
    0.0
  ],
  "tuck": [
    0.0,
    -1.4,
    1.4,
    0.0
  ],
  "pick": [
    0.0,
    -0.6,
    0.8,
    -0.4
  ],
  "place": [
    0.0,
    0.2,
    0.8,
    -0.4
  ],
  "inspect": [
    0.0,
    0.6,
    -0.8,
    -1.47
  ]
} as const;
export const PRESET_DURATION_S = 3;
export const LED_COLORS = {
  "red": [
    255,
    0,
    0
  ],
  "amber": [
    255,
    191,
    0
  ],
  "white": [
    255,
    255,
    255
  ],
  "blue": [
    0,
    0,
    255
  ],
  "yellow": [
    255,
    255,
    0
  ],
  "spring": [
    0,
    255,
    128
  ],
  "cyan": [
    0,
    255,
    255
  ],
  "teal": [
    0,
    180,
    140
  ],
  "purple": [
    180,
    0,
    255
  ],
  "orange": [
    255,
    128,
    0
  ],
  "green": [
    0,
    255,
    0
  ],
  "off": [
    0,
    0,
    0
  ]
} as const;
export const LED_STATES = {
  "PREPARE": [
    255,
    255,
    0
  ],
  "EXPLORING": [
    0,
    255,
    128
  ],
  "INSPECTING": [
    0,
    255,
    255
  ],
  "MONITORING": [
    0,
    180,
    140
  ],
  "RETURNING": [
    255,
    128,
    0
  ],
  "BOOT": [
    255,
    255,
    255
  ],
  "READY": [
    0,
    0,
    255
  ],
  "DONE": [
    0,
    255,
    0
  ],
  "SCANNING": [
    180,
    0,
    255
  ],
  "CONFIRMING": [
    180,
    0,
    255
  ],
  "PUBLISHING": [
    255,
    255,
    255
  ]
} as const;
export const IDEAL_RANGES = {
  "temperature": {
    "low": 18.0,
    "high": 26.0,
    "unit": "°C"
  },
  "humidity": {
    "low": 40.0,
    "high": 70.0,
    "unit": "%"
  },
  "co2": {
    "low": 400.0,
    "high": 1000.0,
    "unit": "ppm"
  },
  "light": {
    "low": 200.0,
    "high": 800.0,
    "unit": "lux"
  },
  "soil_moisture": {
    "low": 30.0,
    "high": 60.0,
    "unit": "%"
  }
} as const;
export const HEALTH = {
  "maxDeviation": 2.0,
  "offRange": "off_range",
  "states": [
    {
      "below": 0.3,
      "name": "healthy"
    },
    {
      "below": 0.7,
      "name": "stressed"
    },
    {
      "below": null,
      "name": "critical"
    }
  ]
} as const;
export const BATTERY = {
  "lowShare": 0.2,
  "soonShare": 0.35
} as const;
export const AUTHORITY = {
  "leaseSilenceS": 5.0,
  "requestS": 10.0
} as const;
export type Role = "viewer" | "operator";
