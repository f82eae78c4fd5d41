// Recordings and versions to choose from, the same in every view; whoever changes them says so with an event.
import { element, made, read, say } from "./page.js";

export const known = { recordings: [], versions: [], aliases: {}, problems: [], parameters: [] };
const size = (bytes) => (bytes > 1e6 ? `${(bytes / 1e6).toFixed(1)} MB` : `${Math.ceil(bytes / 1e3)} kB`);

function fill(select, options) {
  const before = select.value;
  select.replaceChildren(...options.map(([value, text]) => made("option", { value }, text)));
  if (options.some(([value]) => value === before)) select.value = before;
}

// Every name that points at a version; a name that is the id says nothing more.
export const named = (version) => version.names.filter((name) => name !== version.id).join(", ");

export const versionText = (version) => [version.id.slice(0, 12), (version.title || version.kind).slice(0, 60), named(version) && `(${named(version)})`].filter(Boolean).join(" ");

async function recordings() {
  known.recordings = (await read("/api/recordings")).recordings;
  const options = known.recordings.map((one) => [one.id, `${one.name}, ${size(one.bytes)}, ${new Date(1e3 * one.modified_s).toLocaleString()}`]);
  fill(element("learn-holdout"), [["", "every third stretch of the recording"], ...options]);
  for (const id of ["recording", "learn-recording"])
    fill(element(id), options.length ? [["", "choose one"], ...options] : [["", "none yet: keep the last minutes, or start with --recording"]]);
}

async function versions() {
  Object.assign(known, await read("/api/versions"));
  const all = known.versions.map((one) => [one.id, versionText(one)]);
  const fresh = element("version-a").options.length === 0;
  for (const id of ["version-a", "learn-version", "diff-before", "diff-after"]) fill(element(id), all);
  fill(element("version-b"), [["", "no other"], ...all]);
  if (fresh) for (const id of ["version-a", "learn-version"]) element(id).value = known.aliases.current;
  dispatchEvent(new Event("versions-listed"));
}

export const refresh = async () => { await Promise.all([recordings(), versions()]); };

export function start() {
  addEventListener("recordings", () => recordings().catch((error) => say(error.message)));
  addEventListener("versions", () => versions().catch((error) => say(error.message)));
  return refresh().catch((error) => say(error.message));
}
