/** The mock run, and those before it. */
import type { RunState } from "@/api/console_store";
import type { World } from "./world";

const PROCESSES = ["estop", "drive", "slam", "nav", "body", "perception", "twin", "mission", "recorder", "console"];
export const CURRENT_RUN = "20261124-070731";

export function runState(world: World): RunState {
  const isStale = world.options.state === "stale";
  return {
    id: CURRENT_RUN,
    age_s: Math.round(400 + world.timeS),
    ready_s: 11.4,
    stages: PROCESSES.map((name, index) => ({
      name,
      phase: "up",
      trouble: isStale && name === "slam" ? "has not responded for 4 s" : "",
      why: "",
      waiting_for: [],
      waiting_s: null,
      restarts: name === "perception" ? 1 : 0,
      cpu_percent: Number((3 + ((index * 37) % 23) / 2).toFixed(1)),
      memory_mb: 62 + ((index * 53) % 90),
    })),
    alarms: isStale ? ["slam has not responded for 4 s"] : [],
    rates_hz: { "/scan": 10, "/mirte_base_controller/odom": 30, "/tf": 30 },
    silent_s: {},
  };
}

export function storedRuns(nowS: number): unknown[] {
  const run = (id: string, state: string, ago: number, megabytes: number, kept = false) => ({
    id,
    state,
    size_bytes: megabytes * 1_000_000,
    kept,
    started_s: nowS - ago,
  });
  return [
    run(CURRENT_RUN, "up", 420, 38),
    run("20261123-163012", "DONE", 52_000, 214, true),
    run("20261123-150944", "FAULT", 57_000, 96),
    run("20261122-102210", "DONE", 162_000, 188),
  ];
}

export function storedRun(id: string, world: World, nowS: number): unknown {
  const row = (storedRuns(nowS) as { id: string; state: string; started_s: number }[]).find((each) => each.id === id);
  if (row === undefined) return null;
  const isUp = row.state === "up";
  return {
    id,
    up: isUp,
    started_s: row.started_s,
    options: { mode: "sim", world: "demo", mission: "explore" },
    state: isUp ? runState(world) : {},
    result: isUp
      ? null
      : { state: row.state, tags_total: 8, tags_found: 8, tags_read: row.state === "DONE" ? 8 : 5, wall_time_s: 431, sim_time_s: 430, report: "report.html" },
  };
}

export function report(id: string): string {
  return `<!doctype html><html lang="en"><meta charset="utf-8"><title>${id}</title>
<style>body{font:16px system-ui;margin:2rem;background:#fff;color:#1b241f}h1{font-size:1.6rem}td,th{padding:.3rem 1.2rem .3rem 0;text-align:left;border-bottom:1px solid #ccd}</style>
<h1>Run ${id}</h1><p>A mock report: 8 of 8 tags were read in 7 min 10 s, without a collision.</p>
<table><tr><th>Tag</th><th>Species</th><th>Readings</th></tr>
<tr><td>19</td><td>red tulip</td><td>412 ppm, 776 lux</td></tr><tr><td>5</td><td>none</td><td>14.6 °C, 28.1 % soil</td></tr>
<tr><td>3</td><td>red tulip, 1 bug</td><td>401 ppm, 831 lux</td></tr></table></html>`;
}

export function plays(): unknown[] {
  const play = (run: string, playbook: string, robot: string, state: string, started: string, steps: number) => ({
    run,
    playbook,
    file: "",
    robot,
    digest: "",
    started,
    variables: {},
    secrets: [],
    from_step: "",
    undo_of: "",
    state,
    steps,
    torn_lines: 0,
    exclusive: true,
    closed: false,
    resume: state === "interrupted" ? `lupin play ${playbook} --robot ${robot} --resume` : "",
  });
  return [
    play("20261124-064410-deploy-robot", "deploy-robot", "greenhouse", "done", "2026-11-24T06:44:10+00:00", 14),
    play("20261123-162155-sync-clock", "sync-clock", "greenhouse", "interrupted", "2026-11-23T16:21:55+00:00", 3),
    play("20261122-101502-deploy-laptop", "deploy-laptop", "", "done", "2026-11-22T10:15:02+00:00", 6),
  ];
}
