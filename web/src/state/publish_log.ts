/** The last messages that this page published, for the settings drawer's log. */
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
  // Asked for by the operator in the settings, to be read beside the browser's other messages.
  if (setting("debugPublish")) console.info("published", topic, message, sent ? "" : "(not sent: no link)");
}
