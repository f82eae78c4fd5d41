// What the server knows, and what of it is open now. Whoever changes something says so by name; panels listen.
import { asked, attempt, facts, failed, read } from "./api";
import { on, select, selection } from "./state";

export interface Recording { id: string; name: string; folder: string; bytes: number; modified_s: number }
export interface Version {
  id: string; kind: string; title: string | null; created: string | null; parent: string | null; effects: string[]; names: string[];
  depth: number; shipped: boolean; worse: string | null; fitted_on: string[];
  note: string; notes: { at: string; text: string }[];
  errors: Record<"before" | "after" | "holdout_before" | "holdout_after", number | null>;
}
export interface Decision { at: string; what: string; version: string | null; name: string | null; text: string | null; by?: string | null }
export interface Opened {
  name: string; begin_s: number; samples: number; seconds: number; rate_hz: number; commands_recorded: boolean; notes: string[];
  joints: { name: string; moves: boolean }[];
}
export interface JointError { mse_rad2: number; rmse_rad: number; max_abs_rad: number; bias_rad: number; lag_s: number | null; noise_rad2: number }
export interface Condition { joint: string; condition: string; rmse_rad: number; bias_rad: number; times_average: number; seconds: number; worst_s: number }
export interface Errors {
  pending?: boolean; version: string; mse_rad2: number | null; noise_floor_rad2: number; onset_s: number; onset_estimated: boolean;
  joints: Record<string, JointError>; conditions: Condition[]; condition_names: string[];
}
export interface Overview {
  pending?: boolean; seconds: number; joints: { name: string; rmse_rad: number; spark: number[] }[]; rms_mrad: number[];
  worst: { joint: string; condition: string; time_s: number }[];
}
export interface Story { what: string; shows: string; cause: string; remedy: string; excitation: string }
export interface Effect { key: string; title: string; acts_on: string; story: Story }

export const known = {
  recordings: [] as Recording[], versions: [] as Version[], aliases: {} as Record<string, string>, problems: [] as string[], parameters: [] as string[], decisions: [] as Decision[],
  effects: [] as Effect[], places: [] as string[],
  opened: null as Opened | null, opening: "", errors: new Map<string, Errors>(), overview: null as Overview | null,
};

const NEWS = ["recordings", "versions", "effects", "opened", "errors", "overview"] as const;
export type News = (typeof NEWS)[number];
export const hear = (names: News[], act: () => void) => { for (const name of names) addEventListener(name, act); };
const tell = (name: News) => { dispatchEvent(new Event(name)); };
export const mark = (name: string, value: string) => { document.documentElement.dataset[name] = value; };

export const recording = (id = selection.source) => known.recordings.find((one) => one.id === id);
export const version = (id = selection.version) => known.versions.find((one) => one.id === id);
export const effect = (key: string) => known.effects.find((one) => one.key === key);
// Every name that points at a version; a name that is the id says nothing more.
export const named = (one: Version) => one.names.filter((name) => name !== one.id).join(", ");
export const versionTitle = (id: string): string => {
  const one = version(id);
  if (!one || id === "nominal") return id.slice(0, 12);
  return (one.title || one.kind).slice(0, 60);
};
export const shown = () => [...new Set([selection.version, ...selection.others])].filter(Boolean).slice(0, 3);
const onset = (): Record<string, string> => ({ ...(selection.onset ? { onset_s: selection.onset } : {}), ...(Number(selection.lag) ? { lag_ms: selection.lag } : {}) });
export const about = (more: Record<string, string | number> = {}, id = selection.version) => {
  const parts: Record<string, string> = { recording: selection.source, version: id, ...onset() };
  for (const [name, value] of Object.entries(more)) parts[name] = String(value);
  return new URLSearchParams(parts);
};
export const onsetPart = () => Object.entries(onset());

export async function refreshRecordings(): Promise<void> {
  known.recordings = (await read("/api/recordings")).recordings;
  tell("recordings");
}

