import type { teleop as english } from "../en/teleop";

export const teleop: Record<keyof typeof english, string> = {
  speed: "Snelheid",
  asked_measured: "opdracht / gemeten",
  forward: "Vooruit",
  left: "Links",
  turn: "Draaien",
  speed_limit: "Snelheidslimiet",
  nearest_obstacle: "Dichtstbijzijnde obstakel",
  lidar_age: "lidar, {age} geleden",
  stick_move: "rijden",
  stick_turn: "draaien",
  sticks_live: "Sticks werken",
  sticks_override: "Sticks werken: ze gaan boven de missie",
  sticks_blocked: "Sticks geblokkeerd",
  keys_hint: "Toetsen: W A S D rijden, Q E draaien",
  gamepad: "Gamepad: {name}",
  front_camera: "Voorcamera",
  no_image: "Geen beeld",
};
