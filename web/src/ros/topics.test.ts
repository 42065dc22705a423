import { describe, expect, it } from "vitest";
import { TopicStore } from "./topics";

const ROW = { name: "/odom", type: "nav_msgs/msg/Odometry" } as const;

function storeOn(source: { isOpen?: boolean }) {
  const deliveries: ((message: unknown) => void)[] = [];
  const subscribe = (_: string, __: string, ___: object, deliver: (message: unknown) => void) => {
    deliveries.push(deliver);
    return () => {};
  };
  const store = new TopicStore(Object.assign(source, { subscribe }), () => 7);
  return { store, deliver: (message: unknown) => deliveries.at(-1)?.(message) };
}

describe("samples", () => {
  it("are kept for a view that is opened while the link is lost", () => {
    const source = { isOpen: true };
    const { store, deliver } = storeOn(source);
    const end = store.listen(ROW, {}, () => {});
    deliver("first");
    end();
    source.isOpen = false;
    const endLost = store.listen(ROW, {}, () => {});
    expect(store.last(ROW)).toEqual({ message: "first", receivedMs: 7 });
    endLost();
    store.clear();
    store.listen(ROW, {}, () => {});
    expect(store.last(ROW)).toBeUndefined();
  });

  it("are those that come from now on while the link is there", () => {
    const { store, deliver } = storeOn({ isOpen: true });
    store.listen(ROW, {}, () => {})();
    const end = store.listen(ROW, {}, () => {});
    deliver("first");
    end();
    store.listen(ROW, {}, () => {});
    expect(store.last(ROW)).toBeUndefined();
  });
});
