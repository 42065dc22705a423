import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { ApiError } from "@/api/http";
import { StopOfConsole } from "./stop_of_console";

beforeEach(() => void vi.useFakeTimers());
afterEach(() => void vi.useRealTimers());

/** A console that does not answer the first `lost` requests. */
function openStop(lost: number) {
  const told: unknown[] = [];
  const post = vi.fn((body: unknown) => {
    if (post.mock.calls.length <= lost) return Promise.reject(new Error("lost"));
    told.push(body);
    return Promise.resolve({});
  });
  const refused = vi.fn();
  return { stop: new StopOfConsole(post, refused), told, post, refused };
}

it("states a stop once, however often the page repeats it", async () => {
  const { stop, post } = openStop(0);
  for (let times = 0; times < 5; times += 1) stop.state(true, "a");
  await vi.advanceTimersByTimeAsync(5000);
  expect(post.mock.calls).toEqual([[{ engaged: true, press: "a" }]]);
});

it.each([true, false])("repeats what got no answer, engaged %s, until it has one", async (engaged) => {
  const { stop, told, post } = openStop(3);
  stop.state(engaged, "a");
  await vi.advanceTimersByTimeAsync(10_000);
  expect(post).toHaveBeenCalledTimes(4);
  expect(told).toEqual([{ engaged, press: "a" }]);
});

it("says what the console refuses, and does not repeat it", async () => {
  const { stop, post, refused } = openStop(0);
  post.mockRejectedValue(new ApiError(403, "phone-2 has control"));
  stop.state(false, "a");
  await vi.advanceTimersByTimeAsync(10_000);
  expect(post).toHaveBeenCalledTimes(1);
  expect(refused).toHaveBeenCalledWith(new ApiError(403, "phone-2 has control"));
});

it("no longer repeats a stop that was let go of meanwhile", async () => {
  const { stop, told } = openStop(1);
  stop.state(true, "a");
  stop.state(false, "a");
  await vi.advanceTimersByTimeAsync(10_000);
  expect(told).toEqual([{ engaged: false, press: "a" }]);
});

it("lets go of a press only once the console has answered to it", async () => {
  const answers: (() => void)[] = [];
  const post = vi.fn(() => new Promise<void>((resolve) => answers.push(resolve)));
  const stop = new StopOfConsole(post, vi.fn());
  stop.state(true, "a");
  stop.state(false, "a");
  await vi.advanceTimersByTimeAsync(1000);
  expect(post.mock.calls).toEqual([[{ engaged: true, press: "a" }]]);
  answers[0]?.();
  await vi.advanceTimersByTimeAsync(0);
  expect(post.mock.lastCall).toEqual([{ engaged: false, press: "a" }]);
});

it("states a later press although an earlier one has no answer yet", async () => {
  const { stop, told } = openStop(1);
  stop.state(false, "a");
  stop.state(true, "b");
  await vi.advanceTimersByTimeAsync(10_000);
  expect(told).toEqual([{ engaged: true, press: "b" }, { engaged: false, press: "a" }]);
});
