/** What the models of the Live API can do (https://ai.google.dev/gemini-api/docs/models, November 2026). */

export interface LiveModel {
  /** As the service names it. */
  name: string;
  /**
   * Whether function calls must be declared as BLOCKING: its default lets the model go on talking while the robot is moving, and
   * claim a result that it does not have yet. A model that knows only that way refuses the declaration.
   */
  declaresBlocking: boolean;
  /** Whether a new connection can go on with the conversation of the last one. */
  canResume: boolean;
  /** Whether it forgets the oldest part of a long conversation. Without that, a session ends after 15 minutes. */
  canCompress: boolean;
  /** After how long the page moves to a new connection, ms; null where the service says that itself in time. */
  moveAfterMs: number | null;
}

const MODELS: readonly LiveModel[] = [
  {
    name: "models/gemini-3.1-flash-live-preview",
    declaresBlocking: false,
    canResume: true,
    canCompress: true,
    moveAfterMs: null,
  },
  {
    name: "models/gemini-3.8-live",
    declaresBlocking: true,
    canResume: true,
    canCompress: true,
    // The service closes it after 58 minutes with 1011, and the handle may then be refused with 1007:
    // https://discuss.ai.google.dev/t/186392
    moveAfterMs: 50 * 60_000,
  },
];

/** A model by its name, with or without "models/". One that is not in the table is taken for a recent one. */
export function liveModel(asked: string): LiveModel {
  const trimmed = asked.trim();
  const name = trimmed.includes("/") ? trimmed : `models/${trimmed}`;
  return MODELS.find((model) => model.name === name) ?? { name, declaresBlocking: true, canResume: true, canCompress: true, moveAfterMs: 50 * 60_000 };
}

export const MODEL_NAMES = MODELS.map(({ name }) => name);
