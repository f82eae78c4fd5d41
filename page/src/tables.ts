// Where the model fails: errors by joint, by what the joint was doing, and the worst moments.
import { failed, works } from "./api";
import { hear, known, moment, shown, versionTitle, type Errors } from "./data";
import { made, milli, put, row, short, table } from "./dom";
import { live, on, select, selection } from "./state";

const WORST = 8;
const caption = made("p", { id: "errors-caption", role: "status" }), joints = made("div"), heat = made("div", { id: "heat" }), worst = made("div");
export const panel = made("div", { className: "panel" }, caption, joints, made("h3", {}, "By what the joint was doing"),
  made("p", { className: "soft" }, "Root mean square residual in mrad. A click goes to the worst moment."), heat, worst);

function show(): void {
  const first = known.errors.get(selection.version);
  joints.replaceChildren();
  heat.replaceChildren();
  worst.replaceChildren();
  if (!first) { put(caption, live() ? "Choose a recording: errors are of one." : known.opened ? "Errors are being computed ..." : known.opening || "No recording is open."); return; }
  const others = shown().slice(1).map((id) => [id, known.errors.get(id)] as const);
  put(caption, `${summary(first)}${others.map(([id, one]) => (one ? `; ${versionTitle(id)}: ${milli(Math.sqrt(one.mse_rad2 ?? NaN))} mrad` : "")).join("")}`);
  const rows = Object.entries(first.joints).map(([name, error]) => {
    const pick = made("input", { type: "checkbox", checked: name === selection.joint || selection.pinned.includes(name), "aria-label": `chart of ${name}` });
    pick.addEventListener("change", () => select({ pinned: pick.checked ? [...selection.pinned, name] : selection.pinned.filter((one) => one !== name) }));
    return row(short(name), milli(error.rmse_rad), milli(error.max_abs_rad), milli(error.bias_rad), milli(error.lag_s), milli(Math.sqrt(error.noise_rad2), 2),
      ...others.map(([, one]) => milli(one?.joints[name]?.rmse_rad)), pick);
  });
  joints.append(table("Errors by joint", ["joint", "rmse mrad", "max mrad", "bias mrad", "lag ms", "noise mrad", ...others.map(([id]) => `${versionTitle(id)}, rmse mrad`), "chart"], rows, "errors"));
  conditions(first);
}

export function summary(found: Errors): string {
  const count = Object.keys(found.joints).length;
  if (found.mse_rad2 === null) return "No joint moves by more than 0.05 rad: there is nothing to compare.";
  return `${milli(Math.sqrt(found.mse_rad2))} mrad rms over ${count === 1 ? "the joint that moves" : `the ${count} joints that move`}`
    + `; the sensors' noise is ${milli(Math.sqrt(found.noise_floor_rad2), 2)} mrad`
    + `${found.onset_estimated ? `; the onset of the commands is estimated at ${found.onset_s.toFixed(3)} s` : ""}`;
}

// A cell is filled by its share of the largest error of the table, in steps that are even in the error itself.
function conditions(found: Errors): void {
  const names = [...new Set(found.conditions.map((one) => one.joint))], most = Math.max(...found.conditions.map((one) => one.rmse_rad), 1e-9);
  const rows = names.map((name) => made("tr", {}, made("th", { scope: "row" }, short(name)), ...found.condition_names.map((condition) => {
    const one = found.conditions.find((cell) => cell.joint === name && cell.condition === condition);
    if (!one) return made("td", { className: "n" }, "");
    const go = made("button", { type: "button", className: `cell heat-${Math.min(4, Math.floor((5 * one.rmse_rad) / most))}`, title: `${condition}: bias ${milli(one.bias_rad)} mrad, worst at ${one.worst_s.toFixed(3)} s` }, milli(one.rmse_rad));
    go.addEventListener("click", () => moment(one.joint, one.worst_s));
    return made("td", { className: "n" }, go);
  })));
  if (names.length) heat.append(table("rms residual (mrad) by joint and condition", ["joint", ...found.condition_names], rows));
  worst.append(table("The worst of them", ["joint", "while", "rmse mrad", "bias mrad", "worst at", "go"], found.conditions.slice(0, WORST).map((one) => {
    const go = works(made("button", { type: "button", className: "show" }, "show"), () => moment(one.joint, one.worst_s));
    return row(short(one.joint), made("span", {}, one.condition), milli(one.rmse_rad), milli(one.bias_rad), `${one.worst_s.toFixed(3)} s`, go);
  }), "worst"));
}

export function start(): void {
  const again = () => { try { show(); } catch (error) { failed(error); } };
  hear(["opened", "errors", "versions"], again);
  on(["source", "joint", "pinned", "version", "others"], again);
  again();
}
