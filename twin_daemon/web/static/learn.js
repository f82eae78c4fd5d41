// The learn view: starts a diagnosis, an addition or a ladder, follows it, and shows what came of it.
import { show as figure } from "./figures.js";
import { exporting, promoting } from "./history.js";
import { element, made, milli, needsAuthorization, number, post, read, row, say, works } from "./page.js";

const AGAIN_MS = 400, IDLE_MS = 3000, KINDS = ["diagnose", "add", "ladder"];
const NAMES = { diagnose: "The diagnosis", add: "The addition", ladder: "The ladder" };
const seen = { diagnose: null, add: null, ladder: null }; // number and status of what is shown
let effects = [], pictured = "", said = { key: "", count: 0 };

export function start() {
  needsAuthorization(element("diagnose"), element("ladder"), element("add"), element("stop-job"));
  works(element("diagnose"), () => begin("diagnose", { joints: element("learn-joints").value.split(/[\s,]+/).filter(Boolean) }));
  works(element("ladder"), () => begin("ladder", {}));
  works(element("add"), () => begin("add", { effect: element("effect").value, joint: element("place").value }));
  works(element("stop-job"), () => post("/api/job/stop"));
  element("effect").addEventListener("change", explain);
  element("place").addEventListener("change", picture);
  element("effect-more").addEventListener("toggle", picture);
  read("/api/effects").then((found) => {
    effects = found.effects;
    element("effect").replaceChildren(...effects.map((one) => made("option", {}, one.key)));
    element("place").replaceChildren(...found.places.map((name) => made("option", {}, name)));
    explain();
  }).catch((error) => say(error.message));
  follow();
}

function explain() {
  const one = effects.find((effect) => effect.key === element("effect").value);
  element("effect-text").textContent = one
    ? `${one.title} (acts on: ${one.acts_on}). ${one.story.what} ${one.story.shows} Likely cause: ${one.story.cause} What to do: ${one.story.remedy}` : "";
  picture();
}

// The twin with and without the effect, under the same commands; computed only while somebody looks.
async function picture() {
  if (!element("effect-more").open || !effects.length) return;
  const wanted = new URLSearchParams({ effect: element("effect").value, place: element("place").value }).toString(), holder = made("div");
  pictured = wanted;
  element("effect-figure").replaceChildren();
  element("effect-words").textContent = "The twin is being rolled out ...";
  try {
    const found = await read(`/api/effect?${wanted}`);
    if (pictured !== wanted) return;
    element("effect-words").textContent = found.words;
    element("effect-figure").append(holder);
    await figure(holder, found.figure);
  } catch (error) {
    if (pictured === wanted) element("effect-words").textContent = error.message;
  }
}

async function begin(kind, more, recording = element("learn-recording").value) {
  if (!recording) throw new Error("Choose a recording first.");
  await post(`/api/job/${kind}`, { recording, version: element("learn-version").value, holdout: element("learn-holdout").value, ...more });
  await look();
}

// What runs is asked for again and again, in every browser that looks.
async function follow() {
  let wait = IDLE_MS;
  try {
    if (await look()) wait = AGAIN_MS;
  } catch (error) {
    element("job-status").textContent = error.message;
  }
  setTimeout(follow, wait);
}

async function look() {
  const found = await Promise.all(KINDS.map((kind) => read(`/api/job?${new URLSearchParams({ kind, after: said.key.startsWith(`${kind} `) ? said.count : 0 })}`)));
  const latest = found.reduce((best, one, index) => (one.number > (best?.number ?? 0) ? { ...one, kind: KINDS[index] } : best), null);
  if (!latest) return false;
  const key = `${latest.kind} ${latest.number}`, box = element("job-lines");
  if (key !== said.key) { said = { key, count: 0 }; box.textContent = ""; return look(); }
  if (latest.lines.length) {
    box.append(...latest.lines.map((line) => `${line}\n`));
    box.scrollTop = box.scrollHeight;
    said.count = latest.count;
  }
  const about = `${NAMES[latest.kind]} of ${latest.about.recording}${latest.about.effect ? `, ${latest.about.effect} at ${latest.about.joint},` : ""}`;
  element("job-status").textContent = {
    running: `${about} is running: ${latest.count} lines so far.`, done: `${about} has ended after ${latest.seconds.toFixed(0)} s.`,
    failed: `${about} failed: ${latest.error}`, stopped: `${about} was stopped before anything was tested.`,
  }[latest.status];
  for (const [index, kind] of KINDS.entries()) {
    const one = found[index], state = `${one.number} ${one.status}`;
    if (seen[kind] === state) continue;
    seen[kind] = state;
    if (one.result) await ended[kind](one.result, one.about);
  }
  document.documentElement.dataset.job = `${latest.kind} ${latest.status}`;
  return latest.status === "running";
}

