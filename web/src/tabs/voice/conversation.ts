/**
 * One conversation: the model at one end, the console at the other, the operator's turns between them.
 *
 * Only what a person did begins a turn: speech, a text, a button. What the model still sends of an answer that was interrupted is
 * dropped, its calls too: at the console they would count as calls of the new turn.
 */
import { TextError } from "@/i18n/text_error";
import type { MessageSocket } from "@/api/sockets";
import { fromBase64, toBase64 } from "./audio/pcm";
import type { Player } from "./audio/player";
import { ConsoleLink, type ConsoleListener, type Listening, MOVED, type ToolResult, type TurnKind } from "./console_link";
import { LiveClient, type LiveListener } from "./live/live_client";
import type { LiveModel } from "./live/models";
import type { FunctionCall, ServerFrame } from "./live/server_frame";
import type { Talk } from "./talk";
import { CONFIRM_WITHIN_MS, type Latency, type VoiceView, closed, extended, outcome, useVoice, withCall, withEntry, withResult } from "./voice_store";

export interface ConversationParts {
  openLive: () => Promise<MessageSocket>;
  model: LiveModel;
  instruction: () => string;
  consoleUrl: string;
  openConsole: (url: string) => MessageSocket;
  player: Pick<Player, "play" | "flush" | "isPlaying">;
  /** Why this page may not have a call carried out now; null where it may. */
  refusal: (call: FunctionCall) => ToolResult | null;
  /** A text of the catalog for the transcript, in the page's language. */
  inWords: (error: TextError) => string;
  /** Called once the conversation is over by itself. */
  ended: () => void;
  now?: () => number;
}

interface Turn {
  id: string;
  kind: TurnKind;
  ended: boolean;
  /** When the operator finished, ms. */
  endedMs: number | null;
  refusals: number;
}

/** As many calls of a turn are answered with a refusal of this page; then the model gets no more answers in it. */
const MAX_REFUSALS = 8;

export class Conversation implements Talk {
  private readonly live: LiveClient;
  private readonly console: ConsoleLink;
  private readonly now: () => number;
  private turn: Turn | null = null;
  private turns = 0;
  private buttonCalls = 0;
  /** Whether the model is answering: it has sent something since the end of its last answer. */
  private isAnswering = false;
  /** Whether what comes belongs to an answer that was interrupted. */
  private isStale = false;
  /** Whether the model was not told of that: it still waits for the results of its calls. */
  private isUntold = false;
  private latency: Latency = { soundMs: null, callMs: null };
  private readonly unanswered = new Set<string>();
  private readonly prefix = `${Date.now().toString(36)}${Math.random().toString(36).slice(2, 8)}`;

  constructor(private readonly parts: ConversationParts) {
    this.now = parts.now ?? (() => performance.now());
    this.live = new LiveClient(parts.openLive, parts.model, parts.instruction, this.ofModel);
    this.console = new ConsoleLink(parts.consoleUrl, this.ofConsole, parts.openConsole);
  }

  start(): void {
    this.show({ session: "connecting", failure: null, readBack: null, latency: null });
    this.console.start();
    this.live.start();
  }

  close(): void {
    this.live.close();
    this.console.close();
    this.parts.player.flush();
    this.show({
      session: "off",
      isConsoleOpen: false,
      console: null,
      isOperatorSpeaking: false,
      isThinking: false,
      isAgentSpeaking: false,
      readBack: null,
      transcript: closed(this.view.transcript),
      calls: this.view.calls.map((call) => (call.state === "running" ? { ...call, state: "cancelled" as const } : call)),
    });
  }

  // -- what the operator does -----------------------------------------------------------------------------------------
  /** The operator begins to speak; the model falls silent. */
  beginSpeech(): void {
    this.begin("speech", false);
    this.live.beginActivity();
    this.show({ isOperatorSpeaking: true });
  }

  /** A frame of the microphone, while the operator is speaking. */
  hear(frame: Int16Array): void {
    if (this.view.isOperatorSpeaking) this.live.sendAudio(toBase64(frame));
  }

  listen(listening: Listening | null): void {
    this.console.listen(listening);
  }

  noteRefusal(name: string, args: Record<string, unknown>, reason: string): void {
    this.console.noteRefusal(name, args, reason);
  }

  overhear(frame: Int16Array): void {
    this.console.sendSound(frame);
  }

