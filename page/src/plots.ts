// The panel of charts over time: the joint that is selected and those pinned beside it, live or of a recording.
import { asked, attempt, failed, facts, read, say, works } from "./api";
import { Chart, type Curve, type Line } from "./chart";
import { about, hear, known, mark, onsetPart, recording, shown, versionTitle } from "./data";
import { icon, made, milli, number, put } from "./dom";
import { at as interpolated } from "./moments";
import { Spectrum, type Found } from "./spectrum";
import { SHOWN_S, kept } from "./live";
import { live, on, onTheme, select, selection } from "./state";
import * as trial from "./trial";
import download from "lucide-static/icons/download.svg?raw";
import pin from "lucide-static/icons/pin-off.svg?raw";

const AGAIN_MS = 400, MOST = 6;
const charts = new Map<string, Chart>();
const spectra = new Map<string, Spectrum>();
let besides: Record<string, Curve> = {}, curves: Record<string, Curve> = {}, asking: AbortController | null = null, later = 0, drawnFor = "";

const reduced = made("output", { id: "reduced", className: "soft" }), cursorAt = made("output", { id: "cursor-at" }, "no time chosen");
const list = made("div", { id: "joined", className: "charts", tabIndex: 0, role: "group", "aria-label": "Charts over time: arrow keys move the cursor, plus and minus zoom, 0 shows all" });
const empty = made("p", { className: "empty" });

// What is drawn: a quantity, its derivative, below a frequency, over time or as a spectrum, beside something else.
const option = ([value, text]: [string, string]) => made("option", { value }, text);
const quantity = made("select", { id: "quantity" }, ...([["position", "position"], ["velocity", "velocity"], ["effort", "effort"]] as [string, string][]).map(option));
const derivative = made("input", { type: "checkbox", id: "derivative" }), lowpass = made("input", { type: "number", id: "lowpass", min: "0", step: "any", placeholder: "none" });
const view = made("select", { id: "view", "aria-label": "Over time, or as a spectrum" }, option(["time", "over time"]), option(["spectrum", "as a spectrum"])), beside = made("select", { id: "beside" });
const offset = made("input", { type: "number", id: "beside-offset", step: "any" }), lag = made("input", { type: "number", id: "plot-lag", step: "any" });
const align = made("button", { type: "button", id: "align", title: "Move the prediction to where its errors are smallest; every error on the page is that of the moved one" }, "Align");
const drawnNow = made("summary", {}, "Drawn: position over time"), controls = made("details", { className: "tuning", hidden: true }, drawnNow, made("p", { className: "controls" }, made("label", {}, "Draw ", quantity), made("label", {}, derivative, " derivative"), made("label", {}, "below ", lowpass, " Hz"), view,
  made("label", {}, "prediction later by ", lag, " ms"), align, made("label", {}, "beside ", beside), made("label", { id: "beside-moved" }, "moved by ", offset, " s")));

export const panel = made("div", { className: "panel plots" }, controls, empty, list,
  made("p", { className: "hint one-line", title: "Wheel zooms, a drag zooms to its box, Shift-drag pans, a double click shows all, a click sets the moment, Alt-click or m the second cursor" }, "Cursor: ", cursorAt, ". ", reduced));

