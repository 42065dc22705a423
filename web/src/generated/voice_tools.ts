// Generated: `python -m tools.write_page_types`.
export const VOICE_TOOLS = {
  "drive": {
    "effect": "motion",
    "gate": "estop",
    "needsPose": false,
    "isReadBack": false,
    "results": [
      "action",
      "linear_x",
      "linear_y",
      "angular_z",
      "duration_s"
    ]
  },
  "stop": {
    "effect": "stop",
    "gate": "none",
    "needsPose": false,
    "isReadBack": false,
    "results": [
      "action"
    ]
  },
  "nav_goto": {
    "effect": "motion",
    "gate": "estop",
    "needsPose": false,
    "isReadBack": true,
    "results": [
      "action",
      "x",
      "y",
      "yaw"
    ]
  },
  "nav_forward": {
    "effect": "motion",
    "gate": "estop",
    "needsPose": true,
    "isReadBack": true,
    "results": [
      "action",
      "from",
      "goal",
      "forward_m",
      "lateral_m",
      "rotate_deg"
    ]
  },
  "rotate": {
    "effect": "motion",
    "gate": "estop",
    "needsPose": true,
    "isReadBack": true,
    "results": [
      "action",
      "from_yaw",
      "to_yaw",
      "delta_deg"
    ]
  },
  "set_speed_cap": {
    "effect": "session",
    "gate": "none",
    "needsPose": false,
    "isReadBack": false,
    "results": [
      "value",
      "max_linear_mps",
      "max_angular_rps"
    ]
  },
  "nav_cancel": {
    "effect": "stop",
    "gate": "none",
    "needsPose": false,
    "isReadBack": false,
    "results": [
      "action",
      "response"
    ]
  },
  "nav_goto_named": {
    "effect": "motion",
    "gate": "estop",
    "needsPose": false,
    "isReadBack": true,
    "results": [
      "action",
      "name",
      "x",
      "y",
      "yaw"
    ]
  },
  "list_named_locations": {
    "effect": "read",
    "gate": "none",
    "needsPose": false,
    "isReadBack": false,
    "results": [
      "locations"
    ]
  },
  "save_named_location": {
    "effect": "change",
    "gate": "none",
    "needsPose": true,
    "isReadBack": false,
    "results": [
      "name",
      "x",
      "y",
      "yaw"
    ]
  },
  "gripper": {
    "effect": "motion",
    "gate": "estop",
    "needsPose": false,
    "isReadBack": true,
    "results": [
      "direction",
      "percent",
      "angle_deg",
      "note"
    ]
  },
  "arm_preset": {
    "effect": "motion",
    "gate": "estop",
    "needsPose": false,
    "isReadBack": true,
    "results": [
      "name",
      "message"
    ]
  },
  "arm_goto_pose": {
    "effect": "motion",
    "gate": "estop",
    "needsPose": false,
    "isReadBack": true,
    "results": [
      "name",
      "message"
    ]
  },
  "arm_save_pose": {
    "effect": "change",
    "gate": "none",
    "needsPose": false,
    "isReadBack": false,
    "results": [
      "name",
      "message"
    ]
  },
  "arm_list_library": {
    "effect": "read",
    "gate": "none",
    "needsPose": false,
    "isReadBack": false,
    "results": [
      "poses",
      "sequences"
    ]
  },
  "arm_run_sequence": {
    "effect": "motion",
    "gate": "estop",
    "needsPose": false,
    "isReadBack": true,
    "results": [
      "name",
      "speed",
      "message"
    ]
  },
  "arm_stop": {
    "effect": "stop",
    "gate": "none",
    "needsPose": false,
    "isReadBack": false,
    "results": [
      "message"
    ]
  },
  "arm_record": {
    "effect": "motion",
    "gate": "estop_on_start",
    "needsPose": false,
    "isReadBack": true,
    "results": [
      "message",
      "duration_s",
      "n_waypoints"
    ]
  },
  "calibrate_arm": {
    "effect": "motion",
    "gate": "estop_on_start",
    "needsPose": false,
    "isReadBack": true,
    "results": [
      "state",
      "message",
      "joint_names",
      "offsets_applied",
      "diffs_observed"
    ]
  },
  "query_state": {
    "effect": "read",
    "gate": "none",
    "needsPose": false,
    "isReadBack": false,
    "results": [
      "pose",
      "battery",
      "estop"
    ]
  },
  "engage_estop": {
    "effect": "stop",
    "gate": "none",
    "needsPose": false,
    "isReadBack": false,
    "results": [
      "action",
      "reason"
    ]
  },
  "speak": {
    "effect": "session",
    "gate": "none",
    "needsPose": false,
    "isReadBack": false,
    "results": []
  },
  "set_light": {
    "effect": "change",
    "gate": "none",
    "needsPose": false,
    "isReadBack": false,
    "results": [
      "action",
      "color",
      "rgb",
      "message"
    ]
  }
} as const;
export type VoiceToolName = keyof typeof VOICE_TOOLS;
export interface VoiceToolArguments {
  drive: { linear_x?: number; linear_y?: number; angular_z?: number; duration_s: number };
  stop: object;
  nav_goto: { x: number; y: number; yaw?: number; confirmation?: string };
  nav_forward: { forward_m?: number; lateral_m?: number; rotate_deg?: number; confirmation?: string };
  rotate: { angle_deg: number; confirmation?: string };
  set_speed_cap: { value: number };
  nav_cancel: object;
  nav_goto_named: { name: string; confirmation?: string };
  list_named_locations: object;
  save_named_location: { name: string };
  gripper: { action: "open" | "close" | "set"; percent?: number; confirmation?: string };
  arm_preset: { name: "home" | "zero" | "tuck" | "pick" | "place" | "inspect"; confirmation?: string };
  arm_goto_pose: { name: string; confirmation?: string };
  arm_save_pose: { name: string };
  arm_list_library: object;
  arm_run_sequence: { name: string; speed?: number; confirmation?: string };
  arm_stop: object;
  arm_record: { action: "start" | "save" | "cancel"; mode?: "teleop" | "kinesthetic"; name?: string; confirmation?: string };
  calibrate_arm: { action: "start" | "commit" | "cancel" | "status"; confirmation?: string };
  query_state: { fields?: ("pose" | "battery" | "estop")[] };
  engage_estop: object;
  speak: { text: string };
  set_light: { color?: "red" | "amber" | "white" | "blue" | "yellow" | "spring" | "cyan" | "teal" | "purple" | "orange" | "green" | "off"; mode?: "auto" };
}
export const FUNCTION_DECLARATIONS = [
  {
    "name": "drive",
    "description": "Drive a short burst of velocity, which ends by itself after at most 2 s. For a distance or a place use nav_forward, rotate or nav_goto: bursts do not avoid obstacles and reach at most 0.6 m.",
    "parameters": {
      "type": "object",
      "properties": {
        "linear_x": {
          "type": "number",
          "description": "forward velocity, from -voiceMaxLinearMps to voiceMaxLinearMps m/s, times the speed cap"
        },
        "linear_y": {
          "type": "number",
          "description": "velocity to the left, from -voiceMaxLinearMps to voiceMaxLinearMps m/s, times the speed cap"
        },
        "angular_z": {
          "type": "number",
          "description": "turn rate, counter-clockwise, from -voiceMaxAngularRps to voiceMaxAngularRps rad/s, times the speed cap"
        },
        "duration_s": {
          "type": "number",
          "description": "how long to drive in s",
          "minimum": 0.1,
          "maximum": 2.0
        }
      },
      "required": [
        "duration_s"
      ]
    }
  },
  {
    "name": "stop",
    "description": "Stop the wheels at once and end a drive burst. Always allowed. It does not cancel navigation: nav_cancel does."
  },
  {
    "name": "nav_goto",
    "description": "Navigate to a pose on the map, around obstacles.",
    "parameters": {
      "type": "object",
      "properties": {
        "x": {
          "type": "number",
          "description": "x on the map in m",
          "minimum": -1000.0,
          "maximum": 1000.0
        },
        "y": {
          "type": "number",
          "description": "y on the map in m",
          "minimum": -1000.0,
          "maximum": 1000.0
        },
        "yaw": {
          "type": "number",
          "description": "heading on the map, counter-clockwise in rad",
          "minimum": -3.1416,
          "maximum": 3.1416
        },
        "confirmation": {
          "type": "string",
          "description": "the token of the read-back that the operator has confirmed; absent in the first call"
        }
      },
      "required": [
        "x",
        "y"
      ]
    }
  },
  {
    "name": "nav_forward",
    "description": "Navigate by an offset from where the robot is now: forward, to the left, and turned.",
    "parameters": {
      "type": "object",
      "properties": {
        "forward_m": {
          "type": "number",
          "description": "distance forward; negative is backward in m",
          "minimum": -50.0,
          "maximum": 50.0
        },
        "lateral_m": {
          "type": "number",
          "description": "distance to the left; negative is to the right in m",
          "minimum": -50.0,
          "maximum": 50.0
        },
        "rotate_deg": {
          "type": "number",
          "description": "turn at the goal, counter-clockwise in degrees",
          "minimum": -3600.0,
          "maximum": 3600.0
        },
        "confirmation": {
          "type": "string",
          "description": "the token of the read-back that the operator has confirmed; absent in the first call"
        }
      },
      "required": []
    }
  },
  {
    "name": "rotate",
    "description": "Turn in place by an angle.",
    "parameters": {
      "type": "object",
      "properties": {
        "angle_deg": {
          "type": "number",
          "description": "angle, counter-clockwise in degrees",
          "minimum": -3600.0,
          "maximum": 3600.0
        },
        "confirmation": {
          "type": "string",
          "description": "the token of the read-back that the operator has confirmed; absent in the first call"
        }
      },
      "required": [
        "angle_deg"
      ]
    }
  },
  {
    "name": "set_speed_cap",
    "description": "Limit the speed of drive bursts in this session to a share of the maximum.",
    "parameters": {
      "type": "object",
      "properties": {
        "value": {
          "type": "number",
          "description": "share of the maximum: 0 is standstill, 1 the maximum",
          "minimum": 0.0,
          "maximum": 1.0
        }
      },
      "required": [
        "value"
      ]
    }
  },
  {
    "name": "nav_cancel",
    "description": "Cancel navigation. Always allowed. It does not end a drive burst: stop does."
  },
  {
    "name": "nav_goto_named",
    "description": "Navigate to a named location.",
    "parameters": {
      "type": "object",
      "properties": {
        "name": {
          "type": "string",
          "description": "the name of the location"
        },
        "confirmation": {
          "type": "string",
          "description": "the token of the read-back that the operator has confirmed; absent in the first call"
        }
      },
      "required": [
        "name"
      ]
    }
  },
  {
    "name": "list_named_locations",
    "description": "List the named locations on the map."
  },
  {
    "name": "save_named_location",
    "description": "Save where the robot is now under a name; a location of that name is replaced.",
    "parameters": {
      "type": "object",
      "properties": {
        "name": {
          "type": "string",
          "description": "the name of the location"
        }
      },
      "required": [
        "name"
      ]
    }
  },
  {
    "name": "gripper",
    "description": "Open or close the gripper, or set its opening.",
    "parameters": {
      "type": "object",
      "properties": {
        "action": {
          "type": "string",
          "description": "what to do",
          "enum": [
            "open",
            "close",
            "set"
          ]
        },
        "percent": {
          "type": "number",
          "description": "opening, for set: 0 is closed, 100 open in %",
          "minimum": 0.0,
          "maximum": 100.0
        },
        "confirmation": {
          "type": "string",
          "description": "the token of the read-back that the operator has confirmed; absent in the first call"
        }
      },
      "required": [
        "action"
      ]
    }
  },
  {
    "name": "arm_preset",
    "description": "Move the arm to a built-in pose.",
    "parameters": {
      "type": "object",
      "properties": {
        "name": {
          "type": "string",
          "description": "the built-in pose",
          "enum": [
            "home",
            "zero",
            "tuck",
            "pick",
            "place",
            "inspect"
          ]
        },
        "confirmation": {
          "type": "string",
          "description": "the token of the read-back that the operator has confirmed; absent in the first call"
        }
      },
      "required": [
        "name"
      ]
    }
  },
  {
    "name": "arm_goto_pose",
    "description": "Move the arm to a stored pose; a built-in one works too.",
    "parameters": {
      "type": "object",
      "properties": {
        "name": {
          "type": "string",
          "description": "the name of the pose"
        },
        "confirmation": {
          "type": "string",
          "description": "the token of the read-back that the operator has confirmed; absent in the first call"
        }
      },
      "required": [
        "name"
      ]
    }
  },
  {
    "name": "arm_save_pose",
    "description": "Store the arm's present pose under a name; a pose of that name is replaced.",
    "parameters": {
      "type": "object",
      "properties": {
        "name": {
          "type": "string",
          "description": "the name of the pose"
        }
      },
      "required": [
        "name"
      ]
    }
  },
  {
    "name": "arm_list_library",
    "description": "List the arm's stored poses and sequences."
  },
  {
    "name": "arm_run_sequence",
    "description": "Replay a stored sequence of the arm.",
    "parameters": {
      "type": "object",
      "properties": {
        "name": {
          "type": "string",
          "description": "the name of the sequence"
        },
        "speed": {
          "type": "number",
          "description": "factor of the recorded speed",
          "minimum": 0.25,
          "maximum": 2.0
        },
        "confirmation": {
          "type": "string",
          "description": "the token of the read-back that the operator has confirmed; absent in the first call"
        }
      },
      "required": [
        "name"
      ]
    }
  },
  {
    "name": "arm_stop",
    "description": "Stop a replay, a recording or a motion of the arm. Always allowed."
  },
  {
    "name": "arm_record",
    "description": "Record a motion of the arm as a sequence: start, then save or cancel in a later turn. Kinesthetic makes the arm limp, to be led by hand: a person must hold it before the start.",
    "parameters": {
      "type": "object",
      "properties": {
        "action": {
          "type": "string",
          "description": "what to do",
          "enum": [
            "start",
            "save",
            "cancel"
          ]
        },
        "mode": {
          "type": "string",
          "description": "how the arm is led",
          "enum": [
            "teleop",
            "kinesthetic"
          ]
        },
        "name": {
          "type": "string",
          "description": "the name of the sequence"
        },
        "confirmation": {
          "type": "string",
          "description": "the token of the read-back that the operator has confirmed; absent in the first call"
        }
      },
      "required": [
        "action"
      ]
    }
  },
  {
    "name": "calibrate_arm",
    "description": "Calibrate the zero offsets of the arm. Start makes the arm limp: the operator poses it with every joint at zero. Commit writes the offsets. Never commit before the operator has said, after the start, that the arm is posed.",
    "parameters": {
      "type": "object",
      "properties": {
        "action": {
          "type": "string",
          "description": "what to do",
          "enum": [
            "start",
            "commit",
            "cancel",
            "status"
          ]
        },
        "confirmation": {
          "type": "string",
          "description": "the token of the read-back that the operator has confirmed; absent in the first call"
        }
      },
      "required": [
        "action"
      ]
    }
  },
  {
    "name": "query_state",
    "description": "Read the robot's pose by odometry, its battery and its e-stop. Moves nothing.",
    "parameters": {
      "type": "object",
      "properties": {
        "fields": {
          "type": "array",
          "description": "what to read",
          "items": {
            "type": "string",
            "enum": [
              "pose",
              "battery",
              "estop"
            ]
          }
        }
      },
      "required": []
    }
  },
  {
    "name": "engage_estop",
    "description": "Engage the e-stop. Always allowed. No tool can release it: only a person does, at the page."
  },
  {
    "name": "speak",
    "description": "Write a text to the transcript.",
    "parameters": {
      "type": "object",
      "properties": {
        "text": {
          "type": "string",
          "description": "the text"
        }
      },
      "required": [
        "text"
      ]
    }
  },
  {
    "name": "set_light",
    "description": "Set the LED strip to a color, or let it show the robot's state again.",
    "parameters": {
      "type": "object",
      "properties": {
        "color": {
          "type": "string",
          "description": "the color",
          "enum": [
            "red",
            "amber",
            "white",
            "blue",
            "yellow",
            "spring",
            "cyan",
            "teal",
            "purple",
            "orange",
            "green",
            "off"
          ]
        },
        "mode": {
          "type": "string",
          "description": "auto: show the robot's state",
          "enum": [
            "auto"
          ]
        }
      },
      "required": []
    }
  }
] as const;
