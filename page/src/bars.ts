// Bars that stand for numbers: shares, intervals, and errors that fall.
import { drawn, made, milli, number } from "./dom";

// Widths are attributes of drawings: the page's policy lets no style into its markup.
// The number beside it says what it stands for.
export function bar(share: number, look = "good"): SVGElement {
  const width = Math.max(0, Math.min(1, share)) * 100;
  return drawn("svg", { viewBox: "0 0 100 10", preserveAspectRatio: "none", class: "bar", "aria-hidden": "true" },
    drawn("rect", { x: 0, y: 0, width: 100, height: 10, rx: 2, class: "rail" }), drawn("rect", { x: 0, y: 0, width: Math.max(width, 0.8), height: 10, rx: 2, class: look }));
}

// A value within its bounds, with its 95 % interval.
export function interval(value: number, ci95: [number, number] | null | undefined, lower: number | null | undefined, upper: number | null | undefined): SVGElement {
  const [low, high] = ci95 ?? [value, value], first = lower ?? Math.min(0, 2 * low), last = upper ?? Math.max(2 * high, first + 1e-9);
  // what is far from its bounds is shown around itself, so that the interval is to be seen
  const [from, to] = high - low < 0.01 * (last - first) ? [Math.max(first, value - 10 * Math.max(high - low, 1e-12)), Math.min(last, value + 10 * Math.max(high - low, 1e-12))] : [first, last];
  const at = (one: number) => 100 * Math.max(0, Math.min(1, (one - from) / (to - from || 1)));
  return drawn("svg", { viewBox: "0 0 100 10", preserveAspectRatio: "none", class: "bar", role: "img", "aria-label": `${number(value)}, 95 % from ${number(low)} to ${number(high)}` },
    drawn("rect", { x: 0, y: 1, width: 100, height: 8, rx: 2, class: "rail" }),
    drawn("rect", { x: at(low), y: 1, width: Math.max(at(high) - at(low), 1.5), height: 8, rx: 2, class: "good" }),
    drawn("rect", { x: Math.max(0, at(value) - 0.5), y: 0, width: 1, height: 10, class: "ink" }));
}

export interface Fall { name: string; before: number | null; after: number; look: string; words?: string }

// Errors (rad rms) that fall from row to row; each bar ends where the last one began.
export function waterfall(rows: Fall[]): HTMLElement {
  const most = Math.max(...rows.map((one) => Math.max(one.before ?? 0, one.after)), 1e-9);
  return made("table", { className: "fall" }, made("caption", { className: "hidden" }, "Error on held-out motion, mrad rms"), made("tbody", {}, ...rows.map((one) => {
    const low = one.before === null ? 0 : Math.min(one.before, one.after), high = one.before === null ? one.after : Math.max(one.before, one.after);
    const at = (value: number) => (100 * value) / most;
    const drawing = drawn("svg", { viewBox: "0 0 100 12", preserveAspectRatio: "none", class: "bar tall", "aria-hidden": "true" },
      drawn("rect", { x: at(low), y: 0, width: Math.max(at(high) - at(low), 0.8), height: 12, rx: 1.5, class: one.look }));
    const value = one.before === null ? `${milli(one.after)}` : `${one.after > one.before ? "+" : "−"}${milli(Math.abs(one.after - one.before))}`;
    return made("tr", {}, made("th", { scope: "row" }, one.name), made("td", {}, drawing), made("td", { className: "n" }, one.words ?? value));
  })));
}