const seconds = () => (live() ? kept.t[kept.t.length - 1] ?? 0 : known.opened?.seconds ?? 1);
const full = (): [number, number] => (live() ? [seconds() - SHOWN_S, seconds()] : [0, seconds()]);
const moves = {
  full,
  range: () => (live() ? full() : selection.range ?? full()),
  zoom: (range: [number, number] | null) => { if (!live()) select({ range }); },
  at: (at: number) => select({ at }),
  now: () => (live() ? null : selection.at),
  other: () => (live() ? null : selection.mark),
  mark: (at: number) => select({ mark: at }),
};
const shape = (): Record<string, string> => ({ quantity: selection.quantity, ...(selection.derivative ? { derivative: "1" } : {}), ...(Number(selection.lowpass) > 0 ? { lowpass_hz: selection.lowpass } : {}) });
const plain = () => selection.quantity === "position" && !selection.derivative && !Number(selection.lowpass);
const joints = () => [...new Set([selection.joint, ...selection.pinned])].filter((name) => facts.joints.includes(name) || curves[name]).slice(0, MOST);
const brief = (title: string) => (title.length > 32 ? `${title.slice(0, 31)}…` : title);
const lines = (): Line[] => (live() ? [{ id: "live", label: "predicted" }] : shown().map((id) => ({ id, label: `predicted by ${brief(versionTitle(id))}` })).concat(trial.line() ?? [], besideLine() ?? []));
const besideLine = (): Line | null => {
  if (!selection.beside || live()) return null;
  const name = selection.beside === "live" ? "the live hand" : recording(selection.beside)?.name;
  return name ? { id: "beside", label: `measured, ${brief(name)}`, look: "soft" } : null;
};

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
  const svg = made("button", { type: "button", className: "plain", title: `Save ${joint} as SVG` }, "SVG");
  works(svg, () => {
    const href = URL.createObjectURL(new Blob([charts.get(joint)!.svg()], { type: "image/svg+xml" }));
    save(`${joint}.svg`, href);
    setTimeout(() => URL.revokeObjectURL(href), 1000);
  });
  works(away, () => select({ pinned: selection.pinned.filter((name) => name !== joint) }));
  return [made("span", { className: "tools" }, csv, png, svg, joint === selection.joint ? null : away)];
}

