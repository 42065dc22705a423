/** Mock doctor: it names three findings; running a finding's playbook removes the finding. */
import type { DoctorState, Finding } from "@/api/console_store";
import rows from "@/generated/mock_doctor.json";
import type { MockOptions } from "./options";
import { RequestRefused } from "./authority";
import { say } from "./sentences";

const EXAMINATION_MS = 2500;
const PREVIEW_MS = 900;
const PLAYBOOK_RUN_MS = 2200;
const FINDINGS: readonly Finding[] = rows.diagnosis.findings;
/** The dry run of each playbook. */
const FIXES: Record<string, (typeof rows.fixes)["sweep"]> = rows.fixes;

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
    if (finding === undefined) throw new RequestRefused(say("no_such_finding"), 409);
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
      diagnosis: { ...rows.diagnosis, status: this.findings.length > 0 ? rows.diagnosis.status : 0, findings: this.findings },
    };
  }

  private requireIdle(): void {
    if (this.state.busy !== "") throw new RequestRefused(say("doctor_busy", { what: this.state.busy }), 409);
  }

  private update(change: Partial<DoctorState>): void {
    this.state = { ...this.state, ...change };
    this.onChange(this.state);
  }
}

/** What `lupin play --json` prints. */
function playbookReport(playbook: string, confirmed: boolean): unknown {
  const preview = FIXES[playbook];
  if (preview === undefined || !confirmed) return preview;
  return { ...preview, steps: preview.steps.map((step) => ({ ...step, state: "changed" })), run: `20261124-071233-${playbook}`, dry_run: false };
}
