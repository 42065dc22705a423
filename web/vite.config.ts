import { fileURLToPath } from "node:url";
import tailwindcss from "@tailwindcss/vite";
import react from "@vitejs/plugin-react";
import { defineConfig } from "vite";

// The server that `lupin console --dev` names; its origin check accepts localhost.
const server = process.env["LUPIN_CONSOLE"] ?? "http://127.0.0.1:8090";

export default defineConfig({
  base: "/page/",
  plugins: [react(), tailwindcss()],
  resolve: { alias: { "@": fileURLToPath(new URL("./src", import.meta.url)) } },
  build: {
    outDir: "dist",
    target: "es2022",
    // These have light-dark(): its replacement for older ones would take the theme of the page, also in the dark island of the map.
    cssTarget: ["chrome123", "edge123", "firefox120", "safari17.5"],
    chunkSizeWarningLimit: 1200,
    // No inlined data: URLs: the page's policy loads scripts and fonts from its own origin only.
    assetsInlineLimit: 0,
  },
  server: {
    port: Number(process.env["LUPIN_PAGE_PORT"] ?? 5173),
    strictPort: true,
    proxy: {
      "/_ros": { target: server, ws: true },
      "/_api": { target: server, ws: true },
      "/_video": { target: server },
    },
  },
});
