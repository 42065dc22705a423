/** A conversation without a model: the console understands what the operator says or types, and answers. */
import type { MessageSocket } from "@/api/sockets";
import { TextError } from "@/i18n/text_error";
import { fromPcm } from "./audio/pcm";
import type { Player } from "./audio/player";
import { ConsoleLink, type ConsoleListener, type Listening, MOVED, type Reply } from "./console_link";
import type { Talk } from "./talk";
import { CONFIRM_WITHIN_MS, type Entry, type VoiceView, closed, outcome, useVoice, withCall, withEntry } from "./voice_store";

export interface OfflineParts {
  consoleUrl: string;
  openConsole: (url: string) => MessageSocket;
  player: Pick<Player, "play" | "flush">;
  /** Of what the operator types. */
  language: () => "en" | "nl";
  /** Whether this page may not move the robot, for example as its release button was not held yet. */
  isClosed: () => boolean;
  /** A text of the catalog for the transcript, in the page's language. */
  inWords: (error: TextError) => string;
  /** What the console says, in the page's language. */
  translated: (words: string) => string;
  /** Called once the conversation is over by itself. */
  ended: () => void;
  now?: () => number;
}

const SOUND_RATE_HZ = 16_000;

export class OfflineConversation implements Talk {
  private readonly console: ConsoleLink;
  private readonly now: () => number;
  private turns = 0;
  /** Of the turn that waits for its reply; empty if none does. */
  private turn = "";
  private endedMs = 0;
  private readonly prefix = `${Date.now().toString(36)}${Math.random().toString(36).slice(2, 8)}`;

  constructor(private readonly parts: OfflineParts) {
    this.now = parts.now ?? (() => performance.now());
    this.console = new ConsoleLink(parts.consoleUrl, this.ofConsole, parts.openConsole);
  }

  start(): void {
    this.show({ session: "connecting", failure: null, readBack: null, latency: null });
    this.console.start();
  }

  close(): void {
    this.console.close();
    this.parts.player.flush();
    this.show({ session: "off", isConsoleOpen: false, console: null, isOperatorSpeaking: false, isThinking: false, isAgentSpeaking: false, readBack: null });
  }

  // -- what the operator does -----------------------------------------------------------------------------------------
  beginSpeech(): void {
    this.begin();
    this.console.announceTurn(this.turn, "speech", false);
    this.show({ isOperatorSpeaking: true });
  }

  /** The console has every frame already. */
  hear(): void {}

  endSpeech(): void {
    if (!this.view.isOperatorSpeaking) return;
    this.endedMs = this.now();
    // A stop that was heard has ended the turn here, and the console ignores the rest of it.
    if (this.turn !== "") {
      this.console.setClosed(this.parts.isClosed());
      this.console.announceTurn(this.turn, "speech", true);
    }
    this.show({ isOperatorSpeaking: false, isThinking: this.turn !== "" });
  }

  say(text: string): void {
    this.endSpeech();
    this.begin();
    this.write("operator", text);
    this.console.say(this.turn, text, this.parts.language());
    this.show({ isThinking: true });
  }

  confirm(): void {
    this.answer(true);
  }

  refuse(): void {
    this.answer(false);
  }

  interrupt(): void {
    this.endSpeech();
    this.parts.player.flush();
    this.console.interrupt();
    this.turn = "";
    this.show({ isThinking: false, readBack: null });
  }

  silence(): void {
    this.parts.player.flush();
  }

  playing(isPlaying: boolean): void {
    this.show({ isAgentSpeaking: isPlaying });
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

  private answer(agrees: boolean): void {
    if (this.view.readBack === null) return;
    this.endSpeech();
    this.begin();
    this.console.answer(this.turn, agrees);
    this.show({ isThinking: true });
  }

  private begin(): void {
    this.turns += 1;
    this.turn = `${this.prefix}-${this.turns}`;
    this.endedMs = this.now();
    this.parts.player.flush();
    this.console.setClosed(this.parts.isClosed());
    // The next turn answers what was read back, by a button or in words.
    this.show({ readBack: null, transcript: closed(this.view.transcript), latency: { soundMs: null, callMs: null } });
  }

  // -- the console ----------------------------------------------------------------------------------------------------
  private readonly ofConsole: ConsoleListener = {
    opened: () => {
      this.console.setClosed(this.parts.isClosed());
      this.show({ session: "on", isConsoleOpen: true });
    },
    changed: (state) => this.show({ console: state }),
    lost: () => {
      this.turn = "";
      this.show({ isConsoleOpen: false, console: null, readBack: null, isThinking: false });
    },
    moved: () => {
      this.close();
      this.show({ failure: MOVED });
      this.parts.ended();
    },
    stopHeard: (heard) => {
      this.silence();
      this.turn = "";
      this.write("page", this.parts.inWords(new TextError("voice_stop_heard", { heard })));
      this.show({ isThinking: false, readBack: null });
    },
    heard: (id, text, problem) => {
      if (text !== "") this.write("operator", text);
      if (problem !== "") this.write("page", this.parts.translated(problem));
      if (id === this.turn && (text === "" || problem !== "")) this.show({ isThinking: false });
    },
    replied: (reply) => this.take(reply),
    spoken: (sound) => {
      this.measure("soundMs");
      this.parts.player.play(fromPcm(sound), SOUND_RATE_HZ);
    },
  };

  private take({ id, message, call, response, readBack }: Reply): void {
    const isLatest = id === this.turn;
    if (isLatest) this.measure("callMs");
    this.write("agent", message);
    if (call !== null && response !== null) {
      const state = outcome(response);
      const { tool, arguments: args } = call;
      this.show({ calls: withCall(this.view.calls, { id, tool, args, state, result: response, byOperator: false }) });
      if (state === "done" && tool === "speak" && typeof args["text"] === "string") this.write("note", args["text"]);
    }
    if (!isLatest) return;
    this.show({ isThinking: false });
    if (call === null || readBack === "") return;
    // The console keeps the confirmation, and takes the button's answer instead.
    this.show({ readBack: { tool: call.tool, args: call.arguments, sentence: readBack, confirmation: "", expiresMs: this.now() + CONFIRM_WITHIN_MS } });
  }

  private measure(what: "callMs" | "soundMs"): void {
    const { latency } = this.view;
    if (latency !== null && latency[what] === null) this.show({ latency: { ...latency, [what]: this.now() - this.endedMs } });
  }

  private write(who: Entry["who"], text: string): void {
    this.show({ transcript: withEntry(this.view.transcript, who, text) });
  }

  private get view(): VoiceView {
    return useVoice.getState();
  }

  private show(changes: Partial<VoiceView>): void {
    useVoice.setState(changes);
  }
}
