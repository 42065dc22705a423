/** Mock doctor: three findings; running a finding's playbook removes the finding. */
import type { DoctorState, Finding } from "@/api/console_store";
import type { MockOptions } from "./options";
import { RequestRefused } from "./authority";

const EXAMINATION_MS = 2500;
const PREVIEW_MS = 900;
const PLAYBOOK_RUN_MS = 2200;
/** Some of the checks of `lupin doctor`. */
const SAMPLE_CHECKS = [
  "link.carrier",
  "link.reachable",
  "discovery.server",
  "dds.multi-homed",
  "dds.processes",
  "dds.orphans",
  "ports",
  "software.release",
  "units.vendor",
  "units.lupin",
  "clock.drift",
  "clock.makestep",
  "graph.samples",
  "graph.silent",
  "graph.cameras",
  "controllers.states",
  "drive.sink",
  "drive.estop",
  "board.motor",
  "board.battery",
  "machine.storage",
  "machine.memory",
];

const FINDINGS: readonly Finding[] = [
  {
    id: "clock-drift",
    severity: "problem",
    where: "robot",
    symptom: "the map stops (Message Filter dropping message); transforms are too old or from the future",
    cause: "The robot's clock is 3.4 s behind the laptop's.",
    evidence: ["robot: 2026-11-24T07:10:02.118", "laptop: 2026-11-24T07:10:05.522 ± 0.004 s", "chronyc: Leap status: Not synchronised"],
    fix: { instruction: "", command: "lupin sync-clock --robot greenhouse", playbook: "sync-clock", safe: false, variables: {} },
    consequences: [
      {
        id: "topic-silent",
        severity: "problem",
        where: "robot",
        symptom: "everything that needs the topic waits for it",
        cause: "Nothing was received on /scan for 4.1 s.",
        evidence: ["/scan: 0 samples in 4.1 s, publisher rplidar_node"],
        fix: { instruction: "", command: "lupin logs slam", playbook: null, safe: false, variables: {} },
      },
      {
        id: "nav-blind",
        severity: "warning",
        where: "laptop",
        symptom: "navigation drives slowly or not at all",
        cause: "Lidar scans are up to 3.4 s old.",
        evidence: ["navigator: speed limited to 0 % of the maximum"],
        fix: { instruction: "", command: "lupin doctor --robot greenhouse", playbook: null, safe: false, variables: {} },
      },
    ],
  },
  {
    id: "shared-memory-orphans",
    severity: "warning",
    where: "laptop",
    symptom: "a new node starts and never completes discovery",
    cause: "Three dead processes left shared memory behind.",
    evidence: ["/dev/shm/fastrtps_port7412 (no process)", "/dev/shm/fastrtps_port7414 (no process)", "/dev/shm/sem.fastrtps_port7412_mutex"],
    fix: { instruction: "", command: "lupin sweep --local", playbook: "sweep", safe: true, variables: {} },
    consequences: [],
  },
  {
    id: "battery-low",
    severity: "warning",
    where: "robot",
    symptom: "the robot switches off in the middle of a mission",
    cause: "The battery is at 31 % and lasts for about 20 minutes.",
    evidence: ["/io/power/power_watcher: 11.02 V, 31 %"],
    fix: { instruction: "charge the battery", command: "", playbook: null, safe: false, variables: {} },
    consequences: [],
  },
];

export class MockDoctor {
  state: DoctorState = { busy: "", diagnosis: null, examined_s: null, problem: "" };
  private findings: Finding[];

  constructor(
    options: MockOptions,
    private readonly onChange: (state: DoctorState) => void,
  ) {
    this.findings = options.state === "calm" ? [] : [...FINDINGS];
    if (options.state !== "boot") this.state = { ...this.state, ...this.diagnosisUpdate(), examined_s: Date.now() / 1000 - 95 };
  }

  examine(): DoctorState {
    if (this.state.busy === "examining") return this.state;
    this.requireIdle();
    this.update({ busy: "examining", problem: "" });
    setTimeout(() => this.update({ busy: "", ...this.diagnosisUpdate(), examined_s: Date.now() / 1000 }), EXAMINATION_MS);
    return this.state;
  }

  /** Preview the finding's playbook, or run it if `confirmed`. Resolves to what `lupin play --json` prints. */
  async fix(id: string, confirmed: boolean): Promise<unknown> {
    const finding = this.findings.find((each) => each.id === id);
    if (finding === undefined) throw new RequestRefused("the last diagnosis has no such finding; examine again", 409);
    const { playbook, instruction, command } = finding.fix;
    if (playbook === null) throw new RequestRefused(`no playbook fixes this; fix it by hand: ${instruction || command}`, 409);
    this.requireIdle();
    this.update({ busy: `${confirmed ? "playing" : "previewing"} ${playbook}`, problem: "" });
    await new Promise((done) => setTimeout(done, confirmed ? PLAYBOOK_RUN_MS : PREVIEW_MS));
    this.update({ busy: "" });
    if (confirmed) {
      this.findings = this.findings.filter((each) => each.id !== id);
      this.examine();
    }
    return playbookReport(playbook, confirmed);
  }

  private diagnosisUpdate(): Pick<DoctorState, "diagnosis"> {
    return {
      diagnosis: { status: this.findings.length > 0 ? 1 : 0, findings: this.findings, unknown: [], broken: [], checks: SAMPLE_CHECKS },
    };
  }

  private requireIdle(): void {
    if (this.state.busy !== "") throw new RequestRefused(`the doctor is ${this.state.busy}; wait until it has finished`, 409);
  }

  private update(change: Partial<DoctorState>): void {
    this.state = { ...this.state, ...change };
    this.onChange(this.state);
  }
}

function playbookReport(playbook: string, confirmed: boolean): unknown {
  const state = confirmed ? "changed" : "would-change";
  const isClock = playbook === "sync-clock";
  const step = (index: number, name: string, machine: string, diff: string, result = state) => ({
    index,
    name,
    operation: "",
    machine,
    state: result,
    summary: "",
    diff,
    error: "",
    duration_s: 0.4,
    result: {},
  });
  return {
    playbook,
    robot: isClock ? "greenhouse" : "",
    state: "done",
    steps: isClock
      ? [
          step(0, "Stop the vendor's stack", "robot", "mirte-ros: active → inactive"),
          step(1, "Set the clock from the laptop's", "robot", "2026-11-24 07:10:02 → 2026-11-24 07:10:05"),
          step(2, "Start the vendor's stack", "robot", "mirte-ros: inactive → active"),
          step(3, "Serve time to the robot", "laptop", "", "same"),
        ]
      : [step(0, "Remove shared memory of dead processes", "laptop", "- /dev/shm/fastrtps_port7412\n- /dev/shm/fastrtps_port7414")],
    run: confirmed ? "20261124-071233-greenhouse" : "",
    dry_run: !confirmed,
    message: "",
    next_command: "",
    resume: "",
    exit_code: 0,
    changed: isClock ? 3 : 1,
  };
}
