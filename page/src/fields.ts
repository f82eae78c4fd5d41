// Controls of the steps. Each is made once, so that what is typed outlives a redrawing.
import { facts } from "./api";
import { hear, known, named, type Version } from "./data";
import { made, short, size } from "./dom";
import { on, select, selection } from "./state";

type Option = [value: string, text: string];
function fill(control: HTMLSelectElement, options: Option[], value: string): void {
  const now = JSON.stringify(options);
  if (control.dataset.options !== now) {
    control.dataset.options = now;
    control.replaceChildren(...options.map(([key, text]) => made("option", { value: key }, text)));
  }
  control.value = options.some(([key]) => key === value) ? value : options[0]?.[0] ?? "";
}
const labelled = (text: string, control: HTMLElement, unit = "") => made("label", { className: "field" }, made("span", {}, text), made("span", {}, control, unit && ` ${unit}`));

export const versionText = (one: Version) => [one.id.slice(0, 12), one.id === "nominal" ? "" : (one.title || one.kind).slice(0, 60), named(one) && `(${named(one)})`].filter(Boolean).join(" ");
const recordings = (): Option[] => known.recordings.map((one) => [one.id, `${one.name}, ${size(one.bytes)}`]);
const versions = (): Option[] => known.versions.map((one) => [one.id, versionText(one)]);

const version = made("select", { id: "version" }), holdout = made("select", { id: "holdout" }), other = made("select", { id: "elsewhere" });
const others = made("select", { id: "other" }), onset = made("input", { type: "number", id: "onset", step: "0.01", placeholder: "estimated" });
const lag = made("input", { type: "number", id: "lag", step: "1", value: "0" }), joints = made("input", { id: "learn-joints", placeholder: "all", list: "joint-names" });
const within = made("input", { type: "number", id: "within", min: "1", max: "86400", placeholder: "none" });
const names = made("datalist", { id: "joint-names" }, ...facts.joints.map((name) => made("option", { value: name }, short(name))));

version.addEventListener("change", () => select({ version: version.value }));
holdout.addEventListener("change", () => select({ holdout: holdout.value }));
others.addEventListener("change", () => select({ others: others.value ? [others.value, ...selection.others.slice(1, 2)] : [] }));
onset.addEventListener("change", () => select({ onset: onset.value }));
lag.addEventListener("change", () => select({ lag: lag.value || "0" }));

export const fields = {
  version: () => labelled("Version", version),
  others: () => labelled("Beside it", others),
  holdout: () => labelled("Validation data", holdout),
  elsewhere: () => labelled("Another recording", other),
  elsewhereValue: () => other.value,
  onset: () => labelled("Commands begin at", onset, "s"),
  lag: () => labelled("Time offset of the prediction", lag, "ms"),
  joints: () => labelled("Only joints", made("span", {}, joints, names)),
  within: () => labelled("Time limit", within, "s"),
  diagnosis: () => ({
    joints: joints.value.split(/[\s,]+/).filter(Boolean).map((name) => facts.joints.find((one) => short(one) === name) ?? name),
    ...(within.value ? { within_s: Number(within.value) } : {}),
  }),
};

function refill(): void {
  fill(version, versions(), selection.version);
  fill(others, [["", "no other"], ...versions().filter(([id]) => id !== selection.version)], selection.others[0] ?? "");
  fill(holdout, [["", "every third stretch of the recording"], ...recordings().filter(([id]) => id !== selection.source)], selection.holdout);
  fill(other, [["", "choose one"], ...recordings().filter(([id]) => id !== selection.source)], other.value || selection.holdout);
  if (document.activeElement !== onset) onset.value = selection.onset;
  if (document.activeElement !== lag) lag.value = selection.lag;
}

export function start(): void {
  hear(["recordings", "versions"], refill);
  on(["version", "others", "holdout", "source", "onset", "lag"], refill);
  refill();
}