export async function refreshVersions(): Promise<void> {
  const found = await read("/api/versions");
  Object.assign(known, { versions: found.versions, aliases: found.aliases, problems: found.problems, parameters: found.parameters, decisions: found.decisions });
  const there = (id: string) => known.versions.some((one) => one.id === id);
  select({ version: there(selection.version) ? selection.version : known.aliases.current, others: selection.others.filter(there) });
  tell("versions");
}

async function effects(): Promise<void> {
  const found = await read("/api/effects");
  Object.assign(known, found);
  tell("effects");
}

// -- the recording that is open

let generation = 0, worstOf = selection.joint ? selection.source : ""; // the source whose worst joint was shown last
const mine = () => { const number = ++generation; return () => number === generation; };

async function open(): Promise<void> {
  const wanted = mine(), began = performance.now();
  Object.assign(known, { opened: null, overview: null });
  known.errors.clear();
  if (selection.source === "live") worstOf = "live";
  known.opening = selection.source === "live" ? "" : "Reading the recording ...";
  for (const name of ["opened", "errors", "overview"] as const) tell(name);
  if (selection.source === "live" || !selection.version) return;
  try {
    const found = await read<Opened>(`/api/recording?${about()}`);
    if (!wanted()) return;
    known.opened = found;
  } catch (error) {
    if (wanted()) { known.opening = (error as Error).message; tell("opened"); }
    throw error;
  }
  const { opened } = known;
  const moving = opened!.joints.filter((one) => one.moves).length;
  known.opening = `${opened!.name}: ${opened!.seconds.toFixed(1)} s, ${opened!.samples} samples at ${+opened!.rate_hz.toPrecision(4)} Hz, `
    + `${moving === 1 ? "1 joint moves" : `${moving} joints move`}. Shown after ${((performance.now() - began) / 1e3).toFixed(1)} s.`;
  // until it is known which joint is the worst, which may take a roll-out of the twin
  const named = opened!.joints.find((one) => one.name === selection.joint);
  if (worstOf !== selection.source && !named?.moves) select({ joint: opened!.joints.find((one) => one.moves)?.name ?? selection.joint });
  mark("opened", selection.source);
  tell("opened");
  await judge(wanted);
}

async function judge(wanted: () => boolean): Promise<void> {
  const first = selection.version;
  const overview = await asked<Overview>(`/api/overview?${about()}`, wanted);
  if (!overview) return;
  known.overview = overview;
  const names = overview.joints.map((one) => one.name);
  if (worstOf !== selection.source || !facts.joints.includes(selection.joint)) select({ joint: names[0] ?? selection.joint });
  worstOf = selection.source;
  tell("overview");
  for (const id of shown()) {
    const found = await asked<Errors>(`/api/errors?${about({}, id)}`, wanted);
    if (!found) return;
    known.errors.set(id, found);
    tell("errors");
  }
  mark("judged", `${selection.source} ${first}`);
}

export const moment = (joint: string, at: number) => {
  const end = known.opened?.seconds ?? at + 2, width = Math.min(end, 4), from = Math.max(0, Math.min(at - width / 2, end - width));
  select({ joint, at, range: [from, from + width] });
};

// The errors of one recording under one version, whichever is open.
export const errorsOf = (source: string, id: string, wanted: () => boolean = () => true) =>
  asked<Errors>(`/api/errors?${new URLSearchParams({ recording: source, version: id })}`, wanted);

export function start(): Promise<unknown> {
  on(["source"], () => select({ onset: "", at: null, mark: null, lag: "0", range: null, pinned: [], beside: "", offset: "0" }));
  on(["source", "onset"], () => { attempt(open); });
  on(["version", "others", "lag"], () => { if (known.opened) attempt(() => judge(mine())); });
  addEventListener("recordings-changed", () => { refreshRecordings().catch(failed); });
  addEventListener("versions-changed", () => { refreshVersions().catch(failed); });
  if (!facts.own) return Promise.resolve();
  const first = Promise.all([refreshRecordings(), refreshVersions(), effects()]);
  return first.then(() => { if (selection.source !== "live") return attempt(open); return undefined; }).catch(failed);
}
