// What is selected, in the step that is chosen: its facts, one primary button, and what came of it.
import { attempt, needsAuthorization, works } from "./api";
import { errorsOf, hear, known, mark, recording, shown, version, versionTitle, type Errors } from "./data";
import { made, milli, number, put, row, short, size, table, withUnit } from "./dom";
import { fields } from "./fields";
import { KINDS, begin, jobs, ofSelection, running, words } from "./jobs";
import { missing } from "./proposals";
import { NAMES, added, better, standing, type Step } from "./path";
import { exporting, promoting, rollback } from "./promotion";
import { live, on, select, selection } from "./state";
import { summary } from "./tables";
import { change, log, race, verdict } from "./verdict";
import { chooseFile } from "./upload";
import { keepButton } from "./keep";

const body = made("div", { className: "body" }), head = made("div", { className: "head" });
export const aside = made("aside", { id: "inspector", "aria-label": "Inspector", tabIndex: -1 }, head, body);
let drawnAs = "";

const button = (text: string, act: () => unknown, id = "", primary = true) => {
  const found = needsAuthorization(made("button", { type: "button", className: primary ? "primary" : "", id }, text));
  return works(found, act);
};
const free = (text: string, act: () => unknown, id = "") => works(made("button", { type: "button", id }, text), act);

const content: Record<Step, () => (Node | null)[]> = {
  data() {
    const { opened } = known, one = recording();
    if (live() || !opened) {
      return [live() ? made("p", {}, "The live hand is shown. Keep its last minutes as a recording to work on them.") : made("p", { id: "opened", role: "status" }, known.opening || "Choose a recording."),
        live() ? keepButton("primary") : null, free("Choose a file", chooseFile, "choose-file"), live() ? joint() : null];
    }
    const moving = opened.joints.filter((item) => item.moves).map((item) => short(item.name));
    return [made("p", { id: "opened", role: "status" }, known.opening), facts([["file", one ? `${one.name}, ${size(one.bytes)}` : ""], ["length", `${number(opened.seconds, 4)} s`],
      ["rate", `${number(opened.rate_hz, 4)} Hz`], ["moves", moving.join(", ") || "no joint"], ["commands", opened.commands_recorded ? "recorded" : "not recorded: their onset is estimated"]]),
    opened.commands_recorded ? null : fields.onset(), ...opened.notes.map((note) => made("p", { className: "soft" }, note)), fields.holdout(), diagnosing(), next("check")];
  },
  check() {
    const job = ofSelection("check");
    if (job?.status !== "done") return [button("Check the data", () => begin("check"), "check"), job?.status === "failed" ? made("p", { className: "bad" }, words(job)) : null];
    const { recordings, parameters } = job.result, weak = Object.entries<any>(parameters).filter(([, one]) => one.verdict !== "identifiable"), all = Object.keys(parameters).length;
    return [...recordings.map((one: any) => facts([["samples", `${one.samples} at ${number(one.rate_hz, 4)} Hz`], ["jitter", `${milli(one.jitter_s, 2)} ms`], ["gaps", `${one.gaps}, the longest ${milli(one.longest_gap_s)} ms`],
      ["moves", `${one.moving_joints.length} of ${one.joints} joints`], ["saturated", one.saturated_commands.map((name: any) => short(String(name))).join(", ") || "no command"]])),
    ...recordings.flatMap((one: any) => one.warnings).map((text: string) => made("p", { className: "odd" }, text)),
    made("p", {}, `${all - weak.length} of ${all} parameters are identifiable from these data.`),
    weak.length ? made("details", {}, made("summary", {}, `${weak.length} are not, or weakly`), made("ul", { className: "tight" }, ...weak.map(([name, one]) => made("li", {}, made("b", {}, name), `: ${one.verdict.replaceAll("_", " ")}. ${one.advice ?? ""}`)))) : null,
    next("compare"), button("Check again", () => begin("check"), "check", false)];
  },
  compare() {
    const found = known.errors.get(selection.version);
    return [fields.version(), fields.others(), fields.lag(), found ? made("p", {}, summary(found)) : made("p", {}, standing("compare").reason), joint(),
      works(made("button", { type: "button" }, "Show where it fails"), () => dispatchEvent(new CustomEvent("open-panel", { detail: "tables" }))), next("diagnose")];
  },
  diagnose() {
    const job = ofSelection("diagnose"), ended = job?.status === "done";
    const options = [fields.version(), fields.holdout(), fields.joints(), fields.within()];
    const run = diagnosing(ended);
    const ladder = button("Ladder: diagnose, add, again", () => begin("ladder"), "ladder", false);
    if (ended && job.result) return [verdict(job, missing(job)), made("details", {}, made("summary", {}, "Diagnose again"), ...options, run, ladder)];
    return [job && job.status !== "running" ? made("p", { className: "bad", id: "job-status" }, words(job)) : null, ...options, run, ladder, job && job.status !== "running" ? log(job) : null];
  },
  add() {
    const job = ofSelection("add"), new_ = added();
    const result = new_ ? outcome(new_.job) : [];
    const failed_ = job?.status === "failed" ? made("p", { className: "bad", id: "job-status" }, words(job)) : null;
    return [failed_, ...result, new_ ? next("validate") : made("p", {}, standing("add").reason), made("details", { open: !new_ && !ofSelection("diagnose")?.result }, made("summary", {}, "Add an effect by hand"),
      made("p", { className: "soft" }, "Choose the effect in the library: it shows what it does to a motion."),
      free("Open the library of effects", () => dispatchEvent(new CustomEvent("open-panel", { detail: "effects" }))))];
  },
  validate() {
    const new_ = added();
    if (!new_) return [made("p", {}, standing("validate").reason)];
    const good = better(new_.job.result), result = made("div", { id: "validated" }), used = known.aliases.current === new_.version;
    const run = works(made("button", { type: "button", className: good ? "" : "primary", id: "validate" }, "Validate on this recording"), () => elsewhere(new_.version, new_.job.about.version, result));
    return [made("p", {}, made("strong", {}, good === null ? "Not tested on held-out motion." : good ? "Better on motion that no fit has seen." : "Not better on motion that no fit has seen: do not promote it.")),
      used ? inUse() : good ? promoting(new_.version, "Promote", true) : null, ...outcome(new_.job, true), fields.elsewhere(), run, result, next("promote")];
  },
  promote() {
    const new_ = added(), now = version(known.aliases.current);
    const parts: (Node | null)[] = [facts([["in use", now ? now.id === "nominal" ? now.id : `${now.id.slice(0, 12)} ${versionTitle(now.id)}` : "unknown"]])];
    if (!new_) return [made("p", {}, standing("promote").reason), ...parts, rollback()];
    const done = known.aliases.current === new_.version;
    return [...parts, facts([["candidate", `${new_.version.slice(0, 12)} ${versionTitle(new_.version)}`]]),
      done ? inUse() : promoting(new_.version, "Promote", true), exporting(new_.version), rollback(),
      works(made("button", { type: "button" }, "Show the history"), () => dispatchEvent(new CustomEvent("open-panel", { detail: "history" })))];
  },
};

