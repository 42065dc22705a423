import { useAge } from "@/hooks/use_now";
import { type TextKey, useText } from "@/i18n/text";
import { idealRange } from "@/map/health";
import { type Field, heatCss, share } from "@/map/heat";
import { liveMap } from "@/map/live_map";
import { useMapUi } from "@/map/map_ui";
import { SENSOR_NAMES, writeValue } from "@/map/sensor_text";
import { FIELD_PERIOD_MS, useFieldState } from "@/map/use_field";
import { formatDuration } from "@/ui/numbers";

/** The range of the shown field with its unit, and where it is ideal. */
export function HeatLegend() {
  const text = useText();
  const layer = useMapUi((state) => state.layer);
  const { receivedMs, problem } = useFieldState();
  const age = useAge(receivedMs);
  if (layer === null) return null;
  const field = liveMap.field?.sensor === layer ? liveMap.field : null;
  const isStale = age !== null && age > (2.5 * FIELD_PERIOD_MS) / 1000;
  return (
    <div className="w-56 rounded-md border border-line bg-panel/95 p-3 text-xs text-text-2 max-md:w-44 max-md:p-2">
      <div className="mb-2 flex items-baseline justify-between gap-2">
        <span className="text-sm font-semibold text-text">{text(SENSOR_NAMES[layer])}</span>
        {field !== null && <span>{text("map_heat_samples", { count: field.samples })}</span>}
      </div>
      {problem !== "" ? (
        <p className="text-attention">{text("map_heat_failed", { reason: problem.slice(0, 120) })}</p>
      ) : field === null ? (
        <p>{text("map_heat_asking")}</p>
      ) : field.range === null ? (
        <p>{text("map_heat_none")}</p>
      ) : (
        <Range field={field} range={field.range} />
      )}
      {isStale && <p className="mt-1 text-attention">{text("map_heat_age", { age: formatDuration(age) })}</p>}
    </div>
  );
}

/** Explains the visible ticks; a bound outside of the field's range has no tick. */
function idealText(range: { low: number; high: number }, ideal: { low: number; high: number }): TextKey {
  const [hasLow, hasHigh] = [ideal.low, ideal.high].map((bound) => bound > range.low && bound < range.high);
  if (hasLow && hasHigh) return "map_heat_ideal_between";
  if (hasLow) return "map_heat_ideal_above";
  if (hasHigh) return "map_heat_ideal_below";
  return range.low >= ideal.low && range.high <= ideal.high ? "map_heat_ideal_all" : "map_heat_ideal_none";
}

function Range({ field, range }: { field: Field; range: { low: number; high: number } }) {
  const text = useText();
  const ideal = idealRange(field.sensor);
  const ticks = [ideal.low, ideal.high].filter((value) => value > range.low && value < range.high);
  const stops = [0, 0.25, 0.5, 0.75, 1].map((at) => heatCss(field.sensor, at)).join(", ");
  return (
    <>
      <div className="relative h-3 rounded-sm border border-line" style={{ background: `linear-gradient(90deg, ${stops}), #17211b` }}>
        {ticks.map((value) => (
          <span key={value} aria-hidden="true" className="absolute -inset-y-0.5 w-0.5 bg-text" style={{ left: `${share(value, range) * 100}%` }} />
        ))}
      </div>
      <div className="mt-1 flex justify-between text-sm text-text numeric">
        <span>{writeValue(field.sensor, range.low)}</span>
        <span>
          {writeValue(field.sensor, range.high)} {ideal.unit}
        </span>
      </div>
      <p className="mt-1 max-md:hidden">
        {text(idealText(range, ideal), { low: ideal.low, high: ideal.high, unit: ideal.unit })} {text("map_heat_unmeasured")}
      </p>
    </>
  );
}
