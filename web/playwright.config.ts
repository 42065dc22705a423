import { defineConfig } from "@playwright/test";

const CHROMIUM = process.env["LUPIN_CHROMIUM"] ?? "/usr/bin/chromium";
const PORT = process.env["LUPIN_PAGE_PORT"] ?? "5299";
const PAGE = `http://127.0.0.1:${PORT}/page/`;
/** A running console, for the tests of `tests/live`. */
const live = process.env["LUPIN_CONSOLE"];

export default defineConfig({
  testDir: live === undefined ? "tests/mock" : "tests/live",
  timeout: live === undefined ? 120_000 : 400_000,
  expect: { timeout: 30_000 },
  workers: 1,
  // A test that passes only when it is repeated is listed and counted: tools/second_try.py.
  retries: live === undefined ? 2 : 0,
  reporter: live === undefined ? [["list"], ["json", { outputFile: "test-results/report.json" }]] : [["list"]],
  outputDir: "test-results",
  use: {
    baseURL: live ?? PAGE,
    viewport: { width: 1440, height: 900 },
    locale: "en-US",
    launchOptions: {
      executablePath: CHROMIUM,
      args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-background-networking", "--disable-component-update", "--disable-sync"],
    },
  },
  ...(live === undefined
    ? { webServer: { command: `npx vite preview --host 127.0.0.1 --port ${PORT} --strictPort`, url: PAGE, timeout: 60_000 } }
    : {}),
});