  endSpeech(): void {
    if (!this.view.isOperatorSpeaking || this.turn === null) return;
    this.live.endActivity();
    this.turn.ended = true;
    this.turn.endedMs = this.now();
    this.console.announceTurn(this.turn.id, "speech", true);
    const { transcript } = this.view;
    // Its words may come after those of the answer.
    const isHeard = transcript.some(({ who, isOpen }) => who === "operator" && isOpen);
    this.show({ isOperatorSpeaking: false, isThinking: true, transcript: isHeard ? transcript : withEntry(transcript, "operator", "", true) });
  }

  say(text: string): void {
    this.endSpeech();
    this.begin("text", true);
    this.show({ transcript: withEntry(this.view.transcript, "operator", text), isThinking: true });
    this.live.sendText(text);
  }

  /** Carry out what was read back, as the operator has pressed the button. */
  async confirm(): Promise<void> {
    const { readBack } = this.view;
    if (readBack === null) return;
    this.endSpeech();
    this.begin("button", true);
    this.buttonCalls += 1;
    const id = `${this.prefix}-button-${this.buttonCalls}`;
    const args = { ...readBack.args, confirmation: readBack.confirmation };
    const result = await this.carryOut({ id, name: readBack.tool, args }, true);
    this.live.sendText(`[The operator pressed Confirm, and the page called ${readBack.tool}. Its result: ${JSON.stringify(result)}. Tell them in one sentence.]`);
  }

  /** Forget what was read back, as the operator has pressed the button. */
  refuse(): void {
    const { readBack } = this.view;
    if (readBack === null) return;
    this.interrupt();
    this.live.sendText(`[The operator pressed Cancel: do not call ${readBack.tool}. Answer with one word.]`);
  }

  /** End the answer and what the console is doing for it. */
  interrupt(): void {
    this.endSpeech();
    this.console.interrupt();
    this.begin("button", true);
    this.show({ isThinking: false });
    this.report();
  }

  /** Fall silent, as at a stop. The microphone goes on. */
  silence(): void {
    this.parts.player.flush();
  }

  /** The player has begun, or has nothing left. */
  playing(isPlaying: boolean): void {
    this.show({ isAgentSpeaking: isPlaying });
    this.report();
  }

  // -- the model ------------------------------------------------------------------------------------------------------
  private readonly ofModel: LiveListener = {
    opened: (isForgetful) => this.opened(isForgetful),
    received: (frame) => this.receive(frame),
    reconnecting: () => this.reconnecting(),
    failed: (error) => this.fail(error),
  };

  private opened(isForgetful: boolean): void {
    this.isAnswering = false;
    this.isStale = false;
    this.show({ session: "on", ...(isForgetful ? { transcript: withEntry(this.view.transcript, "page", this.parts.inWords(new TextError("voice_forgot"))) } : {}) });
  }

  private reconnecting(): void {
    // The calls of the lost connection are not answered on the next one.
    this.unanswered.clear();
    this.isAnswering = false;
    this.show({ session: "connecting", isThinking: false });
  }

  private fail(error: Error): void {
    this.close();
    this.show({ failure: error });
    this.parts.ended();
  }

  private receive(frame: ServerFrame): void {
    if (frame.heard !== "") this.show({ transcript: extended(this.view.transcript, "operator", frame.heard) });
    if (!this.isStale) this.takeAnswer(frame);
    else if (this.isUntold) this.live.respond(frame.calls.map(({ id, name }) => ({ id, name, response: { ok: false, error: INTERRUPTED } })));
    for (const id of frame.cancelled) this.forgetCall(id);
    if (frame.isInterrupted) this.parts.player.flush();
    if (frame.isInterrupted || frame.isTurnComplete) this.endAnswer();
    this.report();
  }

  private takeAnswer(frame: ServerFrame): void {
    if (frame.said !== "") {
      this.isAnswering = true;
      this.show({ transcript: extended(this.view.transcript, "agent", frame.said) });
    }
    for (const { data, rateHz } of frame.audio) {
      this.isAnswering = true;
      this.measure("soundMs");
      this.parts.player.play(fromBase64(data), rateHz);
    }
    for (const call of frame.calls) {
      this.isAnswering = true;
      this.measure("callMs");
      void this.answerCall(call);
    }
  }

