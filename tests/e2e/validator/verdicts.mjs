// Prints the findings of the Khronos glTF validator for each file as JSON: file, then pairs of code and
// JSON pointer ("@N" for a byte of a GLB). A file for which the validator fails has the value null.
//
//   node verdicts.mjs FILE...

import { readFile } from "node:fs/promises";
import { writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import validator from "gltf-validator";

async function verdict(file) {
  const load = async (uri) =>
    new Uint8Array(await readFile(join(dirname(file), decodeURIComponent(uri))));
  const options = { maxIssues: 0, writeTimestamp: false, externalResourceFunction: load };
  const report = await validator.validateBytes(new Uint8Array(await readFile(file)), options);
  return report.issues.messages.map((each) => [each.code, each.pointer ?? `@${each.offset}`]);
}

const out = {};
for (const file of process.argv.slice(2)) {
  out[file] = await verdict(file).catch(() => null);
}
writeFileSync(1, JSON.stringify(out));
