// Versions: the nominal model first, each under the one it was made from; tick two to compare, promote or roll back.
import { needsAuthorization, post, read, say, works } from "./api";
import { hear, known, named, type Version } from "./data";
import { made, number, put, row, table } from "./dom";
import { versionText } from "./fields";
import { exporting, promoting, rollback } from "./promotion";
import { select, selection } from "./state";
import { lines } from "./sketch";

const current = made("span", { id: "current" }), problems = made("p", { id: "problems", role: "status" }), tree = made("div"), differences = made("ul", { id: "differences" });
const parameter = made("select", { id: "parameter" }), chart = made("div", { id: "parameter-chart" });
const compare = made("button", { type: "button", id: "diff", disabled: true }, "What differs between the two that are ticked");
const about = made("section", { id: "about-version", hidden: true });
const all = made("input", { type: "checkbox", id: "diff-all" });
const changing = made("ul", { id: "changing", className: "tight" }), DAY_MS = 86_400_000;
interface Series { name: string; unit: string; words: string; points: { at: string; value: number; ci95: [number, number] | null }[]; levels: { at: string; value: number; ci95: [number, number] }[] }
export const panel = made("div", { className: "panel history" }, made("p", { className: "controls" }, rollback(), current), problems, tree,
  about, made("p", { className: "controls" }, compare, made("label", {}, all, " with what is the same")), differences, changing, made("p", { className: "controls" }, made("label", {}, "A parameter over time ", parameter)), chart);
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
    made("span", { className: "controls" }, inUse ? "in use" : promoting(one.id), exporting(one.id), detail(one)), tick);
  found.dataset.version = one.id;
  found.classList.toggle("current", inUse);
  return found;
}

const WORDS: Record<string, string> = { stored: "stored", named: "named", unnamed: "lost the name", promoted: "promoted", rolled_back: "in use again after a roll-back", rejected: "rejected", noted: "note" };

// What was done to one version, when and why; its notes and names, and the way to write more.
function detail(one: Version): HTMLButtonElement {
  const button = made("button", { type: "button", "data-detail": one.id, "aria-expanded": String(about.dataset.version === one.id) }, one.notes.length ? `Notes (${one.notes.length})` : "Notes");
  button.addEventListener("click", () => { about.dataset.version = about.dataset.version === one.id ? "" : one.id; show(); });
  return button;
}

function showDetail(): void {
  const one = known.versions.find((found) => found.id === about.dataset.version);
  about.hidden = !one;
  if (!one || about.contains(document.activeElement) && document.activeElement!.tagName === "INPUT" && (document.activeElement as HTMLInputElement).value) return;
  const done = known.decisions.filter((found) => found.version === one.id), own = one.names.filter((name) => !["current", "previous", "candidate", "nominal", one.id].includes(name));
  const text = made("input", { id: "note-text", maxLength: 400, placeholder: "what one should know of it", "aria-label": "Note" }), tag = made("input", { id: "tag-name", maxLength: 60, placeholder: "letters, digits and _.-", "aria-label": "Name" });
  const write = async (path: string, body: object, words: string) => { text.value = ""; tag.value = ""; (document.activeElement as HTMLElement | null)?.blur(); await post(path, body); say(words, "note"); dispatchEvent(new Event("versions-changed")); };
  const note = needsAuthorization(made("button", { type: "button", id: "note-add" }, "Write a note")), name = needsAuthorization(made("button", { type: "button", id: "tag-add" }, "Give it the name"));
  works(note, () => write("/api/versions/note", { version: one.id, text: text.value }, "The note stands beside the version."));
  works(name, () => write("/api/versions/tag", { version: one.id, name: tag.value }, "The name points at the version."));
  about.replaceChildren(made("h3", {}, versionText(one)), one.note ? made("p", {}, one.note) : "",
    made("ul", { className: "tight" }, ...[...done].reverse().map((found) => made("li", {}, made("span", { className: "soft" }, `${new Date(found.at).toLocaleString()} `), `${WORDS[found.what] ?? found.what}${found.name ? ` '${found.name}'` : ""}${found.by ? ` by ${found.by}` : ""}${found.text ? `: ${found.text}` : ""}`)), done.length ? "" : made("li", { className: "soft" }, "Nothing was done to it here.")),
    made("p", { className: "controls" }, text, note), made("p", { className: "controls" }, tag, name, ...own.map((found) => works(needsAuthorization(made("button", { type: "button", "data-untag": found }, `Take the name '${found}' away`)),
      () => write("/api/versions/untag", { name: found }, `Nothing is called '${found}' any more.`)))));
}

