// Bundles the page into the folder given as the first argument.
import { build } from "esbuild";
import { copyFile, mkdir } from "node:fs/promises";
import { join } from "node:path";

const target = process.argv[2] ?? "../src/burnish/app/static";
await mkdir(target, { recursive: true });
await build({
  entryPoints: ["src/main.tsx", "src/socket.ts", "src/style.css"],
  outdir: target,
  bundle: true,
  minify: true,
  sourcemap: false,
  format: "esm",
  target: "es2022",
  jsx: "automatic",
  jsxImportSource: "preact",
  legalComments: "linked",
  logLevel: "warning",
});
for (const name of ["index.html", "icon.svg"]) {
  await copyFile(join("src", name), join(target, name));
}
