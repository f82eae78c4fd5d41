// An effect by hand: sliders for its values, and the prediction of one finger that follows them.
import { allowed, asked, attempt, facts, needsAuthorization, read, works } from "./api";
import type { Curve } from "./chart";
import { about, hear, known, mark, recording } from "./data";
import { made, milli, number, put, withUnit } from "./dom";
import { begin } from "./jobs";
import { at } from "./moments";
import { live, on, select, selection } from "./state";

interface Value { name: string; unit: string; meaning: string; log: boolean; neutral: number; lower: number; upper: number; value: number }
interface Predicted { pending?: boolean; t: number[]; curves: Record<string, (number | null)[]>; from: number; to: number; rmse_rad: number | null; without_rmse_rad: number | null; server_s: number }

const STEPS = 1000, CUBED = 3; // small values are told apart best: the way along a slider counts to the third power
const words = made("p", { id: "trial-words", role: "status" }), rows = made("div", { className: "sliders" }), command = made("code", { id: "trial-command" });
const keep = needsAuthorization(made("button", { type: "button", id: "add-values" }, "Add with these values")), off = made("button", { type: "button", id: "trial-off" }, "Take it off the charts");
export const box = made("section", { id: "trial", hidden: true }, made("h3", {}, "By hand"), words, rows, made("p", { className: "controls" }, keep, off), command);

let effect = "", place = "", values: Value[] = [], found: Predicted | null = null, busy = false, waiting = false, since = 0;
const waits: number[] = [];

const shownJoint = () => (facts.joints.includes(place) ? place : selection.joint);
export const line = () => (found && !live() ? { id: "trial", label: `${effect.replaceAll("_", " ")} by hand`, look: "accent" } : null);

// The finger's prediction at the times of a chart's curve; nothing where it was not predicted.
export function onto(curve: Curve, joint: string): Curve {
  const own = found?.curves[joint];
  if (!found || !own || (curve.unit ?? "rad") !== "rad" || selection.lowpass) return curve; // it is predicted as it is
  const twins = { ...curve.twins, trial: at(curve.t, found.t, own) };
  return { ...curve, twins };
}

const far = (one: Value) => Math.max(Math.abs(one.lower), Math.abs(one.upper));
function valueAt(one: Value, step: number): number {
  const share = step / STEPS, least = Math.max(one.lower, 1e-4 * one.upper);
  if (one.log && one.upper > 0 && one.lower >= 0) return step === 0 ? one.lower : least * (one.upper / least) ** share;
  if (one.lower < 0) return Math.min(one.upper, Math.max(one.lower, far(one) * Math.sign(share) * Math.abs(share) ** CUBED));
  return one.lower + (one.upper - one.lower) * share ** CUBED;
}
function stepOf(one: Value): number {
  const least = Math.max(one.lower, 1e-4 * one.upper);
  if (one.log && one.upper > 0 && one.lower >= 0) return one.value <= least ? 0 : STEPS * Math.log(one.value / least) / Math.log(one.upper / least);
  if (one.lower < 0) return STEPS * Math.sign(one.value) * Math.cbrt(Math.abs(one.value) / far(one));
  return STEPS * Math.cbrt((one.value - one.lower) / (one.upper - one.lower || 1));
}

function slider(one: Value): HTMLElement {
  const id = `slider-${one.name}`, exact = made("input", { type: "number", step: "any", "aria-label": withUnit(one.name, one.unit) });
  const range = made("input", { type: "range", id, min: String(one.lower < 0 ? -STEPS : 0), max: String(STEPS), step: "1", title: one.meaning });
  const told = () => { exact.value = String(+one.value.toPrecision(4)); range.setAttribute("aria-valuetext", withUnit(number(one.value), one.unit)); };
  range.value = String(Math.round(stepOf(one)));
  told();
  range.addEventListener("input", () => { one.value = valueAt(one, Number(range.value)); told(); moved(); });
  exact.addEventListener("change", () => {
    const wanted = Number(exact.value);
    if (exact.value === "" || !Number.isFinite(wanted)) { told(); return; }
    one.value = Math.min(one.upper, Math.max(one.lower, wanted));
    range.value = String(Math.round(stepOf(one)));
    told();
    moved();
  });
  return made("div", { className: "slider" }, made("label", { for: id }, one.name.replaceAll("_", " ")), range, made("span", {}, exact, withUnit("", one.unit)));
}

