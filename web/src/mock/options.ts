/** What the page's address asks of the mock mode, beside `?mock=1`. */

/** `live`: a mission loop from the start; the others: one situation, for pictures and tests. */
export const MOCK_STATES = ["live", "calm", "mission", "stopped", "lost", "stale", "boot"] as const;
export type MockState = (typeof MOCK_STATES)[number];

/** Who has control at the start: nobody, this browser, another one, or this one while another asks for it. */
export const MOCK_CONTROLS = ["free", "you", "phone", "asked"] as const;
export type MockControl = (typeof MOCK_CONTROLS)[number];

/**
 * Faults for tests: `nan` and `empty` samples, `none` at all, 10 000 `logs` a second, a `growing` map, `stalled` cameras,
 * `nocamera`, a clock `skew` of the robot, its `button` pressed.
 */
export const MOCK_FAULTS = ["nan", "empty", "none", "logs", "growing", "stalled", "nocamera", "skew", "button"] as const;
export type MockFault = (typeof MOCK_FAULTS)[number];

export interface MockOptions {
  state: MockState;
  control: MockControl;
  role: "operator" | "viewer";
  faults: ReadonlySet<MockFault>;
  /** The robot's time in s at which everything stands still; null: time runs. */
  clockS: number | null;
}

export function readOptions(query: URLSearchParams): MockOptions {
  const state = MOCK_STATES.find((each) => each === query.get("state")) ?? "live";
  const control = MOCK_CONTROLS.find((each) => each === query.get("control")) ?? (state === "live" ? "free" : "you");
  const asked = (query.get("fault") ?? "").split(",");
  const clock = query.get("clock");
  const clockS = clock === null || clock === "" ? NaN : Number(clock);
  return {
    state,
    control,
    role: query.get("role") === "viewer" ? "viewer" : "operator",
    faults: new Set(MOCK_FAULTS.filter((each) => asked.includes(each))),
    clockS: Number.isFinite(clockS) && clockS >= 0 ? clockS : null,
  };
}
