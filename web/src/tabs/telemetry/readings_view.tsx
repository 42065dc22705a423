import { useState } from "react";
import { useText } from "@/i18n/text";
import { useSetting } from "@/state/settings";
import { Panel } from "@/ui/panel";
import { useFreshness } from "@/widgets/freshness";
import { LidarView } from "@/widgets/lidar_view";
import { TimeSeries } from "@/widgets/time_series";
import { BatteryPanel } from "./battery_panel";
import { JointsPanel } from "./joints_panel";
import { ImuPanel, OdometryPanel } from "./motion_panels";
import { BatteryTile, HeadingTile, LinkTile, NearestTile, SpeedTile, TurnTile } from "./tiles";

const LIDAR_RANGE_M = 4.5;

export function ReadingsView() {
  const text = useText();
  const topic = useSetting("scanTopic");
  const [scan, setScan] = useState<{ nearestM: number | null; receivedMs: number } | null>(null);
  const [nearest] = useState(() => new TimeSeries(60, 800));
  const { panel } = useFreshness(topic, scan?.receivedMs);

  function takeScan(taken: { nearestM: number | null; receivedMs: number }): void {
    setScan(taken);
    nearest.push(taken.receivedMs / 1000, taken.nearestM ?? NaN);
  }

  return (
    <div className="grid grow grid-cols-2 gap-3 md:grid-cols-6 xl:min-h-0 xl:grid-rows-[auto_minmax(0,1fr)_minmax(0,1fr)]">
      <div className="contents max-xl:*:col-span-1 max-xl:md:*:col-span-2">
        <SpeedTile />
        <TurnTile />
        <NearestTile scan={scan} series={nearest} />
        <BatteryTile />
        <HeadingTile />
        <LinkTile />
      </div>
      <ImuPanel className="col-span-2 max-xl:md:col-span-3" />
      <OdometryPanel className="col-span-2 max-xl:md:col-span-3" />
      <Panel title={text("telemetry_lidar")} aside={text("telemetry_lidar_range", { range: 4 })} {...panel} className="col-span-2 min-h-80 max-xl:md:col-span-6 xl:row-span-2" bodyClassName="flex">
        <LidarView label={text("telemetry_lidar_alt")} rangeM={LIDAR_RANGE_M} onScan={takeScan} />
      </Panel>
      <BatteryPanel className="col-span-2 max-xl:md:col-span-3" />
      <JointsPanel className="col-span-2 max-xl:md:col-span-3" />
    </div>
  );
}