function arrange(): void {
  const wanted = live() || known.opened ? joints() : [];
  controls.hidden = live() || !known.opened;
  panel.dataset.view = selection.view;
  const inFrequency = selection.view === "spectrum" && !live();
  for (const [name, one] of spectra) if (!inFrequency || !wanted.includes(name)) { one.close(); one.box.remove(); spectra.delete(name); }
  for (const [name, chart] of charts) if (inFrequency || !wanted.includes(name)) { chart.close(); chart.box.remove(); charts.delete(name); }
  for (const name of inFrequency ? wanted : []) {
    if (!spectra.has(name)) spectra.set(name, new Spectrum(name));
    list.append(spectra.get(name)!.box);
  }
  for (const name of inFrequency ? [] : wanted) {
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
  const [from, to] = moves.range(), parts = new URLSearchParams({ recording: selection.source, from: String(from), to: String(to), ...shape() });
  for (const [name, value] of onsetPart()) parts.append(name, value);
  for (const id of shown()) parts.append("version", id);
  if (selection.view === "spectrum") { await inFrequency(parts, request); return; }
  for (const name of joints()) parts.append("joint", name);
  const wanted = <T>(promise: Promise<T>) => promise.catch((error) => { if (request === asking) throw error; return undefined; });
  const [found, other] = await Promise.all([wanted(read(`/api/window?${parts}`, request.signal)), wanted(fetchedBeside(from, to, request.signal))]);
  if (!found || request !== asking) return;
  curves = found.curves;
  for (const curve of Object.values(curves)) curve.unit = found.unit;
  besides = other ?? {};
  paint();
  mark("curves", `${from} ${to}`);
  put(reduced, found.exact ? "Every sample is drawn." : `Reduced: of ${found.samples} samples each chart has the extremes of every stretch.`);
  if (found.pending.length) {
    put(reduced, `${reduced.textContent} The twin is being rolled out under the recorded commands ...`);
    later = window.setTimeout(() => { fetched().catch(failed); }, AGAIN_MS);
  } else mark("compared", shown().join(" "));
}

// The same joints of another recording, at the times that are moved to those of the view.
async function fetchedBeside(from: number, to: number, signal: AbortSignal): Promise<Record<string, Curve>> {
  if (!selection.beside || selection.beside === "live" || !recording(selection.beside)) return {};
  const moved = Number(selection.offset) || 0, parts = new URLSearchParams({ recording: selection.beside, from: String(from - moved), to: String(to - moved), version: selection.version, ...shape() });
  for (const name of joints()) parts.append("joint", name);
  const { curves: found } = await read<{ curves: Record<string, Curve> }>(`/api/window?${parts}`, signal);
  for (const curve of Object.values(found)) curve.t = curve.t.map((time) => time + moved);
  return found;
}

// The last seconds of the live hand begin where the view begins.
function withBeside(curve: Curve, name: string): Curve {
  if (!besideLine()) return curve;
  const moved = Number(selection.offset) || 0, first = kept.t[0] ?? 0, joint = facts.joints.indexOf(name);
  const other = selection.beside !== "live" ? besides[name] : plain() && joint >= 0 ? { t: kept.t.map((time) => time - first + moves.range()[0] + moved), measured: kept.measured[joint] } : null;
  return other ? { ...curve, twins: { ...curve.twins, beside: interpolated(curve.t, other.t, other.measured) } } : curve;
}

async function inFrequency(parts: URLSearchParams, request: AbortController): Promise<void> {
  const names = [...spectra.keys()];
  const found = await Promise.all(names.map((joint) => read<Found>(`/api/spectrum?${new URLSearchParams([...parts, ["joint", joint]])}`, request.signal)))
    .catch((error) => { if (request === asking) throw error; return null; });
  if (!found || request !== asking) return;
  found.forEach((one, place) => spectra.get(names[place])?.show(one, lines()));
  put(reduced, "The amplitude density of what the view shows, by Welch's method in segments of at most 8 s.");
  if (found.some((one) => one.pending.length)) later = window.setTimeout(() => { fetched().catch(failed); }, AGAIN_MS);
  else mark("spectra", names.join(" "));
}

function paint(fresh = false): void {
  const now = lines();
  for (const [name, chart] of charts) {
    const curve = live() ? liveCurve(name) : curves[name];
    if (curve) chart.show(live() ? curve : withBeside(trial.onto(curve, name), name), now, fresh);
  }
  mark("range", moves.range().join(" "));
}

function liveCurve(name: string): Curve {
  const joint = facts.joints.indexOf(name);
  return { t: kept.t.slice(), measured: kept.measured[joint], twins: { live: kept.predicted[joint] } };
}

function cursor(): void {
  const { at, mark: other } = selection, chart = charts.get(selection.joint);
  let text = at === null ? "no time chosen" : `${at.toFixed(4)} s`;
  if (at !== null && other !== null && chart) {
    const here = chart.near(at), there = chart.near(other), off = other - at, unit = curves[selection.joint]?.unit ?? "rad";
    const less = (one: number | null, two: number | null) => (one === null || two === null ? null : two - one);
    const moved = less(here.measured, there.measured), residual = less(here.residual, there.residual);
    text += `; second ${other.toFixed(4)} s: Δ ${off.toFixed(4)} s (${off ? number(1 / Math.abs(off)) : "∞"} Hz)`
      + `${moved === null ? "" : `, measured Δ ${moved.toFixed(4)} ${unit}`}${residual === null ? "" : `, residual Δ ${milli(residual / 1e3)} m${unit}`}`;
  }
  put(cursorAt, text);
  for (const one of charts.values()) one.redraw();
}

function keys(event: KeyboardEvent): void {
  if (event.ctrlKey || event.altKey || event.metaKey || live() || !known.opened) return;
  const [from, to] = moves.range(), span = to - from, step = span * (event.shiftKey ? 0.05 : 0.005), here = selection.at ?? (from + to) / 2;
  const end = seconds(), move = (at: number) => select({ at: Math.min(end, Math.max(0, at)) });
  const zoom = (half: number) => { const low = Math.max(0, here - half), high = Math.min(end, here + half); if (high > low) moves.zoom(high - low > end * 0.999 ? null : [low, high]); };
  const actions: Record<string, () => void> = {
    ArrowLeft: () => move(here - step), ArrowRight: () => move(here + step), "+": () => zoom(span / 4), "-": () => zoom(span),
    0: () => moves.zoom(null), Escape: () => select({ at: null, mark: null }),
    m: () => select({ mark: here }),
  };
  if (!Object.hasOwn(actions, event.key)) return;
  event.preventDefault();
  actions[event.key]();
}

function fillControls(): void {
  const { quantity: what, derivative: slope, lowpass: below, view: over, lag: late } = selection, next = known.recordings.find((one) => one.id === selection.beside);
  put(drawnNow, [`Drawn: ${what}${slope ? ", derivative" : ""}${Number(below) > 0 ? ` below ${below} Hz` : ""} ${over === "spectrum" ? "as a spectrum" : "over time"}`,
    Number(late) ? `prediction ${late} ms later` : "", selection.beside === "live" ? "beside the live hand" : next ? `beside ${next.name}` : ""].filter(Boolean).join(", "));
  quantity.value = selection.quantity;
  derivative.checked = selection.derivative === "1";
  view.value = selection.view;
  for (const [input, value] of [[lowpass, selection.lowpass], [offset, selection.offset], [lag, selection.lag]] as const) if (document.activeElement !== input) input.value = value;
  const options: [string, string][] = [["", "nothing"], ["live", "the live hand"], ...known.recordings.filter((one) => one.id !== selection.source).map((one): [string, string] => [one.id, one.name])];
  beside.replaceChildren(...options.map(option));
  beside.value = options.some(([id]) => id === selection.beside) ? selection.beside : "";
  document.getElementById("beside-moved")?.toggleAttribute("hidden", !beside.value);
}

function wireControls(): void {
  quantity.addEventListener("change", () => select({ quantity: quantity.value }));
  derivative.addEventListener("change", () => select({ derivative: derivative.checked ? "1" : "" }));
  lowpass.addEventListener("change", () => select({ lowpass: Number(lowpass.value) > 0 ? lowpass.value : "" }));
  view.addEventListener("change", () => select({ view: view.value }));
  beside.addEventListener("change", () => select({ beside: beside.value }));
  offset.addEventListener("change", () => select({ offset: offset.value || "0" }));
  lag.addEventListener("change", () => select({ lag: lag.value || "0" }));
  works(align, async () => {
    const source = selection.source, parts = about();
    parts.delete("lag_ms");
    const found = await asked<{ pending?: boolean; lag_ms: number }>(`/api/align?${parts}`, () => selection.source === source);
    if (!found) return;
    select({ lag: String(found.lag_ms) });
    say(`The prediction is ${found.lag_ms} ms later now; every error on the page is that of the moved one.`, "note");
  });
  on(["quantity", "derivative", "lowpass", "view", "beside", "offset", "lag", "source"], fillControls);
  hear(["recordings"], fillControls);
  fillControls();
}

export function start(): void {
  wireControls();
  list.addEventListener("keydown", keys);
  const anew = () => { arrange(); attempt(fetched); };
  hear(["opened"], () => { curves = {}; anew(); });
  on(["joint", "pinned", "version", "others", "lag", "source", "quantity", "derivative", "lowpass", "view", "beside", "offset"], anew);
  hear(["versions"], () => paint());
  addEventListener("trial", () => paint());
  on(["range"], () => { paint(); fetched().catch(failed); });
  on(["at", "mark", "joint"], cursor);
  onTheme(() => paint(true));
  let due = false;
  addEventListener("samples", () => {
    if (!live() && selection.beside !== "live" || due || !panel.isConnected || panel.offsetParent === null) return;
    due = true;
    requestAnimationFrame(() => {
      due = false;
      if (live() && drawnFor !== selection.joint) { drawnFor = selection.joint; arrange(); }
      paint();
    });
  });
  arrange();
}
