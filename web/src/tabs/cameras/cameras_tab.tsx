import { Download, Maximize2, Minimize2, RotateCw } from "lucide-react";
import { useRef, useState } from "react";
import { TOPICS } from "@/generated/graph";
import { useAge } from "@/hooks/use_now";
import { useTopic } from "@/hooks/use_topic";
import { type Text, useText } from "@/i18n/text";
import { RewindButton } from "@/rewind/rewind_bar";
import { useIsRewound } from "@/state/rewind";
import { DoctorButton } from "@/widgets/doctor_button";
import { useSetting } from "@/state/settings";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { formatDuration } from "@/ui/numbers";
import { Panel } from "@/ui/panel";
import { Segments } from "@/ui/segments";
import { CameraView } from "@/widgets/camera_view";
import type { OverlayKind } from "@/widgets/camera/overlay";
import { type CameraList, RECORDED_CAMERAS, cameraName, frontCamera, inOrder, useCameras } from "@/widgets/camera/cameras";
import { SeenPanel } from "./seen_panel";
import { useMaximized } from "./use_maximized";

const OVERLAY_KEY = "lupin-tag-overlay";

/** 04: one camera large and one small, with the tags over the image in which they were found. */
export default function CamerasTab() {
  const text = useText();
  const list = useCameras();
  const preferred = useSetting("cameraTopic");
  const [chosen, setChosen] = useState<string | null>(null);
  const isRewound = useIsRewound();
  const rows = list.cameras === null || list.cameras.length === 0 ? (isRewound ? RECORDED_CAMERAS : []) : list.cameras;
  const cameras = rows === RECORDED_CAMERAS ? rows : inOrder(rows, preferred);
  const front = rows === RECORDED_CAMERAS ? (RECORDED_CAMERAS[0]?.topic ?? preferred) : frontCamera(rows, preferred);
  const main = cameras.find(({ topic }) => topic === chosen)?.topic ?? cameras[0]?.topic;
  const others = cameras.filter(({ topic }) => topic !== main).map(({ topic }) => topic);
  const [second, ...rest] = others;
  const name = (topic: string) => nameOf(topic, front, text);

  if (main === undefined) return <NoCameras list={list} />;
  return (
    <div className="grid gap-3 lg:h-full lg:grid-cols-[minmax(0,1fr)_var(--column)] lg:grid-rows-[minmax(0,1fr)]">
      <MainView topic={main} name={name(main)} overlay={overlayOf(main, front)} />
      <div className="flex min-w-0 flex-col gap-3 lg:min-h-0">
        {second !== undefined && (
          <div className="panel relative aspect-[4/3] w-full shrink-0 overflow-hidden lg:max-h-[38%]">
            <CameraView topic={second} label={name(second)} numbers="short" overlay={overlayOf(second, front)} className="absolute inset-0" />
            <NameTag>{name(second)}</NameTag>
            <button
              type="button"
              aria-label={text("cameras_swap", { camera: name(second) })}
              onClick={() => setChosen(second)}
              className="absolute inset-0 z-10 cursor-pointer rounded-lg hover:bg-text/5"
            />
          </div>
        )}
        {rest.length > 0 && (
          <Panel title={text("cameras_others")} className="shrink-0">
            <div className="flex flex-wrap gap-2 pt-1">
              {rest.map((topic) => (
                <Button key={topic} size="small" className="max-w-full" onClick={() => setChosen(topic)}>
                  <span className="truncate">{name(topic)}</span>
                </Button>
              ))}
            </div>
          </Panel>
        )}
        <SeenPanel place="min-h-40 grow" />
        {list.problem !== "" && <p role="status" className="panel px-4 py-2 text-xs text-attention">{text("cameras_list_problem", { reason: list.problem })}</p>}
      </div>
    </div>
  );
}

