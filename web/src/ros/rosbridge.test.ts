import { encode } from "cbor2";
import { beforeEach, describe, expect, it, vi } from "vitest";
import { CONNECT_TIMEOUT_MS, CallFailed, LinkLost, Rosbridge, type Socket } from "./rosbridge";

class FakeSocket implements Socket {
  binaryType = "";
  readyState = 0;
  onopen: (() => void) | null = null;
  onclose: (() => void) | null = null;
  onmessage: ((event: { data: unknown }) => void) | null = null;
  sent: Record<string, unknown>[] = [];
  send(text: string): void {
    this.sent.push(JSON.parse(text) as Record<string, unknown>);
  }
  close(): void {
    this.readyState = 3;
    this.onclose?.();
  }
  open(): void {
    this.readyState = 1;
    this.onopen?.();
  }
  receive(frame: unknown): void {
    this.onmessage?.({ data: JSON.stringify(frame) });
  }
  operations(): unknown[] {
    return this.sent.map((frame) => frame["op"]);
  }
}

describe("Rosbridge", () => {
  let sockets: FakeSocket[];
  let client: Rosbridge;
  const socket = () => sockets.at(-1) as FakeSocket;

  beforeEach(() => {
    vi.useFakeTimers();
    sockets = [];
    client = new Rosbridge(() => {
      sockets.push(new FakeSocket());
      return socket();
    });
    client.connect();
  });

  it("sends nothing that was published while the link was down", () => {
    expect(client.publish("/cmd_vel_manual", "geometry_msgs/msg/Twist", {})).toBe(false);
    socket().open();
    expect(socket().operations()).toEqual(["set_level"]);
  });

  it("advertises again after a reconnect", () => {
    socket().open();
    expect(client.publish("/a", "std_msgs/msg/Bool", { data: true })).toBe(true);
    expect(client.publish("/a", "std_msgs/msg/Bool", { data: true })).toBe(true);
    expect(socket().operations()).toEqual(["set_level", "advertise", "publish", "publish"]);
    socket().close();
    vi.advanceTimersByTime(500);
    socket().open();
    client.publish("/a", "std_msgs/msg/Bool", { data: true });
    expect(socket().operations()).toEqual(["set_level", "advertise", "publish"]);
  });

  it("restores subscriptions, and doubles the wait between attempts up to five seconds", () => {
    const messages: unknown[] = [];
    client.subscribe("/scan", "sensor_msgs/msg/LaserScan", { throttleMs: 100 }, (message) => messages.push(message));
    socket().open();
    socket().close();
    const waits: number[] = [];
    for (let attempt = 0; attempt < 6; attempt += 1) {
      const before = sockets.length;
      let waited = 0;
      while (sockets.length === before) {
        vi.advanceTimersByTime(100);
        waited += 100;
      }
      waits.push(waited);
      socket().close();
    }
    expect(waits).toEqual([500, 1000, 2000, 4000, 5000, 5000]);
    vi.advanceTimersByTime(5000);
    socket().open();
    const subscribe = socket().sent.find((frame) => frame["op"] === "subscribe");
    expect(subscribe).toMatchObject({ topic: "/scan", compression: "cbor", throttle_rate: 100 });
    socket().onmessage?.({
      data: encode({ op: "publish", topic: "/scan", msg: { ranges: new Float32Array([1, NaN]) } }).slice().buffer,
    });
    expect((messages[0] as { ranges: Float32Array }).ranges[0]).toBe(1);
    expect((messages[0] as { ranges: Float32Array }).ranges[1]).toBeNaN();
  });

  it("ends a subscription at the server", () => {
    socket().open();
    const end = client.subscribe("/a", "std_msgs/msg/Bool", {}, () => {});
    end();
    end();
    expect(socket().operations()).toEqual(["set_level", "subscribe", "unsubscribe"]);
  });

  it("answers calls, passes on the server's reason, and gives up after the timeout", async () => {
    socket().open();
    const first = client.call("/a", "std_srvs/srv/Trigger", {});
    const second = client.call("/b", "std_srvs/srv/Trigger", {});
    const third = client.call("/c", "std_srvs/srv/Trigger", {}, 1000);
    const [, a, b] = socket().sent;
    socket().receive({ op: "service_response", id: a?.["id"], result: true, values: { success: true } });
    socket().receive({ op: "service_response", id: b?.["id"], result: false, values: "not allowed" });
    await expect(first).resolves.toEqual({ success: true });
    await expect(second).rejects.toEqual(new CallFailed("not allowed"));
    vi.advanceTimersByTime(1000);
    await expect(third).rejects.toMatchObject({ phrase: { key: "error_no_answer", values: { service: "/c", seconds: 1 } } });
  });

  it("fails what was under way when the link is lost", async () => {
    socket().open();
    const call = client.call("/a", "std_srvs/srv/Trigger", {});
    const goal = client.sendGoal("/navigate_to_pose", "nav2_msgs/action/NavigateToPose", {}, () => {});
    socket().close();
    await expect(call).rejects.toBeInstanceOf(LinkLost);
    await expect(goal.result).rejects.toBeInstanceOf(LinkLost);
    await expect(client.call("/a", "std_srvs/srv/Trigger", {})).rejects.toBeInstanceOf(LinkLost);
  });

  it("gives up a silent link at once, and an attempt to connect after five seconds", async () => {
    socket().open();
    const [dead, call] = [socket(), client.call("/a", "std_srvs/srv/Trigger", {})];
    dead.close = () => {}; // its closing handshake gets no answer either
    client.drop();
    await expect(call).rejects.toBeInstanceOf(LinkLost);
    expect(client.isOpen).toBe(false);
    vi.advanceTimersByTime(500);
    expect(sockets.length).toBe(2);
    vi.advanceTimersByTime(CONNECT_TIMEOUT_MS + 1000);
    expect(sockets.length).toBe(3);
    socket().open();
    vi.advanceTimersByTime(60_000);
    expect([sockets.length, client.isOpen]).toEqual([3, true]);
  });

  it("survives frames that cannot be read", () => {
    const reports: string[] = [];
    client.onStatus = (_, text) => reports.push(text);
    socket().open();
    for (const data of ["{", "null", "[]", new Uint8Array([0xff, 0x00]).buffer, new ArrayBuffer(0)]) {
      socket().onmessage?.({ data });
    }
    expect(client.isOpen).toBe(true);
    expect(reports.length).toBeGreaterThan(0);
  });
});
