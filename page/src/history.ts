// Versions: the nominal model first, each under the one it was made from; tick two to compare, promote or roll back.
import { read, works } from "./api";
import { hear, known, named, type Version } from "./data";
import { made, number, put, row, table } from "./dom";
import { versionText } from "./fields";
import { exporting, promoting, rollback } from "./promotion";
import { select, selection } from "./state";
import { lines } from "./sketch";

const current = made("span", { id: "current" }), problems = made("p", { id: "problems", role: "status" }), tree = made("div"), differences = made("ul", { id: "differences" });
const parameter = made("select", { id: "parameter" }), chart = made("div", { id: "parameter-chart" });
const compare = made("button", { type: "button", id: "diff", disabled: true }, "What differs between the two that are ticked");
export const panel = made("div", { className: "panel history" }, made("p", { className: "controls" }, rollback(), current), problems, tree,
  made("p", { className: "controls" }, compare), differences, made("p", { className: "controls" }, made("label", {}, "A parameter over time ", parameter)), chart);
const ticked: string[] = [];

function line(one: Version): HTMLElement {
  const tick = made("input", { type: "checkbox", checked: ticked.includes(one.id), "aria-label": `compare ${one.id.slice(0, 12)}` });
  tick.addEventListener("change", () => {
    if (tick.checked) ticked.push(one.id); else ticked.splice(ticked.indexOf(one.id), 1);
    while (ticked.length > 2) ticked.shift();
    for (const box of tree.querySelectorAll<HTMLInputElement>("input")) box.checked = ticked.includes(box.closest("tr")!.dataset.version!);
    compare.disabled = ticked.length !== 2;
    // the curves and errors of what is ticked stand beside the version that is looked at
    select({ others: ticked.filter((id) => id !== selection.version) });
  });
  const names = [named(one), one.shipped ? "shipped" : ""].filter(Boolean).join(", "), inUse = one.id === known.aliases.current;
  const found = row(`${"  ".repeat(one.depth)}${one.depth ? "└ " : ""}${one.id.slice(0, 12)}`, made("span", {}, one.id === "nominal" ? "the model as it was made" : one.title || one.kind), made("span", {}, names),
    number(one.errors.before), number(one.errors.after), number(one.errors.holdout_after), made("span", {}, one.created ? new Date(one.created).toLocaleString() : "-"),
    made("span", { className: "controls" }, inUse ? "in use" : promoting(one.id), exporting(one.id)), tick);
  found.dataset.version = one.id;
  found.classList.toggle("current", inUse);
  return found;
}

function show(): void {
  put(current, `In use: ${(known.aliases.current ?? "").slice(0, 12)}.`);
  put(problems, known.problems.length ? `Damaged: ${known.problems.join(" ")}` : "");
  const first = [...known.versions].sort((a, b) => Number(b.id === "nominal") - Number(a.id === "nominal"));
  tree.replaceChildren(table("Each under the one that it was made from; errors are mean squares in rad²", ["version", "what", "names", "before", "after", "held out", "made", "do", "compare"], first.map(line), "versions"));
  const before = parameter.value;
  parameter.replaceChildren(made("option", { value: "" }, known.parameters.length ? "choose one" : "none is set yet"), ...known.parameters.map((name) => made("option", {}, name)));
  if (known.parameters.includes(before)) parameter.value = before;
}

async function differ(): Promise<void> {
  const order = known.versions.filter((one) => ticked.includes(one.id));
  const words: string[] = (await read(`/api/versions/diff?${new URLSearchParams({ before: order[0].id, after: order[1].id })}`)).words;
  differences.replaceChildren(made("li", {}, made("b", {}, `${versionText(order[0])} → ${versionText(order[1])}`)), ...(words.length ? words : ["Nothing differs in the terms."]).map((one) => made("li", {}, one)));
}

async function overTime(): Promise<void> {
  const name = parameter.value;
  chart.replaceChildren();
  if (!name) return;
  const { points } = await read(`/api/versions/parameter?${new URLSearchParams({ name })}`), unit = points[0].unit;
  chart.append(table(unit ? `${name} (${unit})` : name, ["made", "value", "95 % from", "to", "version"], points.map((one: any) =>
    row(one.created ? new Date(one.created).toLocaleString() : "-", number(one.value, 4), one.ci95 ? number(one.ci95[0]) : "unknown", one.ci95 ? number(one.ci95[1]) : "unknown", one.version.slice(0, 12)))));
  if (points.length < 2) return;
  const band = (index: number) => points.map((one: any) => one.ci95?.[index] ?? null);
  chart.append(lines(name, points.map((_: any, at: number) => at + 1), [["value", "twin", points.map((one: any) => one.value)], ["95 % from", "soft", band(0)], ["to", "soft", band(1)]], unit, "of the versions"));
}

export function start(): void {
  works(compare, differ);
  compare.disabled = true;
  parameter.addEventListener("change", () => { overTime().catch(() => undefined); });
  hear(["versions"], show);
  show();
}
