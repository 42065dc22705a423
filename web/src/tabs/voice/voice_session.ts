/** The voice session of this page: one conversation with its sound, begun by a gesture and ended with the tab. */
import { useConsole } from "@/api/console_store";
import { getJson } from "@/api/http";
import { openSocket } from "@/api/sockets";
import { socketUrl } from "@/environment";
import { VOICE_TOOLS, type VoiceToolName } from "@/generated/voice_tools";
import { errorText } from "@/i18n/error_text";
import { wordsIn } from "@/i18n/robot_words";
import { textIn, useLanguage } from "@/i18n/text";
import { TextError } from "@/i18n/text_error";
import { gate } from "@/robot/stop";
import { CommandRefused, refuseCommand } from "@/safety/guard";
import { setting } from "@/state/settings";
import { showProblem } from "@/state/problems";
import { Endpointer } from "./audio/endpointer";
import { Microphone, offersMicrophone } from "./audio/microphone";
import { loudness } from "./audio/pcm";
import { Player, type PlayerContext } from "./audio/player";
import type { ToolResult } from "./console_link";
import { Conversation } from "./conversation";
import { type Credential, openLive } from "./credentials";
import { instruction } from "./instruction";
import { liveModel } from "./live/models";
import type { FunctionCall } from "./live/server_frame";
import { OfflineConversation } from "./offline_conversation";
import type { Talk } from "./talk";
import { useVoice } from "./voice_store";

const FRAME_MS = 50;
/** Frames before the begin of an utterance that belong to it: its first sound is below the threshold. */
const PREROLL_FRAMES = 6;

/** The conversation begins without the arm's library where that takes longer. */
const LIBRARY_WITHIN_MS = 1000;

/** How the operator's turns begin and end: a held button, loudness, or a button that is pressed twice. */
export type TalkMode = "hold" | "open" | "toggle";

export function talkMode(pushToTalk: boolean, detectsSpeech: boolean): TalkMode {
  if (pushToTalk) return "hold";
  return detectsSpeech ? "open" : "toggle";
}

class VoiceSession {
  readonly conversation: Talk;
  private readonly context = new AudioContext();
  private readonly player = new Player(this.context as unknown as PlayerContext, (isPlaying) => this.conversation.playing(isPlaying));
  private microphone: Microphone | null = null;
  private isOver = false;
  private preroll: Int16Array[] = [];
  private talkedMs = 0;
  /** Whether what the microphone hears began while the agent was speaking. */
  private isOwnVoice = false;
  private names: { poses: string[]; sequences: string[] } = { poses: [], sequences: [] };
  private readonly endpointer = new Endpointer(() => ({
    startThreshold: setting("voiceVadStartThreshold"),
    endThreshold: setting("voiceVadEndThreshold"),
    endHoldMs: setting("voiceVadEndHoldMs"),
    maxUtteranceMs: setting("voiceVadMaxUtteranceMs"),
  }));

  /** To be called by a gesture: browsers let only that begin to play. */
  constructor(private readonly by: Credential) {
    void this.context.resume();
    const common = { consoleUrl: socketUrl("/_api/voice"), openConsole: openSocket, player: this.player, inWords: errorText, ended: () => endVoice() };
    if (by === "offline") {
      this.conversation = new OfflineConversation({ ...common, language: typedLanguage, isClosed, translated: (words) => wordsIn(useLanguage.getState().language, words) });
      return;
    }
    const model = liveModel(setting("geminiModel"));
    this.conversation = new Conversation({ ...common, openLive: () => openLive(by, model.name), model, instruction: () => this.instruction(), refusal });
  }

  async start(): Promise<void> {
    useVoice.setState({ isScripted: this.by === "script", isTypedOnly: this.by === "offline" && typedLanguage() !== "en", microphoneProblem: null, transcript: [], calls: [] });
    const microphone = this.openMicrophone();
    // The console itself knows the names.
    if (this.by !== "offline") await Promise.race([this.loadLibrary(), new Promise((resolve) => setTimeout(resolve, LIBRARY_WITHIN_MS))]);
    if (!this.isOver) this.conversation.start();
    await microphone;
  }

  close(): void {
    this.isOver = true;
    this.microphone?.close();
    this.conversation.close();
    void this.context.close();
    useVoice.setState({ microphone: "off", loudness: 0 });
  }

  /** Begin a turn in speech, of which a button or the endpointer is the cause. */
  beginTalk(): void {
    const { isOperatorSpeaking, isConsoleOpen, isTypedOnly, console } = useVoice.getState();
    if (isOperatorSpeaking || !isConsoleOpen) return;
    const listener = console?.listener.state;
    if (listener === "failed" || listener === "busy") this.requestListening();
    if (isTypedOnly) return;
    this.talkedMs = 0;
    this.conversation.beginSpeech();
    for (const frame of this.preroll) this.conversation.hear(frame);
    this.preroll = [];
  }

  endTalk(): void {
    this.endpointer.reset();
    this.conversation.endSpeech();
  }

  private take(frame: Int16Array): void {
    const level = loudness(frame);
    useVoice.setState({ loudness: level });
    this.conversation.overhear(frame);
    if (document.hidden) {
      // Nobody sees what the robot is told.
      if (useVoice.getState().isOperatorSpeaking) this.endTalk();
      return;
    }
    // Where nothing that is said is understood, the words for stopping are heard all the same.
    const mode = useVoice.getState().isTypedOnly ? "open" : talkMode(setting("voicePushToTalk"), setting("voiceVadEnabled"));
    const heard = mode === "open" ? this.endpointer.take(level, FRAME_MS) : null;
    // A model takes its own voice for no command, but the grammar would.
    if (heard === "begin") this.isOwnVoice = this.by === "offline" && this.player.isPlaying;
    if (heard === "begin" && !this.isOwnVoice) this.beginTalk();
    if (useVoice.getState().isOperatorSpeaking) this.conversation.hear(frame);
    else this.preroll = [...this.preroll, frame].slice(-PREROLL_FRAMES);
    if (heard === "end") this.endTalk();
    this.talkedMs += FRAME_MS;
    if (mode !== "open" && this.talkedMs >= setting("voiceVadMaxUtteranceMs") && useVoice.getState().isOperatorSpeaking) this.endTalk();
  }

