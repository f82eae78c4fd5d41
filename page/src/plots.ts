// The panel of charts over time: the joint that is selected and those pinned beside it, live or of a recording.
import { attempt, failed, facts, read, works } from "./api";
import { Chart, type Curve, type Line } from "./chart";
import { hear, known, mark, onsetPart, recording, shown, versionTitle } from "./data";
import { icon, made, put } from "./dom";
import { SHOWN_S, kept } from "./live";
import { live, on, onTheme, select, selection } from "./state";
import * as trial from "./trial";
import download from "lucide-static/icons/download.svg?raw";
import pin from "lucide-static/icons/pin-off.svg?raw";

const AGAIN_MS = 400, MOST = 6;
const charts = new Map<string, Chart>();
let curves: Record<string, Curve> = {}, asking: AbortController | null = null, later = 0, drawnFor = "";

const reduced = made("output", { id: "reduced", className: "soft" }), cursorAt = made("output", { id: "cursor-at" }, "no time chosen");
const list = made("div", { id: "joined", className: "charts", tabIndex: 0, role: "group", "aria-label": "Charts over time: arrow keys move the cursor, plus and minus zoom, 0 shows all" });
const empty = made("p", { className: "empty" });
export const panel = made("div", { className: "panel plots" }, empty, list,
  made("p", { className: "hint one-line", title: "Wheel zooms, a drag zooms to its box, Shift-drag pans, a double click shows all, a click sets the moment" }, "Cursor: ", cursorAt, ". ", reduced));

const seconds = () => (live() ? kept.t[kept.t.length - 1] ?? 0 : known.opened?.seconds ?? 1);
const full = (): [number, number] => (live() ? [seconds() - SHOWN_S, seconds()] : [0, seconds()]);
const moves = {
  full,
  range: () => (live() ? full() : selection.range ?? full()),
  zoom: (range: [number, number] | null) => { if (!live()) select({ range }); },
  at: (at: number) => select({ at }),
  now: () => (live() ? null : selection.at),
};
const joints = () => [...new Set([selection.joint, ...selection.pinned])].filter((name) => facts.joints.includes(name) || curves[name]).slice(0, MOST);
const brief = (title: string) => (title.length > 32 ? `${title.slice(0, 31)}…` : title);
const lines = (): Line[] => (live() ? [{ id: "live", label: "predicted" }] : shown().map((id) => ({ id, label: `predicted by ${brief(versionTitle(id))}` })).concat(trial.line() ?? []));

function save(name: string, href: string): void {
  made("a", { href, download: name }).click();
}

function tools(joint: string): Node[] {
  const csv = made("button", { type: "button", className: "plain", title: `Save ${joint} as CSV` }, icon(download), "CSV");
  const png = made("button", { type: "button", className: "plain", title: `Save ${joint} as PNG` }, "PNG");
  const away = made("button", { type: "button", className: "plain", title: `Take ${joint} off`, "aria-label": `Take the chart of ${joint} off` }, icon(pin));
  works(csv, () => {
    const href = URL.createObjectURL(new Blob([charts.get(joint)!.csv()], { type: "text/csv" }));
    save(`${joint}.csv`, href);
    setTimeout(() => URL.revokeObjectURL(href), 1000);
  });
  works(png, () => save(`${joint}.png`, charts.get(joint)!.picture()));
  works(away, () => select({ pinned: selection.pinned.filter((name) => name !== joint) }));
  return [made("span", { className: "tools" }, csv, png, joint === selection.joint ? null : away)];
}

function arrange(): void {
  const wanted = live() || known.opened ? joints() : [];
  for (const [name, chart] of charts) if (!wanted.includes(name)) { chart.close(); chart.box.remove(); charts.delete(name); }
  for (const name of wanted) {
    if (!charts.has(name)) charts.set(name, new Chart(name, moves, tools(name)));
    list.append(charts.get(name)!.box);
  }
  list.dataset.count = String(wanted.length);
  empty.hidden = wanted.length > 0;
  put(empty, live() ? "Choose a joint on the left to see it over time." : known.opening || "Choose a recording on the left, or drop one anywhere.");
}

