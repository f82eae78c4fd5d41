// The race of the candidates while a diagnosis runs, and the card with its verdict afterwards.
import { needsAuthorization, post, read, works } from "./api";
import { bar, interval } from "./bars";
import { effect } from "./data";
import { drawing } from "./drawings";
import { made, milli, number, short, withUnit } from "./dom";
import { begin, words, type Job } from "./jobs";
import { lines as sketch } from "./sketch";
import { select } from "./state";

const EVIDENCE = /^\s*([\w-]+:[^:\s]+(?: and [\w-]+:[^:\s]+)*): evidence (-?\d+) nats/;
const IN_RACE = 8;

export const place = (name: string) => {
  const [key, at] = name.split(":");
  return at ? `${capital(effect(key)?.title ?? key)}, ${short(at)}` : { nothing: "Nothing is missing", unknown: "None of the library", too_weak: "Too weak for these data to show" }[name] ?? name;
};
const capital = (text: string) => text.charAt(0).toUpperCase() + text.slice(1);
const many = (names: string[]) => names.map(place).join(" and ");

// Candidates by how well they explain the data so far; the best fills its bar.
export function race(job: Job): HTMLElement {
  const found = new Map<string, number>();
  for (const text of job.lines) {
    const match = EVIDENCE.exec(text);
    if (match) found.set(match[1], Number(match[2]));
  }
  const best = Math.max(1, ...found.values()), ranked = [...found].sort((a, b) => b[1] - a[1]);
  const rows = ranked.slice(0, IN_RACE).map(([name, nats]) => made("tr", {}, made("th", { scope: "row" }, place(name)),
    made("td", {}, bar(Math.max(nats, 0) / best, nats === best ? "good" : "twin")), made("td", { className: "n" }, `${nats}`)));
  const left = job.limit_s ? Math.max(0, job.limit_s - job.seconds) : null;
  const time = left === null ? `${job.seconds.toFixed(0)} s so far; no time limit` : `at most ${left.toFixed(0)} s left`;
  const stop = needsAuthorization(made("button", { type: "button", id: "stop-job" }, "Stop, and keep what is done"));
  works(stop, () => post("/api/job/stop"));
  return made("section", { className: "card race" }, made("h2", {}, job.kind === "diagnose" ? "Candidates are judged" : words(job)),
    made("p", { id: "job-status", role: "status" }, job.kind === "diagnose" ? `${words(job)} ${capital(time)}.` : time),
    rows.length ? made("table", { className: "race" }, made("caption", {}, "Evidence so far, nats"), made("tbody", {}, ...rows)) : null,
    ranked.length > IN_RACE ? made("p", { className: "soft" }, `and ${ranked.length - IN_RACE} more that explain less`) : null, stop, log(job));
}

export const log = (job: Job) => made("details", {}, made("summary", {}, "What it says"),
  made("pre", { className: "progress", id: "job-lines", tabIndex: 0, "aria-label": "What the work says" }, job.lines.join("\n")));

const inHundred = (probability: number) => (probability > 0.995 ? "more than 99 in 100" : `${(100 * probability).toFixed(0)} in 100`);

// One finding as a card: how sure, what, where, a drawing, its numbers with their intervals, and the button that acts.
function card(finding: any, job: Job, first: boolean): HTMLElement {
  const known = effect(finding.effect), title = capital(known?.title ?? finding.effect);
  const values = Object.entries<any>(finding.parameters).map(([name, one]) => made("div", { className: "value" },
    made("div", {}, made("span", {}, name), interval(one.value, one.ci95, one.lower, one.upper), made("b", {}, withUnit(number(one.value), one.unit))),
    made("p", { className: "soft" }, one.ci95 ? `95 %: ${withUnit(`${number(one.ci95[0])} to ${number(one.ci95[1])}`, one.unit)}${one.at_bound ? ", on its bound" : ""}` : "no interval known")));
  const add = needsAuthorization(made("button", { type: "button", className: first ? "primary" : "", "data-add": finding.effect }, `Add ${finding.effect.replaceAll("_", " ")} to the twin`));
  works(add, async () => {
    select({ version: job.about.version });
    await begin("add", { effect: finding.effect, joint: finding.target, version: job.about.version, holdout: job.about.holdout });
    select({ step: "add" });
  });
  return made("section", { className: "card finding" },
    finding.probability === null || finding.probability === undefined ? null : made("p", { className: "sure" }, inHundred(finding.probability)),
    made(first ? "h2" : "h3", {}, `${title} at ${short(finding.target)}`), drawing(finding.effect, title),
    known ? made("p", {}, `${known.story.what} ${known.story.shows}`) : null, ...values, add,
    made("details", {}, made("summary", {}, "Evidence and errors"), made("p", {}, finding.explanation),
      made("p", {}, `Evidence ${number(finding.evidence, 4)} nats. It takes away ${percent(finding.holdout_gain)} (95 %: ${percent(finding.holdout_gain_ci95[0])} to ${percent(finding.holdout_gain_ci95[1])}) of the error on validation data.`),
      made("p", {}, `Validation data, in short pieces of its part: ${change(finding.holdout_mse_before, finding.holdout_mse_after)}. `
        + `One free roll-out of the whole hand: ${change(finding.free_holdout_mse_before, finding.free_holdout_mse_after)}.`)));
}

