/** How sensors are called and written. */
import type { TextKey } from "@/i18n/text";
import { fixed } from "@/ui/numbers";
import { type HealthState, type Sensor, idealRange } from "./health";

export const SENSOR_NAMES: Record<Sensor, TextKey> = {
  temperature: "map_temperature",
  humidity: "map_humidity",
  co2: "map_co2",
  light: "map_light",
  soil_moisture: "map_soil_moisture",
};

export const HEALTH_NAMES: Record<HealthState, TextKey> = {
  healthy: "map_healthy",
  off_range: "map_off_range",
  stressed: "map_stressed",
  critical: "map_critical",
  no_data: "map_no_data",
};

/** The unit beside a value that stands without the sensor's name: two sensors have percent. */
export function shortUnit(sensor: Sensor): { key: TextKey } | { raw: string } {
  if (sensor === "humidity") return { key: "map_unit_air" };
  if (sensor === "soil_moisture") return { key: "map_unit_soil" };
  return { raw: idealRange(sensor).unit };
}

export function writeValue(sensor: Sensor, value: number | null | undefined): string {
  return fixed(value, sensor === "co2" || sensor === "light" ? 0 : 1);
}

/** A distance: 2.0 m, 40 cm. */
export function writeLength(meters: number): string {
  return meters < 1 ? `${fixed(meters * 100, 0)} cm` : `${fixed(meters, 1)} m`;
}