function MainView({ topic, name, overlay }: { topic: string; name: string; overlay: OverlayKind | null }) {
  const text = useText();
  const [showsMarks, setShowsMarks] = useState(readOverlay);
  const [reloads, setReloads] = useState(0);
  const [isMaximized, setMaximized] = useMaximized();
  const frame = useRef<HTMLDivElement>(null);
  return (
    <section
      aria-label={text("cameras_main")}
      className={cn(
        "flex min-w-0 flex-col gap-3 lg:min-h-0",
        isMaximized &&
          "fixed inset-0 right-(--stop) z-30 bg-void p-3 max-md:right-0 max-md:bottom-[calc(var(--stop)+var(--tabs))] max-md:p-1",
      )}
    >
      <div ref={frame} className={cn("panel relative min-h-64 grow overflow-hidden", !isMaximized && "max-lg:aspect-[4/3] max-lg:grow-0")}>
        <CameraView key={`${topic} ${reloads}`} topic={topic} label={name} fit="contain" numbers="all" overlay={showsMarks ? overlay : null} className="absolute inset-0" />
        <NameTag>{name}</NameTag>
      </div>
      <div className="flex flex-wrap items-center gap-3">
        <Segments
          label={text("cameras_overlay")}
          value={showsMarks ? "marks" : "plain"}
          options={[
            { value: "marks", label: text("cameras_overlay") },
            { value: "plain", label: text("cameras_plain") },
          ]}
          onChange={(value) => {
            setShowsMarks(value === "marks");
            writeOverlay(value === "marks");
          }}
        />
        {overlay !== null && <OverlaySource kind={overlay} />}
        <div className="ml-auto flex flex-wrap gap-2">
          <RewindButton />
          <Button size="icon" aria-label={text("camera_reload")} title={text("camera_reload")} onClick={() => setReloads(reloads + 1)}>
            <RotateCw />
          </Button>
          <Button size="icon" aria-label={text("cameras_save")} title={text("cameras_save")} onClick={() => saveImage(frame.current, topic)}>
            <Download />
          </Button>
          <Button onClick={() => setMaximized(!isMaximized)} aria-pressed={isMaximized}>
            {isMaximized ? <Minimize2 /> : <Maximize2 />}
            {text(isMaximized ? "cameras_minimize" : "cameras_maximize")}
          </Button>
        </div>
      </div>
    </section>
  );
}

function OverlaySource({ kind }: { kind: OverlayKind }) {
  const text = useText();
  const row = kind === "tags" ? TOPICS.TAG_DETECTIONS : TOPICS.FLOWER_DETECTIONS;
  const sample = useTopic(row, { throttleMs: 200 });
  const age = useAge(sample?.receivedMs);
  return (
    <p className="min-w-0 truncate rounded-sm bg-panel px-2 py-1 text-xs text-text-2 max-lg:hidden">
      {age === null ? text("cameras_overlay_none", { topic: row.name }) : text("cameras_overlay_source", { topic: row.name, age: formatDuration(age) })}
    </p>
  );
}

/** What the detectors find with a camera. */
function overlayOf(topic: string, front: string): OverlayKind | null {
  return topic === front ? "tags" : topic === TOPICS.GRIPPER_IMAGE.name ? "flowers" : null;
}

function NameTag({ children }: { children: string }) {
  return <span className="absolute top-3 left-3 max-w-[55%] truncate rounded-sm bg-panel/90 px-2.5 py-1 text-sm font-semibold">{children}</span>;
}

function NoCameras({ list }: { list: CameraList }) {
  const text = useText();
  const age = useAge(list.answeredMs);
  const isKnown = list.cameras !== null;
  return (
    <div className="panel grid h-full min-h-80 place-items-center p-6">
      <div role="status" className="flex max-w-md flex-col items-center gap-3 text-center">
        <p className="text-base font-semibold">
          {isKnown ? text("cameras_none") : list.problem === "" ? text("cameras_asking") : text("cameras_list_problem", { reason: list.problem })}
        </p>
        {isKnown && <p className="text-text-2">{text("cameras_none_hint")}</p>}
        {(isKnown || list.problem !== "") && <DoctorButton />}
        {age !== null && <p aria-hidden="true" className="text-xs text-text-3">{text("cameras_listed", { age: formatDuration(age) })}</p>}
      </div>
    </div>
  );
}

function nameOf(topic: string, front: string, text: Text): string {
  const key = cameraName(topic, front);
  return key === null ? topic : text(key);
}

/** Save what is seen, with the topic and time in the file's name. */
function saveImage(frame: HTMLElement | null, topic: string): void {
  frame?.querySelector("canvas")?.toBlob((blob) => {
    if (blob === null) return;
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = `${topic.replaceAll("/", "_").replace(/^_/, "")}-${new Date().toISOString().replaceAll(":", "-").slice(0, 19)}.jpg`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }, "image/jpeg");
}

function readOverlay(): boolean {
  try {
    return sessionStorage.getItem(OVERLAY_KEY) !== "off";
  } catch {
    return true;
  }
}

function writeOverlay(shown: boolean): void {
  try {
    sessionStorage.setItem(OVERLAY_KEY, shown ? "on" : "off");
  } catch {
    // Storage is forbidden: the choice holds until the page is closed.
  }
}