const ended = {
  // The server escapes what comes from data, and the page's policy runs no script that is not its own file.
  async diagnose(result, about) {
    element("diagnosis").replaceChildren(...new DOMParser().parseFromString(result.html, "text/html").body.childNodes);
    element("findings").replaceChildren(...result.findings.map((one) => {
      const button = made("button", { type: "button" }, `Add ${one.effect} at ${one.target}`);
      needsAuthorization(button);
      works(button, async () => {
        element("effect").value = one.effect;
        element("place").value = one.target;
        explain();
        element("learn-version").value = about.version;
        await begin("add", { effect: one.effect, joint: one.target }, about.recording_id);
      });
      return made("p", {}, button);
    }));
    element("experiment").replaceChildren();
    if (result.proposed) {
      const button = made("button", { type: "button" }, "Preview the next experiment on the twin");
      works(button, async () => {
        const found = await read("/api/experiment"), holder = made("div");
        element("experiment").append(made("p", {}, `${found.why}. Nothing moves; 'twin command trajectory' runs ${found.path} through the gate.`), holder);
        await figure(holder, found.figure);
        button.hidden = true;
      });
      element("experiment").append(made("p", {}, button));
    }
  },
  async add(result) {
    const chart = made("div"), { before, after, holdout_before: heldBefore, holdout_after: heldAfter } = result, found = result.finding;
    const change = (from, to) => (from.mse_rad2 === null || to.mse_rad2 === null ? "not tested"
      : `${number(from.mse_rad2)} → ${number(to.mse_rad2)} rad² (${milli(Math.sqrt(from.mse_rad2))} → ${milli(Math.sqrt(to.mse_rad2))} mrad)`);
    const worse = heldAfter.mse_rad2 !== null && heldAfter.mse_rad2 >= heldBefore.mse_rad2;
    element("added").replaceChildren(
      made("h3", {}, `${result.effect} at ${result.targets.join(", ")}`),
      made("ul", {}, made("li", {}, `Fitted motion, one free roll-out of the whole hand: ${change(before, after)}`),
        made("li", {}, `Validation data, one free roll-out of the whole hand: ${change(heldBefore, heldAfter)}`),
        ...(result.holdout_joints_after.mse_rad2 === null ? [] : [made("li", {}, `The same over its joints: ${change(result.holdout_joints_before, result.holdout_joints_after)}`)]),
        ...(found ? [made("li", {}, `Validation data, in short pieces of its part: ${change({ mse_rad2: found.holdout_mse_before }, { mse_rad2: found.holdout_mse_after })}`)] : []),
        ...Object.entries(result.parameters).map(([name, one]) => made("li", {}, `${name} = ${number(one.value, 4)} ${one.unit} (95 %: ${number(one.ci95[0])} to ${number(one.ci95[1])})${one.at_bound ? ", on its bound" : ""}`)),
        ...(result.notes ?? []).map((note) => made("li", { className: "soft" }, note))),
      made("p", {}, made("strong", {}, worse ? "Not better on validation data: do not promote it. " : "Better on validation data. "),
        `Stored as candidate ${result.version.slice(0, 12)}; it is used only if it is promoted. `, promoting(result.version), " ", exporting(result.version)), chart);
    await afterwards(result.version, chart, null);
  },
  async ladder(result) {
    const chart = made("div");
    element("added").replaceChildren(made("h3", {}, "The ladder"), made("p", {}, result.words),
      ...(result.version ? [made("p", {}, `Stored as candidate ${result.version.slice(0, 12)}; it is used only if it is promoted. `, promoting(result.version), " ", exporting(result.version))] : []), chart);
    await afterwards(result.version, chart, result.figure);
  },
};

async function afterwards(version, chart, spec) {
  dispatchEvent(new Event("versions"));
  await figure(chart, spec ?? (await read(`/api/versions/ladder?version=${version}`)).figure);
  if (version) document.documentElement.dataset.added = version;
}
