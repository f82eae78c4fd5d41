// Left: what one looks at - the live hand and the recordings - and its joints, the worst first.
import { facts, works } from "./api";
import { hear, known, refreshRecordings } from "./data";
import { drawn, icon, made, milli, put, short, size } from "./dom";
import { type Entry, fill } from "./list";
import { now, worstFirst } from "./live";
import { live, on, select, selection } from "./state";
import { progress, zone } from "./upload";
import refresh from "lucide-static/icons/refresh-cw.svg?raw";

const search = made("input", { type: "search", id: "source-search", placeholder: "Search, or a path", "aria-label": "Search recordings" });
const list = made("ul", { id: "sources", className: "list" }), told = made("p", { className: "soft tiny" });
const again = made("button", { type: "button", id: "again", className: "plain", title: "Look for new recordings" }, icon(refresh), made("span", { className: "hidden" }, "Look for new recordings"));
const joint = made("input", { type: "search", id: "joint-search", placeholder: "Search joints", "aria-label": "Search joints" });
const joints = made("ul", { id: "joint-list", className: "list joints" });
export const aside = made("aside", { id: "sidebar", "aria-label": "Sources and joints", tabIndex: -1 },
  facts.own ? made("section", {}, made("h2", {}, "Sources", again), search, list, told, zone, progress) : null,
  made("section", { className: "grow" }, made("h2", {}, "Joints, worst first", made("span", { className: "unit", title: "root mean square residual in mrad" }, "mrad")), joint, joints));

function sources(): void {
  const wanted = search.value.trim().toLowerCase(), path = (one: { folder: string; name: string }) => `${one.folder}/${one.name}`.toLowerCase();
  const found = known.recordings.filter((one) => path(one).includes(wanted));
  const item = (id: string, name: string, right: string, dot: string, title: string): Entry => ({
    id, title, pressed: selection.source === id, words: [made("span", { className: `lamp ${dot}` }), made("span", { className: "name" }, name), made("span", { className: "right" }, right)],
  });
  const rate = now.about?.rate_hz;
  fill(list, "data-source", [item("live", "live", rate ? `${rate.toFixed(0)} Hz` : "no data", rate ? "good" : "", "The live hand"),
    ...found.map((one) => item(one.id, one.name, size(one.bytes), selection.source === one.id && known.opened ? "good" : "", `${one.folder}/${one.name}, ${new Date(1e3 * one.modified_s).toLocaleString()}`))],
  (id) => select({ source: id, ...(id === "live" || selection.step === "data" || live() ? { step: "data" } : {}) }));
  const folders = [...new Set(known.recordings.map((one) => one.folder))];
  put(told, !known.recordings.length ? "No recording yet: drop one, or keep the last minutes."
    : !found.length ? `Nothing of that name. Only recordings named at the start, or in its folders, are offered${folders.length ? `: ${folders.slice(0, 2).join(", ")}` : ""}.` : "");
}

// A path that is offered opens by Enter; no other file does.
function typed(event: KeyboardEvent): void {
  if (event.key !== "Enter") return;
  const text = search.value.trim(), one = known.recordings.find((item) => `${item.folder}/${item.name}` === text || item.name === text) ?? known.recordings.find((item) => item.name.toLowerCase().includes(text.toLowerCase()));
  if (one) select({ source: one.id, step: "data" });
}

function spark(values: number[]): SVGElement {
  const far = Math.max(...values.map(Math.abs), 1e-9), step = 60 / Math.max(values.length - 1, 1);
  return drawn("svg", { viewBox: "0 0 60 16", class: "spark", preserveAspectRatio: "none", "aria-hidden": "true" },
    drawn("path", { d: values.map((value, at) => `${at ? "L" : "M"}${(at * step).toFixed(1)} ${(8 - (7 * (value ?? 0)) / far).toFixed(1)}`).join("") }));
}

const sparks = new Map<string, number[]>(); // of the live hand: its rms, once a second

function remembered(): void {
  facts.joints.forEach((name, index) => {
    const values = sparks.get(name) ?? [];
    values.push(1e3 * (now.rms[index] ?? 0));
    sparks.set(name, values.slice(-30));
  });
}

function ranked(): { name: string; rms: number | null; spark: number[] }[] {
  if (live()) return worstFirst().map((index) => ({ name: facts.joints[index], rms: now.rms[index], spark: sparks.get(facts.joints[index]) ?? [] }));
  const moving = known.overview?.joints.map((one) => ({ name: one.name, rms: one.rmse_rad, spark: one.spark })) ?? [];
  const still = (known.opened?.joints ?? []).filter((one) => !moving.some((other) => other.name === one.name)).map((one) => ({ name: one.name, rms: null, spark: [] as number[] }));
  return [...moving, ...still];
}

let due = false;
function showJoints(): void {
  if (due) return;
  due = true;
  requestAnimationFrame(() => {
    due = false;
    if (joints.contains(document.activeElement) && joints.matches(":hover")) return; // nothing moves under a pointer
    const wanted = joint.value.trim().toLowerCase(), all = ranked(), most = Math.max(...all.map((one) => one.rms ?? 0));
    fill(joints, "data-joint", all.filter((one) => one.name.toLowerCase().includes(wanted)).map((one) => ({
      id: one.name, title: one.name, pressed: selection.joint === one.name, className: one.rms !== null && one.rms === most && one.rms > 2e-3 ? "bad" : "",
      words: [made("span", { className: "name" }, short(one.name)), one.spark.length ? spark(one.spark) : made("span"), made("span", { className: "right" }, one.rms === null ? (live() ? "unknown" : "still") : milli(one.rms, 2))],
    })), (name, event) => select(event.shiftKey || event.ctrlKey ? { pinned: [...new Set([...selection.pinned, name])] } : { joint: name }));
  });
}

function arrows(event: KeyboardEvent): void {
  const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (!step) return;
  const all = [...(event.currentTarget as HTMLElement).querySelectorAll("button")], at = all.indexOf(document.activeElement as HTMLButtonElement);
  all[Math.max(0, Math.min(all.length - 1, at + step))]?.focus();
  event.preventDefault();
}

export function start(): void {
  search.addEventListener("input", sources);
  search.addEventListener("keydown", typed);
  joint.addEventListener("input", showJoints);
  for (const one of [list, joints]) one.addEventListener("keydown", arrows);
  works(again, refreshRecordings);
  hear(["recordings", "opened"], sources);
  on(["source"], sources);
  hear(["overview", "opened"], showJoints);
  on(["joint", "source"], showJoints);
  let shown = 0;
  addEventListener("about", () => {
    if (!selection.joint && now.rms.some((one) => one !== null)) select({ joint: facts.joints[worstFirst()[0]] });
    if (performance.now() - shown < 1000) return;
    shown = performance.now();
    remembered();
    sources();
    if (live()) showJoints();
  });
  sources();
  showJoints();
}
