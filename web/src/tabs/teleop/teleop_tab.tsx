import { CircleDot } from "lucide-react";
import { useCallback, useEffect, useState } from "react";
import { TOPICS } from "@/generated/graph";
import { DRIVE } from "@/generated/robot";
import { useAge } from "@/hooks/use_now";
import { useDriveObstacles, useMissionDrives } from "@/hooks/use_situation";
import { useTopic } from "@/hooks/use_topic";
import { useText } from "@/i18n/text";
import { driver, useDrive } from "@/robot/driving";
import { type DriveSource, type Velocity, ZERO, isZero } from "@/safety/drive";
import { showProblem } from "@/state/problems";
import { MirroredStop } from "@/shell/stop_bar";
import { changeSettings, useSetting } from "@/state/settings";
import { ODOMETRY_STALE_MS } from "@/state/wheels";
import { cn } from "@/ui/cn";
import { fixed, signed, formatDuration } from "@/ui/numbers";
import { Panel } from "@/ui/panel";
import { Slider } from "@/ui/slider";
import { CameraView } from "@/widgets/camera_view";
import { useFrontCamera } from "@/widgets/camera/cameras";
import { useFreshness } from "@/widgets/freshness";
import { Joystick } from "@/widgets/joystick";
import { LidarView } from "@/widgets/lidar_view";
import { useDriveKeys, useGamepad } from "./drive_keys";

/** The Teleop tab: two sticks over the front camera, the commanded and the measured velocity, and nearby obstacles. */
export default function TeleopTab() {
  const text = useText();
  const blocked = useDriveObstacles().length > 0;
  const overrides = useMissionDrives();
  const move = useCallback(
    (source: DriveSource, share: Velocity) => {
      const velocity = {
        x: share.x * DRIVE.maxLinearMps,
        y: share.y * DRIVE.maxLinearMps,
        yaw: share.yaw * DRIVE.maxAngularRps,
      };
      if (blocked) driver.refuse(source, velocity);
      else driver.hold(source, velocity);
    },
    [blocked],
  );
  useEffect(() => {
    if (blocked) driver.letGo();
  }, [blocked]);
  const [byKeys, setByKeys] = useState(ZERO);
  const [byGamepad, setByGamepad] = useState(ZERO);
  const moveByKeys = useCallback(
    (share: Velocity) => {
      setByKeys(share);
      move("keyboard", share);
    },
    [move],
  );
  const moveByGamepad = useCallback(
    (share: Velocity) => {
      setByGamepad((before) => (isZero(before) && isZero(share) ? before : share));
      move("gamepad", share);
    },
    [move],
  );
  const shown = isZero(byKeys) ? byGamepad : byKeys;
  useDriveKeys(moveByKeys);
  const gamepad = useGamepad(moveByGamepad);

  return (
    <div className="grid gap-3 lg:h-full lg:min-h-0 lg:grid-cols-[minmax(0,1fr)_20rem] lg:grid-rows-[minmax(0,1fr)] xl:grid-cols-[minmax(0,1fr)_var(--column)]">
      <section aria-label={text("front_camera")} className="panel relative min-h-80 overflow-hidden md:max-lg:h-[52vh]">
        <CameraView topic={useFrontCamera()} label={text("front_camera")} className="absolute inset-0" />
        <p
          className={cn(
            "absolute top-3 right-3 flex items-center gap-2 rounded-sm bg-panel px-3 py-1.5 font-semibold",
            blocked ? "text-text-2" : "text-alive",
          )}
        >
          <CircleDot aria-hidden="true" className="size-4" />
          {text(blocked ? "sticks_blocked" : overrides ? "sticks_override" : "sticks_live")}
        </p>
        <div className="absolute inset-x-[3%] bottom-[4%] flex items-end justify-between gap-4">
          <Joystick
            label={text("stick_move")}
            disabled={blocked}
            shown={{ right: -shown.y, up: shown.x }}
            onMove={(right, up) => move("left-stick", { x: up, y: -right, yaw: 0 })}
            className="w-[min(24vw,15rem)] min-w-36"
          />
          <p className="pb-2 text-center text-xs text-text-2 max-xl:hidden">
            <span className="rounded-sm bg-panel px-2 py-1">
              {gamepad === null ? text("keys_hint") : text("gamepad", { name: gamepad.slice(0, 40) })}
            </span>
          </p>
          <Joystick
            label={text("stick_turn")}
            horizontal
            disabled={blocked}
            shown={{ right: -shown.yaw, up: 0 }}
            onMove={(right) => move("right-stick", { x: 0, y: 0, yaw: -right })}
            className="w-[min(24vw,15rem)] min-w-36"
          />
        </div>
      </section>
      <div className="flex flex-col gap-3 md:max-lg:grid md:max-lg:grid-cols-2 lg:min-h-0">
        <MirroredStop className="md:max-lg:col-span-2" />
        <SpeedPanel />
        <SpeedLimit />
        <NearestObstacle />
      </div>
    </div>
  );
}

