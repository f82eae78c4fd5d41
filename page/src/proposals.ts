// The law that is missing where no effect of the library fits: the button behind such a verdict, and what came of it.
import { needsAuthorization, works } from "./api";
import { made, number, short, withUnit } from "./dom";
import { begin, ofSelection, words, type Job } from "./jobs";
import { lines as sketch } from "./sketch";
import { select } from "./state";
import { change, log } from "./verdict";

const PORTS: Record<string, string> = { torque: "a torque at the joint", command: "a change of the command", reading: "a change of the reading" };
const percent = (share: number | null) => (share === null ? "unknown" : `${(100 * share).toFixed(0)} %`);

// What to do about a diagnosis that ends without a name; null where it has one.
export function missing(diagnosis: Job): HTMLElement | null {
  if (diagnosis.result.verdict !== "unexplained") return null;
  const { recording_id, version, holdout } = diagnosis.about, job = ofSelection("propose");
  const about = job && job.about.recording_id === recording_id && job.about.version === version && job.about.holdout === holdout ? job : null;
  const ask = needsAuthorization(made("button", { type: "button", className: about?.result ? "" : "primary", id: "propose" }, about?.result ? "Propose again" : "Propose the missing law"));
  works(ask, () => begin("propose", { version, holdout }));
  const box = made("section", { id: "proposals" }, made("h3", {}, "The law that is missing"));
  if (about?.result) {
    box.append(made("p", {}, about.result.reason), ...about.result.proposals.map((one: any) => card(one, diagnosis)));
    for (const note of about.result.notes) box.append(made("p", { className: "soft" }, note));
  } else if (about && about.status !== "running") {
    box.append(made("p", { className: "bad" }, words(about)));
  } else {
    box.append(made("p", { className: "soft" }, "No effect of the library fits. What these data ask for can be looked for as a formula: a torque, a change of the command and a change of the reading compete."));
  }
  box.append(ask);
  if (about && about.status !== "running") box.append(log(about));
  return box;
}

function card(one: any, diagnosis: Job): HTMLElement {
  const { curve } = one, at = one.joints.map(short).join(", ");
  const add = needsAuthorization(made("button", { type: "button", className: "primary", "data-add": one.name }, `Add ${one.name} to the twin`));
  works(add, async () => {
    select({ version: diagnosis.about.version });
    await begin("add", { effect: one.name, joint: one.joints[0], version: diagnosis.about.version, holdout: diagnosis.about.holdout });
    select({ step: "add" });
  });
  return made("article", { className: "card", "data-proposal": one.name }, made("h3", {}, `${PORTS[one.port]} by ${one.variables.join(" and ")}, at ${at}`),
    made("p", {}, made("code", {}, one.formula)),
    sketch(one.name, curve.at, [["the law", "twin", curve.value], ["95 %", "soft", curve.lower], ["", "soft", curve.upper]], curve.unit, curve.at_unit),
    made("p", {}, `It takes away ${percent(one.holdout_gain)} (95 %: ${percent(one.holdout_gain_ci95[0])} to ${percent(one.holdout_gain_ci95[1])}) of the error on held-out motion, ${change(one.holdout_mse_before, one.holdout_mse_after)}. Probability of a law of these variables: ${number(one.probability)}.`),
    made("p", { className: "soft" }, `The motion visited ${withUnit(`${number(curve.visited[0])} to ${number(curve.visited[1])}`, curve.at_unit)}; beyond it nothing is known, and the law stays flat.`),
    made("ul", { className: "soft tight" }, ...one.nearest.map((near: any) => made("li", {}, made("b", {}, near.effect), `: ${near.fails_because}`))),
    made("p", {}, `To test it: ${one.experiment}`), add);
}