// From the first step on: who has a recording may ask at once what is wrong.
const diagnosing = (again = false) => button(again ? "Diagnose again" : "Diagnose", async () => {
  await begin("diagnose", fields.diagnosis());
  select({ step: "diagnose" });
}, "diagnose", !again);
const inUse = () => made("p", { className: "good" }, "The new version is in use. A running daemon takes it up within a second or two.");

function next(step: Step): Node {
  const found = made("button", { type: "button", className: "next" }, `Next: ${NAMES[step]}`);
  found.addEventListener("click", () => select({ step }));
  return found;
}

export const facts = (rows: [string, string][]) => made("dl", { className: "facts" }, ...rows.flatMap(([name, value]) => [made("dt", {}, name), made("dd", {}, value)]));

// What is known of the selected joint, under each version.
function joint(): Node | null {
  if (!selection.joint) return null;
  const found = shown().map((id) => [id, known.errors.get(id)?.joints[selection.joint]] as const).filter(([, one]) => one);
  if (!found.length) return made("p", { className: "soft" }, `${short(selection.joint)} is selected.`);
  return table(`${short(selection.joint)}`, ["version", "rmse mrad", "max mrad", "bias mrad", "lag ms", "noise mrad"], found.map(([id, one]) =>
    row(versionTitle(id), milli(one!.rmse_rad), milli(one!.max_abs_rad), milli(one!.bias_rad), milli(one!.lag_s), milli(Math.sqrt(one!.noise_rad2), 2))));
}

