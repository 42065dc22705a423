import { Crosshair, Hand, LocateFixed, Maximize, Minus, Navigation, Plus } from "lucide-react";
import type { ComponentType } from "react";
import { useText } from "@/i18n/text";
import { SENSORS, type Sensor } from "@/map/health";
import { chooseTool, type Tool, useMapUi } from "@/map/map_ui";
import { SENSOR_NAMES } from "@/map/sensor_text";
import { hasWebGl } from "@/widgets/webgl";
import { useIsRewound } from "@/state/rewind";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { Segments } from "@/ui/segments";

export function ModeChoice() {
  const text = useText();
  const mode = useMapUi((state) => state.mode);
  if (!hasWebGl()) {
    return <p className="pointer-events-auto flex h-11 items-center rounded-md border border-line bg-panel px-3 text-text-2">{text("map_no_webgl")}</p>;
  }
  return (
    <Segments
      label={text("map_dimensions")}
      value={mode}
      options={[
        { value: "2d", label: text("map_2d") },
        { value: "3d", label: text("map_3d") },
      ]}
      onChange={(next) => useMapUi.setState({ mode: next, isFollowing: false })}
      className="pointer-events-auto"
    />
  );
}

/** The plain map, or the field of a sensor: side by side where there is room. */
export function LayerChoice() {
  const text = useText();
  const layer = useMapUi((state) => state.layer);
  const choose = (value: string) => useMapUi.setState({ layer: value === "plain" ? null : (value as Sensor) });
  const options = [{ value: "plain", label: text("map_plain") }, ...SENSORS.map((sensor) => ({ value: sensor as string, label: text(SENSOR_NAMES[sensor]) }))];
  return (
    <>
      <Segments label={text("map_layer")} value={layer ?? "plain"} options={options} onChange={choose} className="pointer-events-auto max-xl:hidden" />
      <select
        aria-label={text("map_layer")}
        value={layer ?? "plain"}
        onChange={(event) => choose(event.target.value)}
        className="pointer-events-auto h-12 rounded-md border border-line bg-panel px-3 text-sm font-semibold xl:hidden"
      >
        {options.map(({ value, label }) => (
          <option key={value} value={value}>
            {label}
          </option>
        ))}
      </select>
    </>
  );
}

const TOOLS: readonly { tool: Tool; icon: ComponentType; label: "map_tool_move" | "map_tool_goal" | "map_tool_relocate" }[] = [
  { tool: "move", icon: Hand, label: "map_tool_move" },
  { tool: "goal", icon: Navigation, label: "map_tool_goal" },
  { tool: "relocate", icon: Crosshair, label: "map_tool_relocate" },
];

export function MapTools({ className }: { className?: string }) {
  const text = useText();
  const isRewound = useIsRewound();
  const { tool, isFollowing, controls } = useMapUi();
  return (
    <div className={cn("pointer-events-auto flex flex-col gap-2", className)}>
      <Group>
        {TOOLS.map(({ tool: each, icon: Icon, label }) => (
          <IconButton key={each} label={text(label)} isOn={tool === each} disabled={isRewound && each !== "move"} onClick={() => chooseTool(each)}>
            <Icon />
          </IconButton>
        ))}
      </Group>
      <Group>
        <IconButton label={text("map_zoom_in")} onClick={() => controls?.zoom(1.25)} className="max-md:hidden">
          <Plus />
        </IconButton>
        <IconButton label={text("map_zoom_out")} onClick={() => controls?.zoom(0.8)} className="max-md:hidden">
          <Minus />
        </IconButton>
        <IconButton label={text("map_fit")} onClick={() => controls?.fit()}>
          <Maximize />
        </IconButton>
        <IconButton label={text("map_follow")} isOn={isFollowing} onClick={() => useMapUi.setState({ isFollowing: !isFollowing })}>
          <LocateFixed />
        </IconButton>
      </Group>
    </div>
  );
}

function Group({ children }: { children: React.ReactNode }) {
  return <div className="flex flex-col overflow-hidden rounded-md border border-line bg-panel max-md:flex-row">{children}</div>;
}

interface IconButtonProps {
  label: string;
  isOn?: boolean;
  disabled?: boolean;
  onClick: () => void;
  className?: string;
  children: React.ReactNode;
}

function IconButton({ label, isOn, disabled = false, onClick, className, children }: IconButtonProps) {
  return (
    <Button
      kind="quiet"
      size="icon"
      aria-label={label}
      title={label}
      {...(isOn === undefined ? {} : { "aria-pressed": isOn })}
      disabled={disabled}
      onClick={onClick}
      className={cn("rounded-none", isOn === true && "bg-alive-wash text-alive hover:text-alive", className)}
    >
      {children}
    </Button>
  );
}