  /** Have the console hear the microphone: for words for stopping, and for commands where no model hears them. */
  private requestListening(): void {
    if (this.microphone === null) return;
    const mode = this.by === "offline" && !useVoice.getState().isTypedOnly ? "commands" : "stops";
    this.conversation.listen({ mode, startLevel: setting("voiceVadStartThreshold"), endLevel: setting("voiceVadEndThreshold") });
  }

  private async openMicrophone(): Promise<void> {
    // A script hears nothing, so the operator is not asked for a microphone.
    if (this.by === "script" || !offersMicrophone()) return;
    const lost = (error: unknown) => useVoice.setState({ microphone: "off", loudness: 0, microphoneProblem: error instanceof Error ? error : new Error(String(error)) });
    try {
      const ended = () => {
        this.endTalk();
        this.conversation.listen(null);
        lost(new TextError("voice_microphone_ended"));
      };
      const microphone = await Microphone.open(this.context, (frame) => this.take(frame), ended);
      if (this.isOver) microphone.close();
      else {
        this.microphone = microphone;
        this.requestListening();
        useVoice.setState({ microphone: "on" });
      }
    } catch (error) {
      if (!this.isOver) lost(error);
    }
  }

  /** Read what the arm can replay, for the model. Without an answer, it asks by its tools. */
  private async loadLibrary(): Promise<void> {
    try {
      const { poses, sequences } = await getJson<{ poses?: unknown; sequences?: unknown }>("/_api/arm/library");
      this.names = { poses: namesOf(poses), sequences: namesOf(sequences) };
    } catch {
      // The arm's library is not running.
    }
  }

  private instruction(): string {
    return instruction({
      language: setting("voiceLanguage"),
      maxLinearMps: setting("voiceMaxLinearMps"),
      maxAngularRps: setting("voiceMaxAngularRps"),
      locations: Object.keys(useConsole.getState().locations),
      ...this.names,
      additions: setting("voiceSystemPrompt"),
    });
  }
}

let session: VoiceSession | null = null;

/** Begin a conversation. To be called by a gesture. */
export function startVoice(by: Credential): void {
  if (session !== null || !mayCommand("start")) return;
  session = new VoiceSession(by);
  void session.start();
}

export function endVoice(): void {
  const ended = session;
  session = null;
  ended?.close();
}

export function beginTalk(): void {
  if (mayCommand("talk")) session?.beginTalk();
}

export function endTalk(): void {
  session?.endTalk();
}

export function say(text: string): void {
  if (mayCommand("say", { text })) session?.conversation.say(text);
}

export function confirmReadBack(): void {
  if (mayCommand("confirm")) session?.conversation.confirm();
}

export function refuseReadBack(): void {
  session?.conversation.refuse();
}

export function interruptAgent(): void {
  session?.conversation.interrupt();
}

/** Fall silent, as at a stop. The microphone goes on. */
export function silenceAgent(): void {
  session?.conversation.silence();
}

/** The language in which the agent without a model understands what is typed. What is said it understands in English only. */
function typedLanguage(): "en" | "nl" {
  return setting("voiceLanguage").toLowerCase().startsWith("nl") ? "nl" : "en";
}

/** As at the sticks: what this page has not released, and may not command, it moves by no other way. */
function isClosed(): boolean {
  try {
    refuseCommand({});
    return gate.engaged;
  } catch {
    return true;
  }
}

/** Whether this page may command now; says why not, also in the console's journal. */
function mayCommand(what: string, args: Record<string, unknown> = {}): boolean {
  try {
    refuseCommand({});
    return true;
  } catch (error) {
    if (error instanceof CommandRefused) session?.conversation.noteRefusal(what, args, inEnglish(error));
    showProblem(error);
    return false;
  }
}

/** The reason of a refusal for the model and the journal. */
function inEnglish({ phrase, message }: CommandRefused): string {
  return phrase === null ? message : textIn("en", phrase.key, phrase.values);
}

/** Why this page may not have a call carried out now, for the model; null where the console decides. */
function refusal({ name, args }: FunctionCall): ToolResult | null {
  if (!Object.hasOwn(VOICE_TOOLS, name)) return null;
  const { effect, gate: rule } = VOICE_TOOLS[name as VoiceToolName];
  if (effect !== "motion" && effect !== "change") return null;
  try {
    refuseCommand({});
  } catch (error) {
    if (!(error instanceof CommandRefused)) throw error;
    return { ok: false, error: inEnglish(error) };
  }
  const isGated = rule === "estop" || (rule === "estop_on_start" && args["action"] === "start");
  // As at the sticks: what this page has not released, it moves by no other way.
  if (isGated && gate.engaged) return { ok: false, blocked: true, error: "this page may not move the robot yet: the operator must hold its release button first; do not try again before that" };
  return null;
}

function namesOf(rows: unknown): string[] {
  if (!Array.isArray(rows)) return [];
  return rows.flatMap((row: unknown) => (typeof row === "object" && row !== null && "name" in row && typeof row.name === "string" ? [row.name] : []));
}