const percent = (share: number | null) => (share === null || share === undefined ? "unknown" : `${(100 * share).toFixed(0)} %`);
export const change = (from: number | null | undefined, to: number | null | undefined) => (from === null || from === undefined || to === null || to === undefined ? "not tested"
  : `${number(from)} → ${number(to)} rad² (${milli(Math.sqrt(from))} → ${milli(Math.sqrt(to))} mrad)`);

// `beside` stands between the findings and what speaks for them.
export function verdict(job: Job, beside: HTMLElement | null): HTMLElement {
  const result = job.result, box = made("div", { id: "diagnosis" });
  const words_ = { explained: "Explained", ambiguous: "Ambiguous", not_excited: "Not excited", unexplained: "Unexplained", within_noise: "Within noise" }[result.verdict as string];
  box.append(made("p", { className: `verdict ${result.verdict}` }, made("b", {}, `${words_}.`), ` ${capital(result.words.replace(/^[^:]*: ?/, ""))} `, made("span", { className: "soft" }, result.reason)));
  result.findings.forEach((one: any, index: number) => box.append(card(one, job, index === 0)));
  if (beside) box.append(beside);
  const chances = result.probabilities as { effects: string[]; probability: number }[];
  if (chances.length) {
    box.append(made("h3", {}, "What else it could be"), made("table", { className: "race" }, made("caption", { className: "hidden" }, "Probability of each cause"), made("tbody", {}, ...chances.slice(0, 6).map((one, index) =>
      made("tr", {}, made("th", { scope: "row" }, many(one.effects)), made("td", {}, bar(one.probability, index ? "twin" : "good")), made("td", { className: "n" }, one.probability > 0.995 ? "> 99 %" : `${(100 * one.probability).toFixed(0)} %`))))));
  }
  if (result.tried.length) {
    const tried = [...result.tried].sort((a: any, b: any) => (b.evidence ?? -Infinity) - (a.evidence ?? -Infinity)).slice(0, 4);
    box.append(made("h3", {}, "Why the others lost"), made("ul", { className: "soft tight" }, ...tried.map((one: any) => made("li", {}, made("b", {}, place(`${one.effect}:${one.target}`)), `: ${one.lost_because}`))));
  }
  const story = effect(result.findings[0]?.effect)?.story;
  if (story) box.append(made("h3", {}, "Likely cause"), made("p", {}, story.cause), made("h3", {}, "What to do"), made("p", {}, story.remedy));
  if (result.where.length) {
    box.append(made("h3", {}, "Where the model fails most"), made("ul", { className: "tight" }, ...result.where.slice(0, 4).map((one: any) =>
      made("li", {}, `${short(one.joint)}, ${one.condition}: ${milli(one.rmse_rad)} mrad rms, bias ${milli(one.bias_rad)} mrad`))));
  }
  if (result.next_experiment) box.append(experiment());
  for (const note of result.notes ?? []) box.append(made("p", { className: "soft" }, note));
  box.append(made("p", { className: "soft", id: "job-status", role: "status" }, words(job)), log(job));
  return box;
}

function experiment(): HTMLElement {
  const box = made("section", { id: "experiment" }), button = made("button", { type: "button" }, "Preview the next experiment on the twin");
  works(button, async () => {
    const found = await read("/api/experiment");
    const curves = Object.entries<any>(found.curves).slice(0, 4).map(([name, one]) => sketch(short(name), found.time_s, [["commanded", "command", one.commanded], ["the twin", "twin", one.followed]], "rad"));
    box.append(made("p", {}, `${found.why}. Nothing moves; 'twin command trajectory' runs ${found.path} through the gate.`), ...curves);
    button.hidden = true;
  });
  box.append(made("h3", {}, "Next experiment"), button);
  return box;
}
