/** What this page sent last, for the settings drawer's log: messages, calls, stops, and velocities where they change. */
import { create } from "zustand";
import { setting } from "./settings";

export const MAX_PUBLICATIONS = 50;

export interface Publication {
  number: number;
  topic: string;
  text: string;
  sent: boolean;
  time: Date;
}

export const usePublishLog = create<{ publications: Publication[] }>(() => ({ publications: [] }));

let number = 0;

export function notePublication(topic: string, message: unknown, sent: boolean): void {
  number += 1;
  const publication = { number, topic, text: JSON.stringify(message).slice(0, 400), sent, time: new Date() };
  usePublishLog.setState(({ publications }) => ({ publications: [publication, ...publications].slice(0, MAX_PUBLICATIONS) }));
  // The operator enables this in the settings, to read it in the browser's console beside other messages.
  if (setting("debugPublish")) console.info("published", topic, message, sent ? "" : "(not sent: no link)");
}

/** Velocities go out 20 times a second; a stick in motion is noted once per this time. */
const VELOCITY_PERIOD_MS = 1000;

let lastVelocity = { text: "", isMoving: false, atMs: -Infinity };

/** Note a velocity that starts or ends a motion, or changes one. */
export function noteVelocity(topic: string, message: unknown, isMoving: boolean, sent: boolean, nowMs = performance.now()): void {
  const text = JSON.stringify(message);
  if (text === lastVelocity.text) return;
  if (isMoving && lastVelocity.isMoving && nowMs - lastVelocity.atMs < VELOCITY_PERIOD_MS) return;
  lastVelocity = { text, isMoving, atMs: nowMs };
  notePublication(topic, message, sent);
}

let lastStop: string | null = null;

/** Note a stop or its release, which the page repeats twice a second. */
export function noteStop(topic: string, engaged: boolean, sent: boolean): void {
  const text = `${engaged} ${sent}`;
  if (text === lastStop || (lastStop === null && !engaged)) return;
  lastStop = text;
  notePublication(topic, { data: engaged }, sent);
}
