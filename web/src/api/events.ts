/** The channel on which the console's server pushes every change, and the heartbeat that keeps control. */
import { elsewhere } from "@/safety/elsewhere";
import { every } from "@/safety/timers";
import { localStorageOrNull } from "@/storage";
import { forgetStoredLocations, storedLocations } from "@/state/stored_locations";
import { getJson, postJson } from "./http";
import { addEvents, loadHistory } from "./history";
import { type ConsoleEvent, type ConsoleState, type Control, type Session, setOnline, showStops, useConsole } from "./console_store";

const SIGN_OF_LIFE_MS = 1000;
const RETRY_MS = 1500;

const FIELDS = ["control", "browsers", "run", "doctor", "locations", "approaches", "settings"] as const;

/** Ask who this browser is and listen to changes, for as long as the page is open. */
export async function followServer(socketUrl: string): Promise<void> {
  try {
    const answer = await getJson<{ session: Session | null; control: Control; stop: ConsoleState["stop"]; page?: string }>("/_api/session");
    noteVersion(answer.page ?? "");
    useConsole.setState({ session: ownSession(answer.session), sessionLoaded: true, control: answer.control });
    showStops(answer.stop);
    if (answer.session === null) return; // the page asks for a code, and follows again once it was accepted
    void loadShared();
    listen(socketUrl);
    void loadHistory();
  } catch {
    setOnline(false);
    setTimeout(() => void followServer(socketUrl), RETRY_MS);
  }
}

/** What this page may do here: whatever its console would allow, it only watches another robot than the console's. */
function ownSession(session: Session | null): Session | null {
  return session === null || elsewhere() === null ? session : { ...session, role: "viewer" };
}

/** The page was loaded from the server moments before its first answer; another version later is a newer page. */
function noteVersion(version: string): void {
  useConsole.setState(({ pageVersion }) => (pageVersion === "" ? { pageVersion: version } : { isOutdated: version !== "" && version !== pageVersion }));
}

async function loadShared(): Promise<void> {
  const [locations, settings, doctor, approaches] = await Promise.allSettled([
    getJson<ConsoleState["locations"]>("/_api/locations"),
    getJson<{ settings: ConsoleState["settings"] }>("/_api/settings"),
    getJson<ConsoleState["doctor"]>("/_api/doctor"),
    getJson<ConsoleState["approaches"]>("/_api/approaches"),
  ]);
  if (locations.status === "fulfilled") useConsole.setState({ locations: locations.value });
  if (settings.status === "fulfilled") useConsole.setState({ settings: settings.value.settings });
  if (approaches.status === "fulfilled") useConsole.setState({ approaches: approaches.value });
  if (doctor.status === "fulfilled") useConsole.setState({ doctor: doctor.value });
  await moveLocations();
}

/** Hand the named locations that this browser kept to the server. */
export async function moveLocations(): Promise<void> {
  const storage = localStorageOrNull();
  const locations = storedLocations(storage);
  if (locations === null) return;
  try {
    useConsole.setState({ locations: await postJson<ConsoleState["locations"]>("/_api/locations/import", { locations }) });
    forgetStoredLocations(storage);
  } catch {
    // Another browser has control, or this one may only watch: they are kept here until the page is opened again.
  }
}

let dropCurrent = () => {};

/** Give up the channel and open another, as the link to the server is dead. */
export function dropChannel(): void {
  dropCurrent();
}

function listen(socketUrl: string): void {
  const socket = new WebSocket(socketUrl);
  let isOver = false;
  // The server takes control away from a browser that is silent.
  const endSigns = every(SIGN_OF_LIFE_MS, () => {
    if (socket.readyState === WebSocket.OPEN) socket.send("{}");
  });
  socket.onmessage = (message) => {
    // The server begins with its state.
    setOnline(true);
    take(String(message.data));
  };
  const end = () => {
    if (isOver) return;
    isOver = true;
    endSigns();
    setOnline(false);
    setTimeout(() => void followServer(socketUrl), RETRY_MS);
  };
  socket.onclose = end;
  dropCurrent = () => {
    end();
    socket.close();
  };
}

/** Handle one event; unknown kinds are ignored. */
export function take(text: string): void {
  const { event, value } = JSON.parse(text) as { event: string; value: unknown };
  if (event === "event") addEvents([value as ConsoleEvent]);
  else if (event === "stop") showStops(value as ConsoleState["stop"]);
  else if ((FIELDS as readonly string[]).includes(event)) useConsole.setState({ [event]: value } as Partial<ConsoleState>);
}
