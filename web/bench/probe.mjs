// Measures the page in Chromium: `node bench/probe.mjs PART URL SECONDS`, for bench/bench_page.py. Prints one JSON object.
//
// Times of events are milliseconds of the wall clock, by which the caller compares them with what it sees of the robot.
import process from "node:process";
import { chromium } from "@playwright/test";

const OPENINGS = 5;
const HOLD_MS = 2500; // a button that must be held acts after 1200 ms, and the page's timers may be late
const MOVING_MS = 700;
const REST_MS = 1200; // a release takes up to 0.7 s, and the drive bus holds an input at zero until it was at rest
const HEAP_PERIOD_MS = 10_000;

const [part, url, seconds] = process.argv.slice(2);

function launch() {
  return chromium.launch({
    executablePath: process.env.LUPIN_CHROMIUM ?? "/usr/bin/chromium",
    args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-background-networking", "--disable-component-update", "--disable-sync"],
  });
}

async function open(browser, tab) {
  const page = await browser.newPage({ viewport: { width: 1440, height: 900 }, locale: "en-US" });
  await page.goto(`${url}/#${tab}`);
  await page.getByTestId("stop").filter({ hasText: "heard by robot 0" }).waitFor();
  return page;
}

async function hold(page, testId) {
  await page.getByTestId(testId).hover();
  await page.mouse.down();
  await page.waitForTimeout(HOLD_MS);
  await page.mouse.up();
}

/** A browser that has never seen the page opens the map: its first paint, its stop button, its view, the robot's first word. */
async function load() {
  const openings = [];
  for (let opening = 0; opening < OPENINGS; opening += 1) {
    const browser = await launch();
    const page = await browser.newPage({ viewport: { width: 1440, height: 900 }, locale: "en-US" });
    await page.addInitScript(() => {
      const reached = {};
      const conditions = {
        stop: () => document.querySelector("[data-testid=stop]") !== null,
        view: () => document.querySelector("[data-testid=map-canvas]") !== null,
        robot: () => document.querySelector("[data-testid=stop]")?.textContent?.includes("heard by robot 0") === true,
      };
      const look = () => {
        for (const [name, holds] of Object.entries(conditions)) if (reached[name] === undefined && holds()) reached[name] = performance.now();
        if (Object.keys(reached).length < 3) requestAnimationFrame(look);
      };
      requestAnimationFrame(look);
      window.reached = reached;
    });
    await page.goto(`${url}/#map`);
    await page.waitForFunction(() => Object.keys(window.reached).length === 3);
    openings.push(
      await page.evaluate(() => ({
        first_paint_ms: performance.getEntriesByName("first-contentful-paint")[0]?.startTime ?? null,
        interactive_ms: Math.max(window.reached.stop, window.reached.view),
        robot_ms: window.reached.robot,
        files: performance.getEntriesByType("resource").map(({ name }) => new URL(name).pathname).filter((path) => /\.(js|css)$/.test(path)),
      })),
    );
    await browser.close();
  }
  return { openings };
}

/** The map for a while: frames, the share of scripting and of the whole main thread, and the heap after a collection. */
async function map(mode) {
  const browser = await launch();
  const page = await open(browser, "map");
  if (mode === "3d") await page.getByRole("radio", { name: "3D" }).click();
  await page.waitForTimeout(3000);
  const session = await page.context().newCDPSession(page);
  await session.send("Performance.enable");
  const metrics = async () => Object.fromEntries((await session.send("Performance.getMetrics")).metrics.map(({ name, value }) => [name, value]));
  await page.evaluate(() => {
    window.frames_drawn = 0;
    const count = () => {
      window.frames_drawn += 1;
      requestAnimationFrame(count);
    };
    requestAnimationFrame(count);
  });
  const heap = [];
  const [before, framesBefore] = [await metrics(), await page.evaluate(() => window.frames_drawn)];
  const beganMs = Date.now();
  const endMs = beganMs + Number(seconds) * 1000;
  let pausedMs = 0;
  while (Date.now() < endMs) {
    const pauseMs = Date.now();
    await session.send("HeapProfiler.collectGarbage");
    heap.push({ at_s: (Date.now() - beganMs) / 1000, heap_mb: (await metrics()).JSHeapUsedSize / 1e6 });
    pausedMs += Date.now() - pauseMs;
    await page.waitForTimeout(Math.min(HEAP_PERIOD_MS, Math.max(1, endMs - Date.now())));
  }
  const [after, framesAfter, elapsedS] = [await metrics(), await page.evaluate(() => window.frames_drawn), (Date.now() - beganMs - pausedMs) / 1000];
  await browser.close();
  return {
    fps: (framesAfter - framesBefore) / elapsedS,
    scripting_percent: (100 * (after.ScriptDuration - before.ScriptDuration)) / elapsedS,
    main_thread_percent: (100 * (after.TaskDuration - before.TaskDuration)) / elapsedS,
    heap,
  };
}

/** Move the stick, and stop while a key drives, again and again: when the browser got each of these events. */
async function stop() {
  const browser = await launch();
  const page = await open(browser, "teleop");
  await page.evaluate(() => {
    const noted = { moves: [], presses: [] };
    const wallMs = (event) => performance.timeOrigin + event.timeStamp;
    window.addEventListener(
      "pointerdown",
      (event) => {
        if (event.target.closest("[data-testid=stop]")) noted.presses.push(wallMs(event));
        if (event.target.closest("[role=application]")) noted.moves.push(wallMs(event));
      },
      { capture: true },
    );
    window.noted = noted;
  });
  const stick = await page.getByRole("application", { name: "Turn" }).boundingBox();
  const turn = { x: stick.x + stick.width * 0.75, y: stick.y + stick.height / 2 };
  const button = await page.getByTestId("stop").boundingBox();
  const endMs = Date.now() + Number(seconds) * 1000;
  await hold(page, "release");
  for (let number = 0; Date.now() < endMs; number += 1) {
    await page.waitForTimeout(REST_MS);
    await page.mouse.move(turn.x, turn.y);
    await page.mouse.down();
    await page.waitForTimeout(MOVING_MS);
    await page.mouse.up();
    await page.waitForTimeout(REST_MS);
    await page.keyboard.down(number % 2 === 0 ? "KeyQ" : "KeyE");
    await page.mouse.move(button.x + button.width / 2, button.y + button.height / 2);
    await page.waitForTimeout(MOVING_MS + 10 * (number % 7));
    await page.mouse.down();
    await page.waitForTimeout(100);
    await page.mouse.up();
    await page.keyboard.up(number % 2 === 0 ? "KeyQ" : "KeyE");
    await hold(page, "release");
  }
  const noted = await page.evaluate(() => window.noted);
  await browser.close();
  return noted;
}

const PARTS = { load, map: () => map("2d"), scene: () => map("3d"), stop };
process.stdout.write(`${JSON.stringify(await PARTS[part]())}\n`);
