// Generated: `python -m tools.write_page_types`.
export interface Shape {
  kind: 'box' | 'cylinder';
  name: string;
  size: number[];
  at: number[];
  turned: number[];
  color: number[];
}
export interface Body {
  name: string;
  parent: string;
  joint: string;
  at: number[];
  turned: number[];
  axis: number[];
  slides: boolean;
  shapes: Shape[];
}
export const BODIES: readonly Body[] = [
 {
  "name": "base_link",
  "parent": "",
  "at": [
   0.0,
   0.0,
   0.0
  ],
  "turned": [
   0.0,
   0.0,
   0.0,
   1.0
  ],
  "joint": "",
  "axis": [],
  "slides": false,
  "shapes": [
   {
    "kind": "box",
    "size": [
     0.14,
     0.095,
     0.03
    ],
    "at": [
     0.0,
     0.0,
     0.07
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.26,
     0.29,
     0.33,
     1.0
    ],
    "name": "chassis"
   },
   {
    "kind": "box",
    "size": [
     0.08,
     0.09,
     0.025
    ],
    "at": [
     -0.05,
     0.0,
     0.145
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.33,
     0.38,
     0.44,
     1.0
    ],
    "name": "deck"
   },
   {
    "kind": "box",
    "size": [
     0.03,
     0.045,
     0.025
    ],
    "at": [
     0.0793,
     0.0,
     0.125
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.26,
     0.29,
     0.33,
     1.0
    ],
    "name": "arm_stand"
   },
   {
    "kind": "box",
    "size": [
     0.012,
     0.0825,
     0.0175
    ],
    "at": [
     0.1334,
     -0.0025,
     0.1442
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.33,
     0.38,
     0.44,
     1.0
    ],
    "name": "camera_bar"
   },
   {
    "kind": "box",
    "size": [
     0.0065,
     0.017,
     0.0125
    ],
    "at": [
     0.0,
     -0.0622,
     0.1125
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.26,
     0.29,
     0.33,
     1.0
    ],
    "name": "pillar0"
   },
   {
    "kind": "box",
    "size": [
     0.0065,
     0.017,
     0.0125
    ],
    "at": [
     0.0,
     0.0648,
     0.1125
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.26,
     0.29,
     0.33,
     1.0
    ],
    "name": "pillar1"
   },
   {
    "kind": "cylinder",
    "size": [
     0.0278,
     0.012,
     0.0
    ],
    "at": [
     0.0005,
     0.0,
     0.108
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.3,
     0.3,
     0.36,
     1.0
    ],
    "name": "lidar_puck"
   },
   {
    "kind": "cylinder",
    "size": [
     0.008,
     0.002,
     0.0
    ],
    "at": [
     0.145,
     0.01,
     0.1427
    ],
    "turned": [
     0.0,
     0.70711,
     0.0,
     0.70711
    ],
    "color": [
     0.2,
     0.22,
     0.4,
     1.0
    ],
    "name": "lens"
   },
   {
    "kind": "cylinder",
    "size": [
     0.051,
     0.0275,
     0.0
    ],
    "at": [
     0.085,
     0.128,
     0.0525
    ],
    "turned": [
     0.70711,
     0.0,
     0.0,
     0.70711
    ],
    "color": [
     0.22,
     0.23,
     0.26,
     1.0
    ],
    "name": "front_left_wheel"
   },
   {
    "kind": "cylinder",
    "size": [
     0.03,
     0.0295,
     0.0
    ],
    "at": [
     0.085,
     0.128,
     0.0525
    ],
    "turned": [
     0.70711,
     0.0,
     0.0,
     0.70711
    ],
    "color": [
     0.8,
     0.55,
     0.1,
     1.0
    ],
    "name": "front_left_wheel_hub"
   },
   {
    "kind": "cylinder",
    "size": [
     0.051,
     0.0275,
     0.0
    ],
    "at": [
     -0.085,
     0.128,
     0.0525
    ],
    "turned": [
     0.70711,
     0.0,
     0.0,
     0.70711
    ],
    "color": [
     0.22,
     0.23,
     0.26,
     1.0
    ],
    "name": "rear_left_wheel"
   },
   {
    "kind": "cylinder",
    "size": [
     0.03,
     0.0295,
     0.0
    ],
    "at": [
     -0.085,
     0.128,
     0.0525
    ],
    "turned": [
     0.70711,
     0.0,
     0.0,
     0.70711
    ],
    "color": [
     0.8,
     0.55,
     0.1,
     1.0
    ],
    "name": "rear_left_wheel_hub"
   },
   {
    "kind": "cylinder",
    "size": [
     0.051,
     0.0275,
     0.0
    ],
    "at": [
     -0.085,
     -0.123,
     0.0525
    ],
    "turned": [
     0.70711,
     0.0,
     0.0,
     0.70711
    ],
    "color": [
     0.22,
     0.23,
     0.26,
     1.0
    ],
    "name": "rear_right_wheel"
   },
   {
    "kind": "cylinder",
    "size": [
     0.03,
     0.0295,
     0.0
    ],
    "at": [
     -0.085,
     -0.123,
     0.0525
    ],
    "turned": [
     0.70711,
     0.0,
     0.0,
     0.70711
    ],
    "color": [
     0.8,
     0.55,
     0.1,
     1.0
    ],
    "name": "rear_right_wheel_hub"
   },
   {
    "kind": "cylinder",
    "size": [
     0.051,
     0.0275,
     0.0
    ],
    "at": [
     0.085,
     -0.123,
     0.0525
    ],
    "turned": [
     0.70711,
     0.0,
     0.0,
     0.70711
    ],
    "color": [
     0.22,
     0.23,
     0.26,
     1.0
    ],
    "name": "front_right_wheel"
   },
   {
    "kind": "cylinder",
    "size": [
     0.03,
     0.0295,
     0.0
    ],
    "at": [
     0.085,
     -0.123,
     0.0525
    ],
    "turned": [
     0.70711,
     0.0,
     0.0,
     0.70711
    ],
    "color": [
     0.8,
     0.55,
     0.1,
     1.0
    ],
    "name": "front_right_wheel_hub"
   },
   {
    "kind": "box",
    "size": [
     0.014,
     0.006,
     0.004
    ],
    "at": [
     0.015,
     0.084,
     0.174
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.1,
     0.1,
     0.12,
     1.0
    ],
    "name": "led0"
   },
   {
    "kind": "box",
    "size": [
     0.014,
     0.006,
     0.004
    ],
    "at": [
     -0.025,
     0.084,
     0.174
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.1,
     0.1,
     0.12,
     1.0
    ],
    "name": "led1"
   },
   {
    "kind": "box",
    "size": [
     0.014,
     0.006,
     0.004
    ],
    "at": [
     -0.065,
     0.084,
     0.174
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.1,
     0.1,
     0.12,
     1.0
    ],
    "name": "led2"
   },
   {
    "kind": "box",
    "size": [
     0.014,
     0.006,
     0.004
    ],
    "at": [
     -0.105,
     0.084,
     0.174
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.1,
     0.1,
     0.12,
     1.0
    ],
    "name": "led3"
   },
   {
    "kind": "box",
    "size": [
     0.006,
     0.012,
     0.004
    ],
    "at": [
     -0.124,
     0.054,
     0.174
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.1,
     0.1,
     0.12,
     1.0
    ],
    "name": "led4"
   },
   {
    "kind": "box",
    "size": [
     0.006,
     0.012,
     0.004
    ],
    "at": [
     -0.124,
     0.018,
     0.174
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.1,
     0.1,
     0.12,
     1.0
    ],
    "name": "led5"
   },
   {
    "kind": "box",
    "size": [
     0.006,
     0.012,
     0.004
    ],
    "at": [
     -0.124,
     -0.018,
     0.174
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.1,
     0.1,
     0.12,
     1.0
    ],
    "name": "led6"
   },
   {
    "kind": "box",
    "size": [
     0.006,
     0.012,
     0.004
    ],
    "at": [
     -0.124,
     -0.054,
     0.174
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.1,
     0.1,
     0.12,
     1.0
    ],
    "name": "led7"
   },
   {
    "kind": "box",
    "size": [
     0.014,
     0.006,
     0.004
    ],
    "at": [
     -0.105,
     -0.084,
     0.174
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.1,
     0.1,
     0.12,
     1.0
    ],
    "name": "led8"
   },
   {
    "kind": "box",
    "size": [
     0.014,
     0.006,
     0.004
    ],
    "at": [
     -0.065,
     -0.084,
     0.174
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.1,
     0.1,
     0.12,
     1.0
    ],
    "name": "led9"
   },
   {
    "kind": "box",
    "size": [
     0.014,
     0.006,
     0.004
    ],
    "at": [
     -0.025,
     -0.084,
     0.174
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.1,
     0.1,
     0.12,
     1.0
    ],
    "name": "led10"
   },
   {
    "kind": "box",
    "size": [
     0.014,
     0.006,
     0.004
    ],
    "at": [
     0.015,
     -0.084,
     0.174
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.1,
     0.1,
     0.12,
     1.0
    ],
    "name": "led11"
   }
  ]
 },
 {
  "name": "shoulder_pan",
  "parent": "base_link",
  "at": [
   0.0793,
   0.0,
   0.16
  ],
  "turned": [
   0.0,
   0.0,
   0.0,
   1.0
  ],
  "joint": "shoulder_pan_joint",
  "axis": [
   0.0,
   0.0,
   1.0
  ],
  "slides": false,
  "shapes": [
   {
    "kind": "cylinder",
    "size": [
     0.032,
     0.012,
     0.0
    ],
    "at": [
     0.0,
     0.0,
     0.0
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.24,
     0.27,
     0.32,
     1.0
    ],
    "name": ""
   }
  ]
 },
 {
  "name": "shoulder_lift",
  "parent": "shoulder_pan",
  "at": [
   0.00625,
   0.0,
   0.0281
  ],
  "turned": [
   0.0,
   0.0,
   0.0,
   1.0
  ],
  "joint": "shoulder_lift_joint",
  "axis": [
   0.0,
   -1.0,
   0.0
  ],
  "slides": false,
  "shapes": [
   {
    "kind": "box",
    "size": [
     0.01,
     0.004,
     0.0629
    ],
    "at": [
     0.0,
     -0.024,
     0.0689
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.86,
     0.6,
     0.1,
     1.0
    ],
    "name": ""
   },
   {
    "kind": "box",
    "size": [
     0.01,
     0.004,
     0.0629
    ],
    "at": [
     0.0,
     0.024,
     0.0689
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.86,
     0.6,
     0.1,
     1.0
    ],
    "name": ""
   },
   {
    "kind": "box",
    "size": [
     0.012,
     0.018,
     0.022
    ],
    "at": [
     0.0,
     0.0,
     0.1118
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.24,
     0.27,
     0.32,
     1.0
    ],
    "name": ""
   },
   {
    "kind": "cylinder",
    "size": [
     0.016,
     0.03,
     0.0
    ],
    "at": [
     0.0,
     0.0,
     0.0
    ],
    "turned": [
     0.70711,
     0.0,
     0.0,
     0.70711
    ],
    "color": [
     0.24,
     0.27,
     0.32,
     1.0
    ],
    "name": ""
   }
  ]
 },
 {
  "name": "elbow",
  "parent": "shoulder_lift",
  "at": [
   0.0,
   0.0,
   0.1378
  ],
  "turned": [
   0.0,
   0.0,
   0.0,
   1.0
  ],
  "joint": "elbow_joint",
  "axis": [
   0.0,
   -1.0,
   0.0
  ],
  "slides": false,
  "shapes": [
   {
    "kind": "box",
    "size": [
     0.01,
     0.004,
     0.06532
    ],
    "at": [
     0.0,
     -0.024,
     0.07132
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.86,
     0.6,
     0.1,
     1.0
    ],
    "name": ""
   },
   {
    "kind": "box",
    "size": [
     0.01,
     0.004,
     0.06532
    ],
    "at": [
     0.0,
     0.024,
     0.07132
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.86,
     0.6,
     0.1,
     1.0
    ],
    "name": ""
   },
   {
    "kind": "box",
    "size": [
     0.012,
     0.018,
     0.022
    ],
    "at": [
     0.0,
     0.0,
     0.11665
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.24,
     0.27,
     0.32,
     1.0
    ],
    "name": ""
   },
   {
    "kind": "cylinder",
    "size": [
     0.016,
     0.03,
     0.0
    ],
    "at": [
     0.0,
     0.0,
     0.0
    ],
    "turned": [
     0.70711,
     0.0,
     0.0,
     0.70711
    ],
    "color": [
     0.24,
     0.27,
     0.32,
     1.0
    ],
    "name": ""
   }
  ]
 },
 {
  "name": "wrist",
  "parent": "elbow",
  "at": [
   0.0,
   0.0,
   0.14265
  ],
  "turned": [
   0.0,
   0.0,
   0.0,
   1.0
  ],
  "joint": "wrist_joint",
  "axis": [
   0.0,
   -1.0,
   0.0
  ],
  "slides": false,
  "shapes": [
   {
    "kind": "cylinder",
    "size": [
     0.014,
     0.029,
     0.0
    ],
    "at": [
     0.0,
     0.0,
     0.0
    ],
    "turned": [
     0.70711,
     0.0,
     0.0,
     0.70711
    ],
    "color": [
     0.24,
     0.27,
     0.32,
     1.0
    ],
    "name": ""
   },
   {
    "kind": "box",
    "size": [
     0.014,
     0.0275,
     0.024
    ],
    "at": [
     0.0,
     0.0,
     0.034
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.86,
     0.6,
     0.1,
     1.0
    ],
    "name": ""
   },
   {
    "kind": "box",
    "size": [
     0.01,
     0.016,
     0.009
    ],
    "at": [
     -0.067,
     0.0,
     0.015
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.24,
     0.27,
     0.32,
     1.0
    ],
    "name": ""
   },
   {
    "kind": "box",
    "size": [
     0.026,
     0.006,
     0.004
    ],
    "at": [
     -0.038,
     0.0,
     0.016
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.33,
     0.38,
     0.44,
     1.0
    ],
    "name": ""
   }
  ]
 },
 {
  "name": "finger_left",
  "parent": "wrist",
  "at": [
   0.0,
   0.0,
   0.075
  ],
  "turned": [
   0.0,
   0.0,
   0.0,
   1.0
  ],
  "joint": "finger_left",
  "axis": [
   0.0,
   1.0,
   0.0
  ],
  "slides": true,
  "shapes": [
   {
    "kind": "box",
    "size": [
     0.008,
     0.004,
     0.03
    ],
    "at": [
     0.0,
     0.004,
     0.03
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.3,
     0.42,
     0.55,
     1.0
    ],
    "name": "finger_left"
   }
  ]
 },
 {
  "name": "finger_right",
  "parent": "wrist",
  "at": [
   0.0,
   0.0,
   0.075
  ],
  "turned": [
   0.0,
   0.0,
   0.0,
   1.0
  ],
  "joint": "finger_right",
  "axis": [
   0.0,
   -1.0,
   0.0
  ],
  "slides": true,
  "shapes": [
   {
    "kind": "box",
    "size": [
     0.008,
     0.004,
     0.03
    ],
    "at": [
     0.0,
     -0.004,
     0.03
    ],
    "turned": [
     0.0,
     0.0,
     0.0,
     1.0
    ],
    "color": [
     0.3,
     0.42,
     0.55,
     1.0
    ],
    "name": "finger_right"
   }
  ]
 }
];
export const OUTER_RADIUS_M = 0.22;
export const WHEEL = {
  "radiusM": 0.051,
  "widthM": 0.055
} as const;
export const LIDAR = {
  "at": [
    0.0005,
    0.0,
    0.1072
  ],
  "yawRad": 1.5707963267948966
} as const;
export const GRIPPER_APERTURE_M = [0.0656, 0.0008] as const;
