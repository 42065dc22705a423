import { Flower2, ScanLine } from "lucide-react";
import { useMemo } from "react";
import { TOPICS } from "@/generated/graph";
import { useAge } from "@/hooks/use_now";
import { useTopic } from "@/hooks/use_topic";
import { useText } from "@/i18n/text";
import { speciesColor } from "@/map/species";
import { fixed, formatDuration } from "@/ui/numbers";
import { Panel } from "@/ui/panel";
import { className, parseFlowers, parseTags } from "@/widgets/camera/detections";

/** What was detected longer ago is not "now". */
const NOW_S = 2;
const MAX_ROWS = 8;

/** Every tag and flower in the images of this moment. */
export function SeenPanel({ place }: { place?: string }) {
  const text = useText();
  const tagSample = useTopic(TOPICS.TAG_DETECTIONS, { throttleMs: 200 });
  const flowerSample = useTopic(TOPICS.FLOWER_DETECTIONS, { throttleMs: 200 });
  const tagAge = useAge(tagSample?.receivedMs);
  const flowerAge = useAge(flowerSample?.receivedMs);
  const tags = useMemo(() => parseTags(tagSample?.message.data ?? ""), [tagSample]);
  const flowers = useMemo(() => parseFlowers(flowerSample?.message.data ?? ""), [flowerSample]);
  const shownTags = tagAge !== null && tagAge < NOW_S ? tags : [];
  const shownFlowers = flowerAge !== null && flowerAge < NOW_S ? flowers : [];
  const age = tagAge === null ? flowerAge : flowerAge === null ? tagAge : Math.min(tagAge, flowerAge);
  const rows = [
    ...shownTags.map((tag) => ({
      key: `tag ${tag.id}`,
      what: text("cameras_tag", { id: tag.id }),
      icon: <ScanLine aria-hidden="true" className="size-4 text-sensed" />,
      camera: text("cameras_front"),
      certainty: text("cameras_decoded"),
      distance: `${fixed(tag.distanceM, 2)} m`,
    })),
    ...shownFlowers.map((flower, index) => {
      const name = className(flower.name);
      return {
        key: `flower ${index}`,
        what: name === null ? flower.name || text("cameras_unknown_class") : text(name),
        icon: <Flower2 aria-hidden="true" className="size-4" style={{ color: speciesColor(flower.name) }} />,
        camera: text("cameras_gripper"),
        certainty: flower.certainty === null ? fixed(null, 0) : `${fixed(flower.certainty * 100, 0)} %`,
        distance: fixed(null, 0),
      };
    }),
  ];
  const state =
    age === null
      ? { tone: "empty" as const, notice: text("no_sample_yet", { topic: TOPICS.TAG_DETECTIONS.name }) }
      : age > NOW_S
        ? { tone: "stale" as const, notice: text("stale_since", { topic: TOPICS.TAG_DETECTIONS.name, age: formatDuration(age) }) }
        : {};
  return (
    <Panel title={text("cameras_seen")} aside={age !== null && <span className="numeric">{formatDuration(age)}</span>} {...state} {...(place === undefined ? {} : { className: place })} bodyClassName="overflow-y-auto">
      {rows.length === 0 ? (
        <p className="py-2 text-text-3">{text("cameras_seen_nothing")}</p>
      ) : (
        <table className="w-full">
          <thead className="text-left text-xs text-text-3">
            <tr>
              <th className="py-1 font-normal">{text("cameras_what")}</th>
              <th className="py-1 font-normal">{text("cameras_camera")}</th>
              <th className="py-1 font-normal">{text("cameras_certainty")}</th>
              <th className="py-1 text-right font-normal">{text("cameras_distance")}</th>
            </tr>
          </thead>
          <tbody>
            {rows.slice(0, MAX_ROWS).map((row) => (
              <tr key={row.key} className="border-t border-line">
                <td className="max-w-40 truncate py-2 font-semibold text-text">
                  <span className="inline-flex items-center gap-2">
                    {row.icon}
                    {row.what}
                  </span>
                </td>
                <td className="py-2 text-text-2">{row.camera}</td>
                <td className="py-2 text-text-2 numeric">{row.certainty}</td>
                <td className="py-2 text-right numeric">{row.distance}</td>
              </tr>
            ))}
          </tbody>
        </table>
      )}
      {rows.length > MAX_ROWS && <p className="py-1 text-xs text-text-3">{text("cameras_more", { count: rows.length - MAX_ROWS })}</p>}
    </Panel>
  );
}
