// What the error depends on: the residual of the selected joint over position, velocity, load and time since a reversal.
import { asked, failed } from "./api";
import { about, effect, hear, known, mark, versionTitle } from "./data";
import { drawn, made, number, put, short } from "./dom";
import { live, on, onTheme, selection } from "./state";

interface Plot { name: string; unit: string; points: Record<string, [number[], number[]]>; curves: Record<string, Record<string, [number[], (number | null)[]]>> }
interface Found { pending?: boolean; curves_pending: boolean; joint: string; plots: Plot[] }
const WIDTH = 260, HEIGHT = 120, LOOKS = [["better", ""], ["soft", "6 4"], ["third", "2 3"]];
const AGAIN_MS = 1000;

const head = made("ul", { className: "key", "aria-label": "Key" }), grid = made("div", { className: "four" }), empty = made("p", { className: "empty" });
export const panel = made("div", { className: "panel dependence", tabIndex: 0, role: "region", "aria-label": "What the error depends on" }, head, empty, grid);
let wanted = 0, later = 0;

const named = (name: string) => {
  const [key, place] = name.split(":");
  return place ? `${effect(key)?.title ?? key}, ${short(place)}` : versionTitle(name);
};

async function show(): Promise<void> {
  const mine = ++wanted;
  clearTimeout(later);
  if (live() || !known.opened || !known.overview) { nothing(live() ? "Choose a recording: this is drawn from one." : "The twin is being rolled out ..."); return; }
  if (!known.overview.joints.some((one) => one.name === selection.joint)) { nothing(`${short(selection.joint)} does not move in this recording.`); return; }
  const parts = about({ joint: selection.joint });
  for (const id of selection.others) parts.append("against", id);
  const found = await asked<Found>(`/api/dependence?${parts}`, () => mine === wanted);
  if (!found) return;
  draw(found);
  if (found.curves_pending) later = window.setTimeout(() => { show().catch(failed); }, AGAIN_MS);
  mark("dependence", `${found.joint} ${found.curves_pending ? "pending" : "done"}`);
}

function nothing(words: string): void {
  put(empty, words);
  empty.hidden = false;
  grid.replaceChildren();
  head.replaceChildren();
}

function draw(found: Found): void {
  empty.hidden = true;
  const candidates = Object.keys(found.plots[0]?.curves ?? {});
  const item = (look: string, dash: string, text: string) => made("li", {}, made("i", { className: `line ${look}${dash ? " dashed" : ""}` }), text);
  head.replaceChildren(item("dot twin", "", "moving up"), item("dot accent", "", "moving down"),
    made("li", {}, `scale ±${number(reach(found), 2)} mrad`), ...candidates.map((name, place) => item(LOOKS[place % 3][0], LOOKS[place % 3][1], `${named(name)} predicts`)));
  const far = reach(found);
  grid.replaceChildren(...found.plots.map((plot, place) => one(plot, place, far, candidates)));
}

const reach = (found: Found) => Math.max(0.5, ...found.plots.flatMap((plot) => Object.values(plot.points).flatMap(([, y]) => spread(y))));

// All but the most extreme of the residuals are within it, so that one spike does not flatten the rest.
function spread(values: number[]): number[] {
  const sorted = values.map(Math.abs).sort((a, b) => a - b);
  return sorted.length ? [1.15 * sorted[Math.floor(0.99 * (sorted.length - 1))]] : [];
}

function one(plot: Plot, place: number, far: number, candidates: string[]): HTMLElement {
  const all = Object.values(plot.points).flatMap(([x]) => x);
  const low = Math.min(...all), high = Math.max(...all), span = high - low || 1;
  const x = (value: number) => 6 + ((WIDTH - 12) * (value - low)) / span, y = (value: number) => HEIGHT / 2 - ((HEIGHT / 2 - 6) * Math.max(-far, Math.min(far, value))) / far;
  const parts: Node[] = [drawn("line", { x1: 0, x2: WIDTH, y1: HEIGHT / 2, y2: HEIGHT / 2, class: "zero" })];
  for (const [name, [xs, ys]] of Object.entries(plot.points)) {
    // two directions in two colours and two shapes
    const path = xs.map((value, at) => (name === "moving up" ? `M${x(value).toFixed(1)} ${y(ys[at]).toFixed(1)}h0` : `M${(x(value) - 1.6).toFixed(1)} ${y(ys[at]).toFixed(1)}h3.2`)).join("");
    parts.push(drawn("path", { d: path, class: `points ${name === "moving up" ? "up" : "down"}` }));
  }
  candidates.forEach((name, index) => {
    for (const [xs, ys] of Object.values(plot.curves[name])) {
      let begun = false;
      const path = xs.map((value, at) => {
        if (ys[at] === null) { begun = false; return ""; }
        const letter = begun ? "L" : "M";
        begun = true;
        return `${letter}${x(value).toFixed(1)} ${y(ys[at]!).toFixed(1)}`;
      }).join("");
      if (path) parts.push(drawn("path", { d: path, class: `curve ${LOOKS[index % 3][0]}`, "stroke-dasharray": LOOKS[index % 3][1] }));
    }
  });
  const box = drawn("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", role: "img", "aria-label": `Residual over ${plot.name}, from -${number(far)} to ${number(far)} mrad` }, ...parts);
  const words = `${place === 0 ? "Residual over" : "over"} ${plot.name}`;
  return made("figure", {}, made("figcaption", {}, words), box,
    made("div", { className: "ends" }, made("span", {}, all.length ? number(low, 2) : ""), made("span", {}, `${plot.name} ${plot.unit}`), made("span", {}, all.length ? number(high, 2) : "")));
}

export function start(): void {
  const again = () => { show().catch(failed); };
  on(["joint", "version", "others", "source", "onset"], again);
  hear(["opened", "overview"], again);
  addEventListener("job-ended", again);
  onTheme(() => undefined);
  again();
}
