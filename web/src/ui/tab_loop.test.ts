// @vitest-environment jsdom
import { afterEach, beforeEach, expect, it } from "vitest";
import { loopTab } from "./tab_loop";

let end = () => {};

beforeEach(() => {
  document.body.innerHTML = `<button id="behind"></button><div id="dialog"><input id="first" /><button id="off" disabled></button><button id="skipped" tabindex="-1"></button><button id="last"></button></div><button id="stop" data-stop=""></button>`;
  end = loopTab(document.getElementById("dialog")!);
});
afterEach(() => end());

const tab = (shiftKey = false) => {
  document.dispatchEvent(new KeyboardEvent("keydown", { key: "Tab", shiftKey, cancelable: true }));
  return document.activeElement?.id;
};

it("Tab goes round through the dialog and the stop", () => {
  document.getElementById("first")!.focus();
  expect([tab(), tab(), tab()]).toEqual(["last", "stop", "first"]);
  expect([tab(true), tab(true)]).toEqual(["stop", "last"]);
});

it("Tab enters the dialog from what is behind it", () => {
  document.getElementById("behind")!.focus();
  expect(tab()).toBe("first");
});

it("Tab is free again once the dialog is closed", () => {
  end();
  document.getElementById("behind")!.focus();
  expect(tab()).toBe("behind");
  end = () => {};
});
