// The path from data to a promoted version: each step done, open or blocked with its reason, and the command that does the same.
import { failed, say } from "./api";
import { hear, known, recording } from "./data";
import { icon, made, put } from "./dom";
import { jobs, ofSelection } from "./jobs";
import { STEPS, live, on, select, selection } from "./state";
import copy from "lucide-static/icons/copy.svg?raw";

export type Step = (typeof STEPS)[number];
export interface Standing { state: "done" | "open" | "blocked"; reason: string }
export const NAMES: Record<Step, string> = {
  data: "Data", check: "Check", compare: "Compare", diagnose: "Diagnose", add: "Add and refit", validate: "Validate", promote: "Promote",
};

// What was added last to what is selected: the addition, or the ladder if that came later.
export function added(): { job: NonNullable<ReturnType<typeof ofSelection>>; version: string } | null {
  const both = [ofSelection("add"), ofSelection("ladder")].filter((job) => job?.result?.version);
  const job = both.sort((a, b) => b!.number - a!.number)[0];
  return job ? { job, version: job.result.version } : null;
}

// Whether held-out motion is predicted better with what was added; null where nobody knows.
export function better(result: any): boolean | null {
  const steps = result?.steps, before = steps ? steps[0].holdout_mse_rad2 : result?.holdout_before?.mse_rad2;
  const after = steps ? steps[steps.length - 1].holdout_mse_rad2 : result?.holdout_after?.mse_rad2;
  return before === null || before === undefined || after === null || after === undefined ? null : after < before;
}

export function standing(step: Step): Standing {
  const none: Standing = { state: "blocked", reason: "Choose a recording first." };
  const there = !live() && known.opened !== null, done = (reason: string): Standing => ({ state: "done", reason }), open = (reason: string): Standing => ({ state: "open", reason });
  const new_ = added();
  switch (step) {
    case "data": return there ? done(`${known.opened!.name} is open.`) : open("Choose a recording on the left, drop one anywhere, or keep the last minutes of the live hand.");
    case "check": return !there ? none : ofSelection("check")?.status === "done" ? done("The data were checked.") : open("See whether these data can tell what is wrong, before any fit.");
    case "compare": return !there ? none : known.errors.has(selection.version) ? done("The errors are known.") : open("The twin is being rolled out under the recorded commands.");
    case "diagnose": return !there ? none : ofSelection("diagnose")?.status === "done" ? done("There is a verdict.") : open("Find what the model lacks.");
    case "add": {
      if (!there) return none;
      if (new_) return done("A candidate is stored.");
      const found = ofSelection("diagnose")?.result?.findings?.length;
      return found ? open("Add what the diagnosis found, and refit.") : { state: "blocked", reason: "Diagnose first: there is no finding to add. An effect can also be added by hand." };
    }
    case "validate": {
      if (!there) return none;
      if (!new_) return { state: "blocked", reason: "Nothing was added that could be validated." };
      return better(new_.job.result) ? done("Better on motion that no fit has seen.") : open("Compare both on motion that no fit has seen.");
    }
    default: {
      if (!there) return none;
      if (!new_) return { state: "blocked", reason: "There is no candidate." };
      return known.aliases.current === new_.version ? done("The new version is in use.") : open("Put the new version to use, with a reason.");
    }
  }
}

const quoted = (text: string) => (/^[\w./:=@%+-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`);

export function command(step: Step): string {
  const one = recording(), path = one ? quoted(`${one.folder}/${one.name}`) : "RECORDING", other = recording(selection.holdout);
  const holdout = other ? ` --holdout ${quoted(`${other.folder}/${other.name}`)}` : "";
  const version = selection.version && selection.version !== "nominal" ? ` --version ${selection.version.slice(0, 12)}` : "";
  const finding = ofSelection("diagnose")?.result?.findings?.[0], new_ = added()?.version.slice(0, 12) ?? "candidate";
  switch (step) {
    case "data": return live() ? "twin record" : `twin check --recording ${path}`;
    case "check": return `twin check --recording ${path}${version}`;
    case "compare": return `twin compare --recording ${path}${version}`;
    case "diagnose": return `twin diagnose --recording ${path}${holdout}${version}`;
    case "add": return `twin add ${finding?.effect ?? "EFFECT"} --joint ${finding?.target ?? "JOINT"} --recording ${path}${holdout}${version}`;
    case "validate": return `twin compare --recording ${other ? quoted(`${other.folder}/${other.name}`) : path} --version ${new_}`;
    default: return `twin versions promote ${new_}`;
  }
}

const items = new Map<Step, { button: HTMLButtonElement; number: HTMLElement }>();
const line = made("code", { id: "command" });
const copied = made("button", { type: "button", className: "plain", title: "Copy the command" }, icon(copy), made("span", { className: "hidden" }, "Copy the command"));
const small = made("select", { id: "step-small", "aria-label": "Step" });
export const nav = made("nav", { id: "path", "aria-label": "Steps" }, made("ol", {}), small, made("div", { className: "command" }, line, copied));

function show(): void {
  STEPS.forEach((step, place) => {
    const { state, reason } = standing(step), { button, number } = items.get(step)!;
    button.className = `step ${state}${selection.step === step ? " chosen" : ""}`;
    button.title = `${NAMES[step]}: ${state}. ${reason}`;
    if (selection.step === step) button.setAttribute("aria-current", "step"); else button.removeAttribute("aria-current");
    put(number, state === "done" && selection.step !== step ? "✓" : String(place + 1));
    put(button.querySelector(".hidden")!, `, ${state}`);
    put(small.options[place], `${place + 1} of 7: ${NAMES[step]}, ${state}`);
  });
  small.value = selection.step;
  put(line, command(selection.step as Step));
}

export function start(): void {
  for (const step of STEPS) {
    const number = made("span", { className: "number" }), button = made("button", { type: "button", "data-step": step }, number, made("span", {}, NAMES[step]), made("span", { className: "hidden" }));
    button.addEventListener("click", () => select({ step }));
    items.set(step, { button, number });
    nav.firstElementChild!.append(made("li", {}, button));
    small.append(made("option", { value: step }));
  }
  small.addEventListener("change", () => select({ step: small.value }));
  copied.addEventListener("click", () => {
    navigator.clipboard.writeText(line.textContent ?? "").then(() => say("The command was copied.", "note"), failed);
  });
  on(["source", "holdout", "version", "step"], show);
  hear(["opened", "errors", "versions", "recordings"], show);
  addEventListener("job", show);
  show();
}

export const latestDiagnosis = () => ofSelection("diagnose") ?? (live() ? jobs.diagnose : undefined);
