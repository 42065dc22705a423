import { describe, expect, it } from "vitest";
import { pairingUrl, sharedUrls } from "./access";

const urls = ["https://192.168.1.20:8090", "https://pc.local:8090"];

describe("the address for other devices", () => {
  it("is one of the network where this page was opened on this computer", () => {
    expect(sharedUrls({ urls }, { origin: "http://127.0.0.1:8090", hostname: "127.0.0.1" })).toEqual(urls);
    expect(sharedUrls({ urls: [] }, { origin: "http://localhost:8090", hostname: "localhost" })).toEqual([]);
  });

  it("is this page's own first where it was opened over the network", () => {
    expect(sharedUrls({ urls }, { origin: "https://pc.local:8090", hostname: "pc.local" })).toEqual(["https://pc.local:8090", "https://192.168.1.20:8090"]);
    expect(sharedUrls({ urls: [] }, { origin: "https://proxy.lab", hostname: "proxy.lab" })).toEqual(["https://proxy.lab"]);
  });

  it("carries the code, if there is one, in its fragment", () => {
    expect(pairingUrl("https://10.0.0.2:8090", "K7Q2-MXPA")).toBe("https://10.0.0.2:8090/#code=K7Q2MXPA");
    expect(pairingUrl("https://10.0.0.2:8090", undefined)).toBe("https://10.0.0.2:8090/");
  });
});
