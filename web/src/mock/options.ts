/** The parameters of the mock mode in the page's address, beside `?mock=1`. */

/** `live`: a mission loop from its start; the others: one fixed situation, for screenshots and tests. */
export const MOCK_STATES = ["live", "calm", "mission", "stopped", "lost", "stale", "boot"] as const;
export type MockState = (typeof MOCK_STATES)[number];

/** Who has control at the start: nobody, this browser, another one, or this one while another asks for it. */
export const MOCK_CONTROLS = ["free", "you", "phone", "asked"] as const;
export type MockControl = (typeof MOCK_CONTROLS)[number];

/**
 * Faults for tests: `nan` and `empty` samples, `none` at all, 10 000 `logs` a second, a `growing` map, `stalled` cameras,
 * `nocamera`, a clock `skew` of the robot, its `button` pressed, the stop of another browser's voice `agent`, an e-stop that is
 * `deaf` to the console, or `astray`: soon after the start, the localization loses the robot.
 */
export const MOCK_FAULTS = ["nan", "empty", "none", "logs", "growing", "stalled", "nocamera", "skew", "button", "agent", "deaf", "astray"] as const;
export type MockFault = (typeof MOCK_FAULTS)[number];

/**
 * What the scripted voice agent does: read the `state`, ask to `confirm` a drive, be `refused`, call in a `loop`, run out of its
 * `quota`, go `away` to another connection, or be `offline`.
 */
export const MOCK_VOICES = ["state", "confirm", "refused", "loop", "quota", "away", "offline"] as const;
export type MockVoice = (typeof MOCK_VOICES)[number];

export interface MockOptions {
  state: MockState;
  control: MockControl;
  role: "operator" | "viewer";
  faults: ReadonlySet<MockFault>;
  voice: MockVoice;
  /** The robot's time in s at which everything stands still; null: time runs. */
  clockS: number | null;
}

export function readOptions(query: URLSearchParams): MockOptions {
  const state = MOCK_STATES.find((each) => each === query.get("state")) ?? "live";
  const role = query.get("role") === "viewer" ? "viewer" : "operator";
  const wanted = MOCK_CONTROLS.find((each) => each === query.get("control")) ?? (state === "live" ? "free" : "you");
  // A viewer cannot have control.
  const control = role === "viewer" && (wanted === "you" || wanted === "asked") ? "free" : wanted;
  const asked = (query.get("fault") ?? "").split(",");
  const clock = query.get("clock");
  const clockS = clock === null || clock === "" ? NaN : Number(clock);
  return {
    state,
    control,
    role,
    faults: new Set(MOCK_FAULTS.filter((each) => asked.includes(each))),
    voice: MOCK_VOICES.find((each) => each === query.get("voice")) ?? "state",
    clockS: Number.isFinite(clockS) && clockS >= 0 ? clockS : null,
  };
}
