// How the error falls: from the nominal model, with each effect that was added, down to the sensors' noise.
import { attempt, read } from "./api";
import { waterfall, type Fall } from "./bars";
import { hear, known, mark, version, versionTitle } from "./data";
import { made, milli, short } from "./dom";
import { jobs } from "./jobs";
import { added } from "./path";
import { live, on, selection } from "./state";

const box = made("div"), words = made("p", { id: "fall-words" });
export const panel = made("div", { className: "panel fall-panel", tabIndex: 0, role: "region", "aria-label": "How the error falls" }, box, words);
let drawn = "";

// A title as a row has room for it: a ladder by the number of its effects, one effect by its name.
function brief(title: string): string {
  const ladder = /^ladder: (.+)$/.exec(title);
  if (ladder) return `ladder, ${ladder[1].split(", ").length} effects`;
  const [effect, ...where] = title.split(" at ");
  return [effect.replaceAll("_", " "), ...where.map(short)].join(" at ");
}

interface Step { effect: string | null; target: string | null; mse_rad2: number | null; holdout_mse_rad2: number | null }

async function show(): Promise<void> {
  const id = added()?.version ?? (version()?.errors.after !== null ? selection.version : ""), key = `${id} ${known.errors.size} ${selection.source}`;
  if (key === drawn) return;
  drawn = key;
  const now = known.errors.get(selection.version), noise = now ? Math.sqrt(now.noise_floor_rad2) : null;
  if (!id || id === "nominal") {
    const rows: Fall[] = now?.mse_rad2 ? [{ name: versionTitle(selection.version), before: null, after: Math.sqrt(now.mse_rad2), look: "twin", words: `${milli(Math.sqrt(now.mse_rad2))} mrad` }] : [];
    if (noise && rows.length) rows.push({ name: "sensor noise", before: null, after: noise, look: "soft" });
    box.replaceChildren(...(rows.length ? [waterfall(rows)] : []));
    words.textContent = rows.length ? "Diagnose, then add what is found: the error falls here, step by step." : live() ? "Choose a recording to see its error." : known.opening;
    return;
  }
  const steps: Step[] = jobs.ladder?.result?.version === id ? jobs.ladder.result.steps : (await read(`/api/versions/ladder?version=${encodeURIComponent(id)}`)).steps;
  if (key !== drawn) return;
  const held = steps.every((one) => one.holdout_mse_rad2 !== null), value = (one: Step) => Math.sqrt((held ? one.holdout_mse_rad2 : one.mse_rad2) ?? NaN);
  const rows: Fall[] = [{ name: "Nominal", before: null, after: value(steps[0]), look: "twin", words: `${milli(value(steps[0]))} mrad` }];
  steps.slice(1).forEach((one, at) => {
    const from = value(steps[at]), to = value(one);
    rows.push({ name: one.effect ? `+ ${brief(one.effect)}` : "all together", before: from, after: to, look: to <= from ? "better" : "bad" });
  });
  const last = value(steps[steps.length - 1]);
  rows.push({ name: "left", before: null, after: last, look: "accent" });
  if (noise) rows.push({ name: "sensor noise", before: null, after: noise, look: "soft" });
  box.replaceChildren(waterfall(rows));
  const gain = 1 - last ** 2 / value(steps[0]) ** 2;
  words.textContent = `${held ? "On motion that no fit has seen" : "On the motion that was fitted"}, one free roll-out of the whole hand, mrad rms. `
    + `The mean square falls by ${(100 * gain).toFixed(gain > 0.99 ? 1 : 0)} %.${noise ? ` What is left is ${(last / noise).toFixed(1)} times the sensors' noise.` : ""}`;
  mark("fallen", String(last / value(steps[0])));
}

export function start(): void {
  const again = () => { attempt(show); };
  hear(["errors", "opened", "versions"], again);
  on(["version", "source", "others"], again);
  addEventListener("job-ended", again);
  addEventListener("job", again);
  again();
}
