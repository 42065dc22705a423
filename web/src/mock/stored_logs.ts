/** The mock files of a run: the logs of its processes, and the command journal. */

export const MAX_LOG_LINES = 120;

export function logText(process: string, lines: number): string {
  return Array.from({ length: lines }, (_, index) => {
    const seconds = (1_795_600_000 + index * 1.7).toFixed(3);
    return `[INFO] [${seconds}] [${process}]: line ${index + 1} of the log`;
  }).join("\n");
}

/** What was logged before the page was opened. */
export function pastLog(untilS: number): unknown[] {
  return Array.from({ length: MAX_LOG_LINES }, (_, index) => {
    const stamp = { sec: Math.floor(untilS) - MAX_LOG_LINES + index, nanosec: 0 };
    return { stamp, level: 20, name: "mission", msg: `line ${index + 1} before this page`, file: "", function: "", line: 0 };
  });
}

export function commandRows(name: string): unknown[] {
  const ago = (seconds: number) => new Date(Date.now() - seconds * 1000).toISOString();
  return [
    { time: ago(60), session: name, what: "take control" },
    { time: ago(41), session: "phone-2", what: "call /mission/start", detail: "{'mission_type': ''}", refused: `${name} has had control for 19 s; ask for it or take it over` },
    { time: ago(40), session: name, what: "call /mission/start", detail: "{'mission_type': ''}" },
  ];
}