  private endAnswer(): void {
    this.isAnswering = false;
    this.isStale = false;
    this.show({ transcript: closed(this.view.transcript), ...(this.unanswered.size === 0 ? { isThinking: false } : {}) });
  }

  private async answerCall(call: FunctionCall): Promise<void> {
    this.unanswered.add(call.id);
    const response = await this.carryOut(call, false);
    if (!this.unanswered.delete(call.id)) return; // cancelled, or of a connection that is gone
    if ((this.turn?.refusals ?? 0) <= MAX_REFUSALS) this.live.respond([{ id: call.id, name: call.name, response }]);
  }

  private forgetCall(id: string): void {
    if (this.unanswered.delete(id)) this.show({ calls: withResult(this.view.calls, id, { state: "cancelled" }) });
  }

  // -- the console ----------------------------------------------------------------------------------------------------
  private readonly ofConsole: ConsoleListener = {
    opened: () => {
      this.show({ isConsoleOpen: true });
      if (this.turn !== null) this.console.announceTurn(this.turn.id, this.turn.kind, this.turn.ended);
    },
    changed: (state) => this.show({ console: state }),
    lost: () => this.show({ isConsoleOpen: false, console: null, readBack: null }),
    moved: () => this.fail(MOVED),
    stopHeard: (heard) => {
      this.silence();
      this.show({ transcript: withEntry(this.view.transcript, "page", this.parts.inWords(new TextError("voice_stop_heard", { heard }))) });
    },
    // Only the agent without a model has these.
    heard: () => {},
    replied: () => {},
    spoken: () => {},
  };

  private async carryOut(call: FunctionCall, byOperator: boolean): Promise<ToolResult> {
    const { id, name: tool, args } = call;
    this.show({ calls: withCall(this.view.calls, { id, tool, args, state: "running", result: null, byOperator }) });
    const refusal = this.parts.refusal(call);
    if (refusal !== null) {
      if (this.turn !== null) this.turn.refusals += 1;
      this.noteRefusal(tool, args, String(refusal["error"]));
    }
    const result = refusal ?? (await this.console.call(call));
    const { [CONFIRMATION]: _, ...withoutToken } = args;
    const state = outcome(result);
    this.show({ calls: withResult(this.view.calls, id, { state, result }) });
    if (state === "done" && tool === "speak" && typeof args["text"] === "string") this.show({ transcript: withEntry(this.view.transcript, "note", args["text"]) });
    const { confirm: sentence, [CONFIRMATION]: confirmation } = result;
    if (typeof sentence === "string" && typeof confirmation === "string") {
      this.show({ readBack: { tool, args: withoutToken, sentence, confirmation, expiresMs: this.now() + CONFIRM_WITHIN_MS } });
    }
    return result;
  }

  // -- turns ----------------------------------------------------------------------------------------------------------
  private begin(kind: TurnKind, ended: boolean): void {
    this.turns += 1;
    this.turn = { id: `${this.prefix}-${this.turns}`, kind, ended, endedMs: ended ? this.now() : null, refusals: 0 };
    this.console.announceTurn(this.turn.id, kind, ended);
    this.isStale = this.isAnswering;
    this.isUntold = kind === "button";
    // Speech and text make the service cancel what it had called; an answer would be to a call that is unknown by then.
    if (!this.isUntold) this.unanswered.clear();
    this.latency = { soundMs: null, callMs: null };
    this.parts.player.flush();
    // The next turn answers what was read back, by a button or in words.
    this.show({ readBack: null, transcript: closed(this.view.transcript) });
  }

  private measure(what: keyof Latency): void {
    const endedMs = this.turn?.endedMs ?? null;
    if (endedMs === null || this.latency[what] !== null) return;
    this.latency = { ...this.latency, [what]: this.now() - endedMs };
    this.show({ latency: this.latency });
  }

  /** Tell the connection whether a turn is going on. */
  private report(): void {
    this.live.setBusy(this.isAnswering || this.unanswered.size > 0 || this.view.isOperatorSpeaking || this.view.isThinking);
  }

  private get view(): VoiceView {
    return useVoice.getState();
  }

  private show(changes: Partial<VoiceView>): void {
    useVoice.setState(changes);
  }
}

const CONFIRMATION = "confirmation";
const INTERRUPTED = "the operator interrupted; call nothing more, and wait for their next turn";
