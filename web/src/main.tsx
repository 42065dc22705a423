import { StrictMode } from "react";
import { createRoot } from "react-dom/client";
import { answerRequestsBy } from "@/api/http";
import { offerScriptedAgent, openSocketsBy } from "@/api/sockets";
import { App } from "@/app";
import { IS_MOCK } from "@/environment";
import { preferredLanguage, setLanguage } from "@/i18n/text";
import { showProblem } from "@/state/problems";
import { followPage } from "@/rewind/rewind";
import { startRobot } from "@/robot/start";
import "@/styles/index.css";
import { loadDeferred } from "@/ui/deferred";

/** The page is then there in English, and takes its language when it comes. */
const WAIT_FOR_LANGUAGE_MS = 1000;
const languageShown = Promise.race([setLanguage(preferredLanguage()).catch(showProblem), new Promise((resolve) => setTimeout(resolve, WAIT_FOR_LANGUAGE_MS))]);
// Outside of the mock mode, its chunk is never loaded.
const mock = IS_MOCK ? await import("@/mock/mock") : null;
if (mock !== null) {
  answerRequestsBy(mock.answer);
  openSocketsBy(mock.openConsoleSocket);
}
offerScriptedAgent(() => (mock !== null ? Promise.resolve(mock.openVoiceAgent) : import("@/mock/scripted_agent").then(({ openScriptedAgent }) => () => openScriptedAgent())));
startRobot(mock);
followPage();

/** By then the first view is there, and its streams have begun. */
const LOAD_REST_AFTER_MS = 3000;
setTimeout(() => void loadDeferred(), LOAD_REST_AFTER_MS);

await languageShown;
const root = document.getElementById("root");
if (root !== null) {
  createRoot(root).render(
    <StrictMode>
      <App />
    </StrictMode>,
  );
}