function show(): void {
  showDetail();
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
  const { words, same } = (await read<{ words: string[]; same: string[] }>(`/api/versions/diff?${new URLSearchParams({ before: order[0].id, after: order[1].id })}`));
  differences.replaceChildren(made("li", {}, made("b", {}, `${versionText(order[0])} → ${versionText(order[1])}`)), ...(words.length ? words : ["Nothing differs in the terms."]).map((one) => made("li", {}, one)),
    ...(all.checked ? same : []).map((one) => made("li", { className: "soft" }, `the same in both: ${one}`)), !all.checked && same.length ? made("li", { className: "soft" }, `${same.length} more are the same in both.`) : "");
}

async function overTime(): Promise<void> {
  const name = parameter.value;
  chart.replaceChildren();
  if (!name) return;
  const { points } = await read(`/api/versions/parameter?${new URLSearchParams({ name })}`), unit = points[0].unit;
  chart.append(table(unit && unit !== "1" ? `${name} (${unit})` : name, ["made", "value", "95 % from", "to", "version"], points.map((one: any) =>
    row(one.created ? new Date(one.created).toLocaleString() : "-", number(one.value, 4), one.ci95 ? number(one.ci95[0]) : "unknown", one.ci95 ? number(one.ci95[1]) : "unknown", one.version.slice(0, 12)))));
  const promoted = (await seriesOf(name)).find((one) => one.name === name);
  if (!promoted || promoted.points.length < 2 || parameter.value !== name) return;
  chart.append(made("p", {}, promoted.words), trend(promoted));
}

const seriesOf = async (name = ""): Promise<Series[]> =>
  known.decisions.some((one) => one.what === "promoted") ? (await read<{ series: Series[] }>(`/api/versions/history?${new URLSearchParams(name ? { name } : {})}`)).series : [];

// What was found at each promotion, and the smoothed level with its band between the first and the last.
function trend(one: Series): HTMLElement {
  const days = (at: string) => (Date.parse(at) - Date.parse(one.points[0].at)) / DAY_MS, levels = new Map(one.levels.map((level) => [level.at, level]));
  const found = new Map(one.points.map((point) => [point.at, point.value])), times = [...new Set([...found.keys(), ...levels.keys()])].sort((a, b) => days(a) - days(b));
  const level = (pick: (level: Series["levels"][number]) => number) => times.map((at) => { const here = levels.get(at); return here ? pick(here) : null; });
  return lines(one.name, times.map(days), [["found", "twin", times.map((at) => found.get(at) ?? null)], ["level", "ink", level((here) => here.value)],
    ["95 % from", "soft", level((here) => here.ci95[0])], ["to", "soft", level((here) => here.ci95[1])]], one.unit === "1" ? "" : one.unit, "days");
}

// The parameters that move, the most urgent first: a click draws one.
async function showChanging(): Promise<void> {
  const moving = await seriesOf();
  changing.replaceChildren(...moving.map((one) => {
    const button = made("button", { type: "button", "data-series": one.name }, one.name);
    button.addEventListener("click", () => { parameter.value = one.name; overTime().catch(() => undefined); });
    return made("li", {}, button, ` ${one.words}`);
  }));
}

export function start(): void {
  works(compare, differ);
  compare.disabled = true;
  all.addEventListener("change", () => { if (differences.children.length && ticked.length === 2) compare.click(); });
  parameter.addEventListener("change", () => { overTime().catch(() => undefined); });
  hear(["versions"], () => { show(); showChanging().catch(() => undefined); });
  show();
}