// The range on the screen, asked for anew at each zoom: every sample where they are few enough. The newest request
// is the one that counts; one that it overtook ends quietly.
async function fetched(): Promise<void> {
  clearTimeout(later);
  asking?.abort();
  if (live() || !known.opened || !selection.version || !recording()) return;
  const request = new AbortController();
  asking = request;
  const [from, to] = moves.range(), parts = new URLSearchParams({ recording: selection.source, from: String(from), to: String(to), lag_ms: selection.lag || "0" });
  for (const [name, value] of onsetPart()) parts.append(name, value);
  for (const id of shown()) parts.append("version", id);
  for (const name of joints()) parts.append("joint", name);
  const found = await read(`/api/window?${parts}`, request.signal).catch((error) => { if (request === asking) throw error; });
  if (!found || request !== asking) return;
  curves = found.curves;
  paint();
  put(reduced, found.exact ? "Every sample is drawn." : `Reduced: of ${found.samples} samples each chart has the extremes of every stretch.`);
  if (found.pending.length) {
    put(reduced, `${reduced.textContent} The twin is being rolled out under the recorded commands ...`);
    later = window.setTimeout(() => { fetched().catch(failed); }, AGAIN_MS);
  } else mark("compared", shown().join(" "));
}

function paint(fresh = false): void {
  const now = lines();
  for (const [name, chart] of charts) {
    const curve = live() ? liveCurve(name) : curves[name];
    if (curve) chart.show(trial.onto(curve, name), now, fresh);
  }
  mark("range", moves.range().join(" "));
}

function liveCurve(name: string): Curve {
  const joint = facts.joints.indexOf(name);
  return { t: kept.t.slice(), measured: kept.measured[joint], twins: { live: kept.predicted[joint] } };
}

function cursor(): void {
  put(cursorAt, selection.at === null ? "no time chosen" : `${selection.at.toFixed(4)} s`);
  for (const chart of charts.values()) chart.redraw();
}

function keys(event: KeyboardEvent): void {
  if (event.ctrlKey || event.altKey || event.metaKey || live() || !known.opened) return;
  const [from, to] = moves.range(), span = to - from, step = span * (event.shiftKey ? 0.05 : 0.005), here = selection.at ?? (from + to) / 2;
  const end = seconds(), move = (at: number) => select({ at: Math.min(end, Math.max(0, at)) });
  const zoom = (half: number) => { const low = Math.max(0, here - half), high = Math.min(end, here + half); if (high > low) moves.zoom(high - low > end * 0.999 ? null : [low, high]); };
  const actions: Record<string, () => void> = {
    ArrowLeft: () => move(here - step), ArrowRight: () => move(here + step), "+": () => zoom(span / 4), "-": () => zoom(span),
    0: () => moves.zoom(null), Escape: () => select({ at: null }),
  };
  if (!Object.hasOwn(actions, event.key)) return;
  event.preventDefault();
  actions[event.key]();
}

export function start(): void {
  list.addEventListener("keydown", keys);
  const anew = () => { arrange(); attempt(fetched); };
  hear(["opened"], () => { curves = {}; anew(); });
  on(["joint", "pinned", "version", "others", "lag", "source"], anew);
  hear(["versions"], () => paint());
  addEventListener("trial", () => paint());
  on(["range"], () => { paint(); fetched().catch(failed); });
  on(["at"], cursor);
  onTheme(() => paint(true));
  let due = false;
  addEventListener("samples", () => {
    if (!live() || due || !panel.isConnected || panel.offsetParent === null) return;
    due = true;
    requestAnimationFrame(() => {
      due = false;
      if (!live()) return;
      if (drawnFor !== selection.joint) { drawnFor = selection.joint; arrange(); }
      paint();
    });
  });
  arrange();
}
