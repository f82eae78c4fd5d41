// The history view: the tree of versions, what differs, parameters over time, promote and roll back.
import { known, named } from "./choices.js";
import { show as figure } from "./figures.js";
import { attempt, element, made, needsAuthorization, number, post, read, row, say, works } from "./page.js";

export function start() {
  needsAuthorization(element("rollback"));
  works(element("rollback"), async () => {
    const answer = await post("/api/versions/rollback");
    say(`Version ${answer.current.slice(0, 12)} (${answer.title}) is in use again.`, "note");
    dispatchEvent(new Event("versions"));
  });
  works(element("diff"), async () => {
    const words = (await read(`/api/versions/diff?${new URLSearchParams({ before: element("diff-before").value, after: element("diff-after").value })}`)).words;
    element("differences").replaceChildren(...(words.length ? words : ["Nothing differs in the terms."]).map((line) => made("li", {}, line)));
  });
  element("parameter").addEventListener("change", () => attempt(parameter));
  addEventListener("versions-listed", list);
}

export const show = () => { dispatchEvent(new Event("versions")); };

export function promoting(id, text = "Promote") {
  const button = made("button", { type: "button" }, text);
  needsAuthorization(button);
  works(button, async () => {
    const worse = known.versions.find((one) => one.id === id)?.worse;
    const reason = worse && prompt(`It is worse than the version in use: ${worse}.\nPromote it all the same? Then say why:`);
    if (worse && !reason?.trim()) return;
    const answer = await post("/api/versions/promote", { version: id, ...(worse ? { force: true, reason } : {}) });
    say(`Version ${answer.current.slice(0, 12)} (${answer.title}) is in use now; a running daemon takes it up within a second or two.`, "note");
    dispatchEvent(new Event("versions"));
  });
  return button;
}

export const exporting = (id) => made("a", { href: `/api/versions/export?version=${encodeURIComponent(id)}`, download: "" }, "MJCF");

function list() {
  const { current } = known.aliases;
  element("current").textContent = `In use: ${current.slice(0, 12)}.`;
  element("problems").textContent = known.problems.length ? `Damaged: ${known.problems.join(" ")}` : "";
  element("versions").replaceChildren(...known.versions.map((one) => {
    const names = [named(one), one.shipped ? "shipped" : ""].filter(Boolean).join(", ");
    const line = row(`${"  ".repeat(one.depth)}${one.depth ? "└ " : ""}${one.id.slice(0, 12)}`, one.title || one.kind, names,
      number(one.errors.before), number(one.errors.after), number(one.errors.holdout_after), one.created ? new Date(one.created).toLocaleString() : "-",
      made("span", {}, one.id === current ? "in use " : promoting(one.id), " ", exporting(one.id)));
    for (const index of [1, 2, 6]) line.children[index].className = "";
    line.classList.toggle("current", one.id === current);
    return line;
  }));
  const select = element("parameter"), before = select.value;
  select.replaceChildren(made("option", { value: "" }, known.parameters.length ? "choose one" : "none is set yet"), ...known.parameters.map((name) => made("option", {}, name)));
  if (known.parameters.includes(before)) select.value = before;
}

async function parameter() {
  const name = element("parameter").value;
  if (!name) return;
  const { points } = await read(`/api/versions/parameter?${new URLSearchParams({ name })}`);
  const side = (index) => points.map((one) => (one.ci95 ? Math.abs(one.ci95[index] - one.value) : 0));
  const holder = made("div");
  element("parameter-chart").replaceChildren(holder);
  const title = document.createElement("span");
  title.textContent = points[0].unit ? `${name} (${points[0].unit})` : name;
  await figure(holder, {
    height: 300, words: `${name} by version, with 95 % intervals where they are known`,
    data: [{
      x: points.map((one) => one.created), y: points.map((one) => one.value), mode: "lines+markers", name: "value",
      text: points.map((one) => one.version.slice(0, 12)), hovertemplate: "%{text}: %{y:.4g}<extra></extra>",
      error_y: { type: "data", symmetric: false, array: side(1), arrayminus: side(0) }, line: { color: "#1971c2", dash: "dot" }, marker: { size: 9 },
    }],
    layout: { margin: { l: 70, r: 16, t: 10, b: 40 }, xaxis: { title: { text: "made" } }, yaxis: { title: { text: title.innerHTML } } },
  });
}
