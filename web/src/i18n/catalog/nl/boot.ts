import type { boot as english } from "../en/boot";

export const boot: Record<keyof typeof english, string> = {
  boot_title: "Verbindt met de robot",
  boot_link: "Verbinding",
  boot_handshake: "Handdruk",
  boot_telemetry: "Telemetrie",
  boot_live: "Live",
  boot_link_waiting: "nog geen verbinding",
  boot_link_done: "open",
  boot_handshake_waiting: "de server heeft nog niet geantwoord",
  boot_handshake_done: "antwoordde in {ms} ms",
  boot_telemetry_waiting: "nog geen {what}",
  boot_telemetry_done: "{what} komen aan",
  boot_live_waiting: "zodra elke sensor gegevens stuurt",
  boot_live_missing: "nog geen {what}",
  boot_live_done: "elke sensor stuurt gegevens",
  boot_odometry: "odometrie",
  boot_lidar: "lidar",
  boot_battery: "accu",
  boot_joints: "gewrichten",
  boot_estop: "noodstop",
  boot_skip: "De console toch openen",
};