// What an addition or a ladder did to the errors, each figure with the name of what it is.
function outcome(job: any, brief = false): Node[] {
  const result = job.result;
  if (result.steps) return [made("h2", {}, "The ladder"), made("p", { id: "added" }, result.words)];
  const found = result.finding;
  const lines = [made("li", {}, `Fitted motion, one free roll-out of the whole hand: ${change(result.before.mse_rad2, result.after.mse_rad2)}`),
    made("li", {}, `Validation data, one free roll-out of the whole hand: ${change(result.holdout_before.mse_rad2, result.holdout_after.mse_rad2)}`),
    result.holdout_joints_after.mse_rad2 === null ? null : made("li", {}, `The same over its joints: ${change(result.holdout_joints_before.mse_rad2, result.holdout_joints_after.mse_rad2)}`),
    found ? made("li", {}, `Validation data, in short pieces of its part: ${change(found.holdout_mse_before, found.holdout_mse_after)}`) : null,
    ...(brief ? [] : Object.entries<any>(result.parameters).map(([name, one]) => made("li", {}, `${name} = ${withUnit(number(one.value, 4), one.unit)} (95 %: ${number(one.ci95[0])} to ${number(one.ci95[1])})${one.at_bound ? ", on its bound" : ""}`))),
    ...(brief ? [] : (result.notes ?? []).map((note: string) => made("li", { className: "soft" }, note)))];
  return [brief ? made("h3", {}, "Held out") : made("h2", {}, `${result.effect.replaceAll("_", " ")} at ${result.targets.map(short).join(", ")}`),
    made("ul", { className: "tight", id: brief ? "" : "added" }, ...lines), brief ? made("span") : made("p", {}, `Stored as candidate ${result.version.slice(0, 12)}; it is used only if it is promoted.`)];
}

async function elsewhere(new_: string, base: string, result: HTMLElement): Promise<void> {
  const source = fields.elsewhereValue();
  if (!source) throw new Error("Choose a recording to validate on.");
  put(result, "The twin is being rolled out ...");
  const [before, after] = await Promise.all([base, new_].map((id) => errorsOf(source, id))) as (Errors | null)[];
  if (!before || !after) return;
  result.replaceChildren(table(`On ${recording(source)?.name ?? "the recording"}, one free roll-out`, ["version", "rms mrad", "mse rad²"], [[base, before], [new_, after]].map(([id, one]) =>
    row(versionTitle(id as string), milli(Math.sqrt((one as Errors).mse_rad2 ?? NaN)), number((one as Errors).mse_rad2)))),
  made("p", {}, made("strong", {}, (after.mse_rad2 ?? Infinity) < (before.mse_rad2 ?? 0) ? "Better there, too." : "Not better there.")));
}

function show(force = false): void {
  const busy = running(), step = selection.step as Step;
  const key = [step, selection.source, selection.version, selection.others, selection.joint, selection.holdout, busy?.kind, known.opening, known.errors.size, known.aliases.current,
    known.recordings.length, ...KINDS.map((kind) => `${jobs[kind]?.number} ${jobs[kind]?.status}`), busy ? `${busy.lines.length} ${Math.floor(busy.seconds)}` : ""].join("|");
  if (!force && key === drawnAs) return;
  // somebody types: it waits
  if (!force && body.contains(document.activeElement) && /^(INPUT|SELECT|TEXTAREA)$/.test(document.activeElement!.tagName) && drawnAs.startsWith(`${step}|`) && !busy) return;
  drawnAs = key;
  const { state, reason } = standing(step), open = [...body.querySelectorAll("details")].map((one) => one.open);
  head.replaceChildren(made("p", { className: `standing ${state}` }, made("b", {}, `${NAMES[step]}: ${state}. `), reason));
  body.replaceChildren(...(busy ? [race(busy)] : []), ...(busy && busy.kind === step ? [] : content[step]().filter((one): one is Node => one !== null)));
  if (busy) body.querySelectorAll("details").forEach((one, place) => { one.open = open[place] ?? one.open; });
  const lines = body.querySelector(".progress");
  if (lines) lines.scrollTop = lines.scrollHeight;
}

export function start(): void {
  on(["step", "source", "version", "others", "joint", "holdout"], () => show());
  hear(["opened", "errors", "versions", "recordings", "effects"], () => show());
  addEventListener("job", () => show());
  addEventListener("job-ended", (event) => { attempt(() => ended((event as CustomEvent).detail)); });
  show(true);
}

function ended(kind: string): void {
  const new_ = added();
  if ((kind === "add" || kind === "ladder") && new_) {
    dispatchEvent(new Event("versions-changed"));
    select({ others: [new_.version, ...selection.others.filter((id) => id !== new_.version)].slice(0, 2), step: "add" });
    mark("added", new_.version);
  }
  if (kind === "diagnose" || kind === "propose") select({ step: "diagnose" });
}
