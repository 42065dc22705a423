import { StrictMode } from "react";
import { createRoot } from "react-dom/client";
import { App } from "@/app";
import { setLanguage, useLanguage } from "@/i18n/text";
import { startRobot } from "@/robot";
import "@/styles/index.css";

setLanguage(useLanguage.getState().language);
void startRobot();

const root = document.getElementById("root");
if (root !== null) {
  createRoot(root).render(
    <StrictMode>
      <App />
    </StrictMode>,
  );
}
