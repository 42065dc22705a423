/** The cameras of the robot, as the video server lists them. */
import { useEffect, useState } from "react";
import { request, unanswered } from "@/api/http";
import { TOPICS } from "@/generated/graph";
import { errorText } from "@/i18n/error_text";
import type { TextKey } from "@/i18n/text";
import { useSetting } from "@/state/settings";

const PERIOD_MS = 3000;

export interface CameraRow {
  topic: string;
  /** What the video server gets from the camera, where somebody watches it. */
  fps: number | null;
  ageS: number | null;
  error: string;
}

export interface CameraList {
  /** null before the first answer. */
  cameras: CameraRow[] | null;
  /** Why there is no newer answer; empty where there is. */
  problem: string;
  answeredMs: number | null;
}

/** The rows of `/_video/streams`; what is malformed is left out. */
export function parseCameras(value: unknown): CameraRow[] {
  if (!Array.isArray(value)) return [];
  return value.flatMap((row: unknown): CameraRow[] => {
    const { topic, fps, age_s, error } = (typeof row === "object" && row !== null ? row : {}) as Record<string, unknown>;
    if (typeof topic !== "string" || topic === "") return [];
    return [{ topic, fps: numberOrNull(fps), ageS: numberOrNull(age_s), error: typeof error === "string" ? error : "" }];
  });
}

function numberOrNull(value: unknown): number | null {
  return typeof value === "number" && Number.isFinite(value) ? value : null;
}

const ORDER: readonly string[] = [TOPICS.BODY_IMAGE_ROBOT.name, TOPICS.BODY_IMAGE_SIM.name, TOPICS.GRIPPER_IMAGE.name];

/** The cameras that may be in a recording, for a page that shows the past while the video server has no list. */
export const RECORDED_CAMERAS: readonly CameraRow[] = [TOPICS.BODY_IMAGE_SIM, TOPICS.BODY_IMAGE_ROBOT, TOPICS.GRIPPER_IMAGE].map(({ name }) => ({
  topic: name,
  fps: null,
  ageS: null,
  error: "",
}));

/** The cameras in their order: the one of the settings, the body's, the gripper's, then the rest by name. */
export function inOrder(cameras: readonly CameraRow[], preferred: string): CameraRow[] {
  const rank = ({ topic }: CameraRow) => (topic === preferred ? -1 : ORDER.includes(topic) ? ORDER.indexOf(topic) : ORDER.length);
  return cameras.toSorted((a, b) => rank(a) - rank(b) || a.topic.localeCompare(b.topic));
}

/** The topic of the front camera: that of the settings where it exists, else the body camera that does. */
export function frontCamera(cameras: readonly CameraRow[] | null, preferred: string): string {
  const bodies: readonly string[] = [preferred, TOPICS.BODY_IMAGE_ROBOT.name, TOPICS.BODY_IMAGE_SIM.name];
  return bodies.find((topic) => cameras?.some((each) => each.topic === topic)) ?? preferred;
}

const NAMES: Record<string, TextKey> = {
  [TOPICS.BODY_IMAGE_ROBOT.name]: "front_camera",
  [TOPICS.BODY_IMAGE_SIM.name]: "front_camera",
  [TOPICS.GRIPPER_IMAGE.name]: "camera_gripper",
  [TOPICS.YOLO_OVERLAY.name]: "camera_flowers",
  [TOPICS.FLOWER_OVERLAY.name]: "camera_flowers",
};

/** The name of a camera in the catalog; null for one that only has a topic. */
export function cameraName(topic: string, front: string): TextKey | null {
  return topic === front ? "front_camera" : (NAMES[topic] ?? null);
}

/** The list of cameras, asked for every 3 s while the page is seen. */
export function useCameras(): CameraList {
  const [list, setList] = useState<CameraList>({ cameras: null, problem: "", answeredMs: null });
  useEffect(() => {
    let isMounted = true;
    const look = async () => {
      if (document.hidden) return;
      try {
        const response = await request("/_video/streams", { signal: AbortSignal.timeout(PERIOD_MS * 3) });
        if (!response.ok) throw new Error((await response.text()).trim().slice(0, 300));
        const cameras = parseCameras(await response.json());
        if (isMounted) setList({ cameras, problem: "", answeredMs: performance.now() });
      } catch (error) {
        // A TypeError is fetch's word for no answer at all, and its text is the browser's.
        const isMute = error instanceof TypeError || error instanceof DOMException;
        const problem = errorText(isMute ? unanswered(error) : error);
        if (isMounted) setList((before) => ({ ...before, problem }));
      }
    };
    void look();
    const timer = setInterval(() => void look(), PERIOD_MS);
    return () => {
      isMounted = false;
      clearInterval(timer);
    };
  }, []);
  return list;
}

/** The topic of the camera that looks ahead; null before the cameras are known. */
export function useFrontCamera(): string | null {
  const preferred = useSetting("cameraTopic");
  const { cameras, problem } = useCameras();
  return cameras === null && problem === "" ? null : frontCamera(cameras, preferred);
}
