/** The made-up files of a run: the logs of its processes, and the command journal. */

export const MAX_LOG_LINES = 120;

export function logText(process: string, lines: number): string {
  return Array.from({ length: lines }, (_, index) => {
    const seconds = (1_795_600_000 + index * 1.7).toFixed(3);
    return `[INFO] [${seconds}] [${process}]: line ${index + 1} of the log`;
  }).join("\n");
}

export function commandRows(name: string): unknown[] {
  return [
    { time_s: Date.now() / 1000 - 60, who: name, what: "take control", detail: null },
    { time_s: Date.now() / 1000 - 40, who: name, what: "call /mission/start", detail: { mission_type: "" } },
  ];
}