function moved(): void {
  since = performance.now();
  waiting = true;
  if (!busy) void attempt(follow);
}

// One question at a time, and then what was dragged to meanwhile: answers never pile up.
async function follow(): Promise<void> {
  busy = true;
  try {
    while (waiting) {
      waiting = false;
      const began = since, key = `${effect} ${place}`, joint = shownJoint(), [from, to] = selection.range ?? [0, known.opened?.seconds ?? 0];
      const parts = about({ effect, place, joint, from, to });
      for (const one of values) parts.append("value", `${one.name}:${one.value}`);
      const answer = await asked<Predicted>(`/api/trial?${parts}`, () => !live() && key === `${effect} ${place}`);
      if (!answer) continue;
      found = answer;
      const whole = known.opened && to - from > answer.to - answer.from + 0.01 ? ` (the first ${number(answer.to - answer.from)} s of the view)` : "";
      put(words, `${milli(answer.without_rmse_rad)} → ${milli(answer.rmse_rad)} mrad rms in the view${whole}, one finger on its own from where it was measured.`);
      dispatchEvent(new Event("trial"));
      told();
      await new Promise((done) => { requestAnimationFrame(done); });
      waits.push(performance.now() - began);
      mark("trial", `${(performance.now() - began).toFixed(1)} ${(1e3 * answer.server_s).toFixed(1)} ${waits.length}`);
    }
  } finally { busy = false; }
}

const settings = () => values.map((one) => `${one.name}=${+one.value.toPrecision(5)}`);
function told(): void {
  const one = recording();
  put(command, `twin add ${effect} --joint ${place} --set ${settings().join(" ")}${one ? ` --recording ${one.folder}/${one.name}` : ""}`);
}

function clear(): void {
  if (found) { found = null; dispatchEvent(new Event("trial")); }
}

// The sliders of an effect at a place, from the value that the version has, or a typical one.
export async function choose(newEffect: string, newPlace: string): Promise<void> {
  const key = `${newEffect} ${newPlace} ${selection.version}`, there = !live() && known.opened !== null;
  box.hidden = !there;
  if (!there || box.dataset.key === key) return;
  box.dataset.key = key;
  clear();
  [effect, place, values] = [newEffect, newPlace, []];
  rows.replaceChildren();
  put(command, "");
  const answer = await read<{ parameters: Value[] }>(`/api/trial/values?${new URLSearchParams({ version: selection.version, effect, place })}`).catch((error) => { put(words, (error as Error).message); return null; });
  if (!answer || box.dataset.key !== key) { keep.disabled = true; return; }
  keep.disabled = !allowed();
  values = answer.parameters;
  rows.replaceChildren(...values.map(slider));
  put(words, "Drag a value: the prediction of the finger follows in its chart.");
  told();
}

export function start(): void {
  off.addEventListener("click", clear);
  works(keep, async () => {
    await begin("add", { effect, joint: place, values: Object.fromEntries(values.map((one) => [one.name, one.value])) });
    select({ step: "add" });
  });
  rows.addEventListener("input", () => { if (shownJoint() !== selection.joint) select({ joint: shownJoint() }); }, { capture: true });
  on(["source", "onset", "version"], () => { clear(); delete box.dataset.key; });
  on(["range"], () => { if (found) moved(); });
  hear(["opened"], () => { if (!known.opened) box.hidden = true; });
}
