import { createHash } from "node:crypto";
import { readFileSync, readdirSync, statSync } from "node:fs";
import { join } from "node:path";
import { defineConfig } from "vite";

// What the files were built from, so that a test sees without node that somebody forgot to build.
const SOURCES = ["../twin_daemon/figures/drawings", "package-lock.json", "public", "src", "tsconfig.json", "vite.config.ts"];
const files = (path: string): string[] => (statSync(path).isDirectory() ? readdirSync(path).sort().flatMap((name) => files(join(path, name))) : [path]);
function fingerprint(): string {
  const hash = createHash("sha256");
  for (const path of SOURCES.flatMap(files)) hash.update(path.replaceAll("\\", "/")).update("\0").update(readFileSync(path)).update("\0");
  return hash.digest("hex");
}

// Plain names without hashes: the files are kept in the repository, and a rebuild is compared with them.
export default defineConfig({
  base: "/static/",
  publicDir: "public",
  plugins: [{ name: "fingerprint", generateBundle() { this.emitFile({ type: "asset", fileName: "built-from.txt", source: `${fingerprint()}\n` }); } }],
  build: {
    outDir: process.env.TWIN_PAGE_OUT ?? "../twin_daemon/web/static",
    emptyOutDir: true,
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    target: "es2022",
    chunkSizeWarningLimit: 1500,
    rollupOptions: {
      input: { workbench: "src/main.ts" },
      output: {
        entryFileNames: "[name].js",
        chunkFileNames: "[name].js",
        assetFileNames: "[name][extname]",
      },
    },
  },
});