function SpeedPanel() {
  const text = useText();
  const asked = useDrive((state) => state.commanded);
  const name = useSetting("odomTopic");
  const odometry = useTopic({ name, type: TOPICS.ODOM.type }, { throttleMs: 50 });
  const { isStale, panel } = useFreshness(name, odometry?.receivedMs, ODOMETRY_STALE_MS / 1000);
  const measured = odometry?.message.twist.twist;
  const rows = [
    { label: text("forward"), asked: asked.x, measured: measured?.linear.x, unit: "m/s" },
    { label: text("left"), asked: asked.y, measured: measured?.linear.y, unit: "m/s" },
    { label: text("turn"), asked: asked.yaw, measured: measured?.angular.z, unit: "rad/s" },
  ];
  return (
    <Panel title={text("speed")} aside={text("asked_measured")} {...panel}>
      <dl>
        {rows.map((row) => (
          <div key={row.label} className="flex items-baseline gap-2 border-line py-1.5 not-last:border-b">
            <dt className="grow text-text-2">{row.label}</dt>
            <dd className="text-lg font-semibold whitespace-nowrap numeric">
              <span className="text-alive">{signed(row.asked, 2)}</span>
              <span className="text-text-3"> / </span>
              <span className={isStale ? "text-text-3" : "text-sensed"}>{signed(row.measured, 2)}</span>
              <span className="ml-1.5 inline-block w-10 text-xs text-text-3">{row.unit}</span>
            </dd>
          </div>
        ))}
      </dl>
    </Panel>
  );
}

function SpeedLimit() {
  const text = useText();
  const stored = useSetting("speedScale");
  const [shown, setShown] = useState<number | null>(null);
  const scale = shown ?? stored;
  const limits = `${fixed(scale * DRIVE.maxLinearMps, 2)} m/s, ${fixed(scale * DRIVE.maxAngularRps, 2)} rad/s`;
  return (
    <Panel title={text("speed_limit")} aside={<span className="numeric">{limits}</span>}>
      <div className="flex items-center gap-4">
        <p className="text-xl font-bold whitespace-nowrap">
          <span className="numeric">{fixed(scale * 100, 0)}</span> <span className="text-sm font-normal text-text-3">%</span>
        </p>
        <Slider
          label={text("speed_limit")}
          value={Math.round(scale * 100)}
          min={5}
          max={100}
          step={5}
          valueText={limits}
          onChange={(percent) => setShown(percent / 100)}
          onCommit={(percent) => {
            changeSettings({ speedScale: percent / 100 })
              .catch(showProblem)
              .finally(() => setShown(null));
          }}
        />
      </div>
    </Panel>
  );
}

function NearestObstacle() {
  const text = useText();
  const topic = useSetting("scanTopic");
  const [scan, setScan] = useState<{ nearestM: number | null; receivedMs: number } | null>(null);
  const age = useAge(scan?.receivedMs);
  const stale = age !== null && age > 1;
  const close = scan?.nearestM !== null && scan !== null && scan.nearestM < 0.3;
  return (
    <Panel
      title={text("nearest_obstacle")}
      aside={age !== null && text("lidar_age", { age: formatDuration(age) })}
      {...(stale ? { tone: "stale" as const, notice: text("stale_since", { topic, age: formatDuration(age) }) } : {})}
      {...(scan === null ? { tone: "empty" as const, notice: text("no_sample_yet", { topic }) } : {})}
      className="grow md:max-lg:col-span-2"
      bodyClassName="flex flex-col"
    >
      <p className={cn("text-xl font-bold", close && !stale && "text-attention", stale && "text-text-3")}>
        <span className="numeric">{fixed(scan?.nearestM, 2)}</span> <span className="text-sm font-normal text-text-3">m</span>
      </p>
      <div className="min-h-48 grow">
        <LidarView label={text("nearest_obstacle")} onScan={setScan} />
      </div>
    </Panel>
  );
}
