const en = {
  speed: "Speed",
  asked_measured: "asked / measured",
  forward: "Forward",
  left: "Left",
  turn: "Turn",
  speed_limit: "Speed limit",
  nearest_obstacle: "Nearest obstacle",
  lidar_age: "lidar, {age} ago",
  stick_move: "move",
  stick_turn: "turn",
  sticks_live: "Sticks are live",
  sticks_blocked: "Sticks are blocked",
  keys_hint: "Keys: W A S D move, Q E turn",
  gamepad: "Gamepad: {name}",
  front_camera: "Front camera",
  no_picture: "No picture",
};

const nl: Record<keyof typeof en, string> = {
  speed: "Snelheid",
  asked_measured: "gevraagd / gemeten",
  forward: "Vooruit",
  left: "Links",
  turn: "Draaien",
  speed_limit: "Snelheidslimiet",
  nearest_obstacle: "Dichtstbijzijnde obstakel",
  lidar_age: "lidar, {age} geleden",
  stick_move: "rijden",
  stick_turn: "draaien",
  sticks_live: "Sticks werken",
  sticks_blocked: "Sticks geblokkeerd",
  keys_hint: "Toetsen: W A S D rijden, Q E draaien",
  gamepad: "Gamepad: {name}",
  front_camera: "Voorcamera",
  no_picture: "Geen beeld",
};

export const teleop = { en, nl };
