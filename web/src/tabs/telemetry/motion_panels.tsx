import { TOPICS } from "@/generated/graph";
import { useTopic } from "@/hooks/use_topic";
import { useText } from "@/i18n/text";
import { useSetting } from "@/state/settings";
import { fixed } from "@/ui/numbers";
import { Panel } from "@/ui/panel";
import { useFreshness } from "@/widgets/freshness";
import { orientation } from "./orientation";
import { FAST } from "./tiles";

interface Row {
  title: string;
  unit: string;
  /** Decimal places of each value; two where none are given. */
  places: readonly number[];
  values: readonly (number | null | undefined)[];
}

/** Rows of up to three numbers in fixed places. */
function NumberTable({ heads, rows }: { heads?: readonly string[]; rows: readonly Row[] }) {
  const text = useText();
  return (
    <table className="h-full w-full table-fixed text-right">
      {heads !== undefined && (
        <thead className="text-xs text-text-3">
          <tr>
            <th scope="col" className="w-[34%]">
              <span className="sr-only">{text("telemetry_quantity")}</span>
            </th>
            {heads.map((head) => (
              <th key={head} scope="col" className="font-normal">
                {head}
              </th>
            ))}
          </tr>
        </thead>
      )}
      <tbody>
        {rows.map(({ title, unit, places, values }) => (
          <tr key={title} className="border-t border-line">
            <th scope="row" className="w-[34%] py-1 text-left text-sm leading-tight font-normal text-text-2">
              {title}
              <span className="block text-xs text-text-3">{unit}</span>
            </th>
            {values.map((value, index) => (
              <td key={index} className="py-1 text-lg leading-tight font-semibold tabular-nums slashed-zero">
                {fixed(value, places[index] ?? 2)}
              </td>
            ))}
          </tr>
        ))}
      </tbody>
    </table>
  );
}

/** The inertial sensor as it is: nothing is smoothed. */
export function ImuPanel({ className }: { className?: string }) {
  const text = useText();
  const name = useSetting("imuTopic");
  const sample = useTopic({ name, type: TOPICS.IMU.type }, FAST);
  const { panel } = useFreshness(name, sample?.receivedMs);
  const message = sample?.message;
  const turn = message?.angular_velocity;
  const force = message?.linear_acceleration;
  const angles = message === undefined ? null : orientation(message.orientation);
  return (
    <Panel title={text("telemetry_imu")} aside={text("telemetry_raw_values")} {...panel} {...(className === undefined ? {} : { className })}>
      <NumberTable
        heads={["x", "y", "z"]}
        rows={[
          { title: text("telemetry_turn"), unit: "rad/s", places: [], values: [turn?.x, turn?.y, turn?.z] },
          { title: text("telemetry_acceleration"), unit: "m/s²", places: [], values: [force?.x, force?.y, force?.z] },
          { title: text("telemetry_orientation"), unit: text("telemetry_orientation_unit"), places: [1, 1, 1], values: [angles?.rollDeg, angles?.pitchDeg, angles?.yawDeg] },
        ]}
      />
    </Panel>
  );
}

export function OdometryPanel({ className }: { className?: string }) {
  const text = useText();
  const name = useSetting("odomTopic");
  const sample = useTopic({ name, type: TOPICS.ODOM.type }, FAST);
  const { panel } = useFreshness(name, sample?.receivedMs);
  const message = sample?.message;
  const pose = message?.pose.pose;
  const twist = message?.twist.twist;
  return (
    <Panel title={text("telemetry_odometry")} aside={message === undefined ? null : text("telemetry_frame", { frame: message.header.frame_id || "–" })} {...panel} {...(className === undefined ? {} : { className })}>
      <NumberTable
        heads={["x", "y", text("telemetry_yaw")]}
        rows={[
          { title: text("telemetry_pose"), unit: "m, °", places: [2, 2, 1], values: [pose?.position.x, pose?.position.y, pose === undefined ? null : orientation(pose.orientation)?.yawDeg] },
          { title: text("telemetry_velocity"), unit: "m/s, rad/s", places: [], values: [twist?.linear.x, twist?.linear.y, twist?.angular.z] },
        ]}
      />
    </Panel>
  );
}
