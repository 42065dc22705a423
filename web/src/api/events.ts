/** The channel on which the console's server pushes every change, and the sign of life that keeps control. */
import { ask } from "./http";
import { type ConsoleState, type Control, type Own, useConsole } from "./console_store";

const SIGN_OF_LIFE_MS = 1000;
const RETRY_MS = 1500;

const FIELDS = ["control", "stop", "run", "doctor", "locations", "settings"] as const;

/** Ask who this browser is and listen to changes, for as long as the page is open. */
export async function followServer(socketUrl: string): Promise<void> {
  try {
    const answer = await ask<{ session: Own | null; control: Control; stop: string[] }>("/_api/session");
    useConsole.setState({ own: answer.session, known: true, control: answer.control, stop: answer.stop });
    if (answer.session === null) return; // the page asks for a code, and follows again once it was accepted
    void loadShared();
    listen(socketUrl);
  } catch {
    useConsole.setState({ online: false, changedMs: performance.now() });
    setTimeout(() => void followServer(socketUrl), RETRY_MS);
  }
}

async function loadShared(): Promise<void> {
  const [locations, settings, doctor] = await Promise.allSettled([
    ask<ConsoleState["locations"]>("/_api/locations"),
    ask<{ settings: ConsoleState["settings"] }>("/_api/settings"),
    ask<ConsoleState["doctor"]>("/_api/doctor"),
  ]);
  if (locations.status === "fulfilled") useConsole.setState({ locations: locations.value });
  if (settings.status === "fulfilled") useConsole.setState({ settings: settings.value.settings });
  if (doctor.status === "fulfilled") useConsole.setState({ doctor: doctor.value });
}

function listen(socketUrl: string): void {
  const socket = new WebSocket(socketUrl);
  // Control is lost by silence.
  const sign = setInterval(() => {
    if (socket.readyState === WebSocket.OPEN) socket.send("{}");
  }, SIGN_OF_LIFE_MS);
  socket.onopen = () => useConsole.setState({ online: true, changedMs: performance.now() });
  socket.onmessage = (message) => take(String(message.data));
  socket.onclose = () => {
    clearInterval(sign);
    useConsole.setState({ online: false, changedMs: performance.now() });
    setTimeout(() => void followServer(socketUrl), RETRY_MS);
  };
}

/** Take one event; unknown kinds are passed over. */
export function take(text: string): void {
  const { event, value } = JSON.parse(text) as { event: string; value: unknown };
  if ((FIELDS as readonly string[]).includes(event)) useConsole.setState({ [event]: value } as Partial<ConsoleState>);
}
