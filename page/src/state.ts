// The one selection that every panel follows: kept in the address, so that a link or a reload shows the same.
export interface Selection {
  source: string; // "live", or the id of a recording
  holdout: string;
  version: string; // the one that is looked at and worked on
  others: string[]; // further ones to compare with
  joint: string;
  pinned: string[]; // further joints with a chart
  at: number | null; // s
  range: [number, number] | null; // s; null is all
  step: string;
  onset: string;
  lag: string; // ms
  mark: number | null; // s: the second cursor
  quantity: string; // what is drawn of a joint: position, velocity, effort
  derivative: string; // "1": its derivative
  lowpass: string; // Hz
  view: string; // over time, or the spectrum
  beside: string; // "live" or a recording whose measurement is drawn as well
  offset: string; // s by which that is moved
}

export const STEPS = ["data", "check", "compare", "diagnose", "add", "validate", "promote"] as const;
const SHORT: Record<keyof Selection, string> = {
  source: "s", holdout: "h", version: "v", others: "o", joint: "j", pinned: "p", at: "t", range: "r", step: "step", onset: "onset", lag: "lag", mark: "m",
  quantity: "q", derivative: "d", lowpass: "f", view: "w", beside: "b", offset: "bo",
};
const START: Selection = {
  source: "live", holdout: "", version: "", others: [], joint: "", pinned: [], at: null, range: null, step: "data", onset: "", lag: "0", mark: null,
  quantity: "position", derivative: "", lowpass: "", view: "time", beside: "", offset: "0",
};

export const selection: Selection = { ...START, ...fromAddress() };
type Key = keyof Selection;
const heard: [Set<Key>, () => void][] = [];
let changed = new Set<Key>();
let writing = 0;

export function on(keys: Key[], act: () => void): void { heard.push([new Set(keys), act]); }

export function select(patch: Partial<Selection>): void {
  for (const [key, value] of Object.entries(patch) as [Key, unknown][]) {
    if (JSON.stringify(selection[key]) === JSON.stringify(value)) continue;
    (selection as unknown as Record<string, unknown>)[key] = value;
    changed.add(key);
  }
  if (!changed.size) return;
  const now = changed;
  changed = new Set();
  for (const [keys, act] of heard) if ([...keys].some((key) => now.has(key))) act();
  clearTimeout(writing);
  writing = window.setTimeout(write, 150);
}

function write(): void {
  history.replaceState(null, "", location.pathname + location.search + address());
}

export function address(more: Record<string, string> = {}): string {
  const parts = new URLSearchParams();
  for (const [key, name] of Object.entries(SHORT) as [Key, string][]) {
    const value = selection[key], start = START[key];
    if (JSON.stringify(value) === JSON.stringify(start)) continue;
    parts.set(name, Array.isArray(value) ? value.map((one) => (typeof one === "number" ? one.toFixed(4) : one)).join(",") : String(value));
  }
  for (const [name, value] of Object.entries(more)) parts.set(name, value);
  const text = parts.toString();
  return text ? `#${text}` : "";
}

function fromAddress(): Partial<Selection> {
  const parts = new URLSearchParams(location.hash.slice(1)), found: Record<string, unknown> = {};
  for (const [key, name] of Object.entries(SHORT) as [Key, string][]) {
    const text = parts.get(name);
    if (text === null) continue;
    if (key === "others" || key === "pinned") found[key] = text.split(",").filter(Boolean);
    else if (key === "at" || key === "mark") found[key] = Number.isFinite(Number(text)) ? Number(text) : null;
    else if (key === "range") {
      const ends = text.split(",").map(Number);
      if (ends.length === 2 && ends.every(Number.isFinite) && ends[1] > ends[0]) found[key] = ends;
    } else if (key !== "step" || (STEPS as readonly string[]).includes(text)) found[key] = text;
  }
  return found;
}

export const inAddress = (name: string) => new URLSearchParams(location.hash.slice(1)).get(name);
export const live = () => selection.source === "live";

// -- light and dark

export type Theme = "system" | "light" | "dark";
const dark = matchMedia("(prefers-color-scheme: dark)");
const themed: (() => void)[] = [];
export const onTheme = (act: () => void) => { themed.push(act); };
export const isDark = () => document.documentElement.dataset.theme === "dark";
export const theme = (): Theme => (localStorage.getItem("twin-theme") as Theme | null) ?? "system";
export function setTheme(name: Theme): void {
  localStorage.setItem("twin-theme", name);
  showTheme();
}
export function showTheme(): void {
  const name = theme(), now = name === "system" ? (dark.matches ? "dark" : "light") : name;
  if (document.documentElement.dataset.theme === now) return;
  document.documentElement.dataset.theme = now;
  for (const act of themed) act();
}
dark.addEventListener("change", showTheme);
export const colour = (name: string) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
