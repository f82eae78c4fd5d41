// The live view: what comes twenty times a second, and what is known of the daemon.
import { element, facts, made, milli, needsAuthorization, number, post, row, say, works } from "./page.js";
import * as fleet from "./hands.js";
import * as space from "./space.js";
import { draw } from "./strip.js";

const SHOWN_S = 10, SORT_EVERY_MS = 2000, AGAIN_MS = [250, 500, 1000, 2000];
const GOOD = { following: "good", no_commands: "odd", waiting: "odd" };
const names = facts.joints;
const kept = { t: [], measured: names.map(() => []), predicted: names.map(() => []) };
const strips = new Map(); // by number of the joint
let rms = names.map(() => null), drifting = [], sorted = 0, failures = 0, held = false, news = false, frames = [];
let socket = null, hands = null;

export function start() {
  element("joints").append(...names.map((name) => row(name, "", "", "", "", "")));
  element("strips-shown").addEventListener("change", () => arrange());
  element("strips-hold").addEventListener("click", hold);
  space.start();
  element("space-open").addEventListener("click", inSpace);
  element("space-open").hidden = !facts.bones.length;
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.closest("input, select")) return;
    if (event.key === "h") hold();
    if (event.key === "s" && facts.bones.length && !element("view-live").hidden) inSpace();
  });
  needsAuthorization(element("keep"));
  works(element("keep"), async () => {
    const answer = await post("/api/keep", { hand: facts.namespace });
    say(answer.kept ? `Kept ${answer.seconds.toFixed(0)} s as ${answer.path} on the daemon's machine. If that is this one, it is in the list under Compare.`
      : `Nothing was kept: ${answer.why}`, answer.kept ? "note" : "error");
    dispatchEvent(new Event("recordings"));
  });
  works(element("stop"), async () => {
    const answer = await post("/api/stop", { hand: facts.namespace, reason: "the stop of the workbench" });
    say(`${answer.words}.`, answer.safe ? "note" : "error");
  });
  works(element("cancel"), async () => {
    const answer = await post("/api/cancel", { hand: facts.namespace, reason: "the page of the workbench" });
    say(`${answer.why}.`, "note");
  });
  needsAuthorization(element("release"));
  works(element("release"), async () => {
    const [reason, name, key] = ["reason", "name", "key"].map((part) => element(`release-${part}`).value);
    element("release-key").value = ""; // it is for one request, and kept nowhere
    const answer = await post("/api/release", { hand: facts.namespace, reason, name, key });
    say(answer.accepted ? "Released; not armed." : `Not released: ${answer.why}. ${answer.allowed ?? ""}`, answer.accepted ? "note" : "error");
    if (answer.accepted) element("release-reason").value = "";
  });
  connect();
  requestAnimationFrame(tick);
}

export const show = () => { news = true; };

function hold() {
  held = !held;
  element("strips-hold").setAttribute("aria-pressed", String(held));
}

// The stream carries the hands in space only while somebody looks at them.
function inSpace() {
  const open = element("space-box").hidden;
  element("space-box").hidden = !open;
  element("space-open").setAttribute("aria-expanded", String(open));
  hands = null;
  if (socket) socket.onclose = null;
  socket?.close();
  connect();
}

function connect() {
  const hand = encodeURIComponent(facts.namespace), open = element("space-box").hidden ? "" : "&space=1";
  socket = new WebSocket(`ws://${location.host}/live?hand=${hand}${open}`);
  socket.onmessage = (event) => { failures = 0; take(JSON.parse(event.data)); };
  socket.onclose = () => {
    presence("lost", "bad", "The workbench's server is away. What is shown is from before; this page tries again by itself.");
    setTimeout(connect, AGAIN_MS[Math.min(failures++, AGAIN_MS.length - 1)]);
  };
}

function take(frame) {
  if (frame.fresh) for (const list of [kept.t, ...kept.measured, ...kept.predicted]) list.length = 0;
  if (frame.t) {
    kept.t.push(...frame.t);
    frame.measured.forEach((values, joint) => kept.measured[joint].push(...values));
    frame.predicted.forEach((values, joint) => kept.predicted[joint].push(...values));
    const old = kept.t.findIndex((time) => time > kept.t[kept.t.length - 1] - SHOWN_S);
    if (old > 0) for (const list of [kept.t, ...kept.measured, ...kept.predicted]) list.splice(0, old);
    hands = frame.hands ?? null;
    news = true;
  }
  if (frame.about) {
    rms = frame.rms;
    about(frame.about);
    if (facts.fleet) fleet.show(frame.fleet);
    if (!held && performance.now() - sorted > SORT_EVERY_MS) arrange();
    table();
  }
}

function presence(word, look, words) {
  const badge = element("presence");
  if (badge.textContent !== word) badge.textContent = word;
  badge.className = `word ${look}`;
  if (element("words").textContent !== words) element("words").textContent = words;
}

function about(known) {
  element("automatic").hidden = !known.automatic;
  if (element("automatic-words").textContent !== (known.automatic ?? "")) element("automatic-words").textContent = known.automatic ?? "";
  element("release-box").hidden = known.gate !== "stopped";
  presence(known.presence.replace("_", " "), GOOD[known.presence] ?? "bad", known.words);
  drifting = known.drifting_joints;
  const version = known.version ? `${known.version.slice(0, 12)}${known.version_title ? `, ${known.version_title}` : ""}` : "unknown";
  const said = {
    version, drift: known.drift ? known.drift + (drifting.length ? `: ${drifting.join(", ")}` : "") : "unknown",
    gate: known.gate ?? "none", "next recalibration": known.recalibration ?? "unknown", rate: known.rate_hz ? `${number(known.rate_hz, 4)} Hz` : "unknown",
    "p99 latency": known.latency_p99_s ? `${milli(known.latency_p99_s)} ms` : "unknown",
    missing: known.missing ?? 0, late: known.late ?? 0, refused: known.refused, errors: known.errors ?? 0,
  };
  element("about").replaceChildren(...Object.entries(said).map(([name, value]) =>
    made("li", {}, made("span", {}, `${name} `), String(value))));
  element("events").replaceChildren(...known.events.slice().reverse().map((event) =>
    made("li", {}, `${new Date(event.stamp_ns / 1e6).toLocaleTimeString()} ${event.kind}: ${event.text}`)));
}

const fixed = (value) => (value === null ? "unknown" : value.toFixed(4));
const order = () => names.map((_, joint) => joint).sort((a, b) => (rms[b] ?? -1) - (rms[a] ?? -1));

function arrange() {
  sorted = performance.now();
  const wanted = order().slice(0, Number(element("strips-shown").value)), box = element("strips");
  for (const [joint, strip] of strips) if (!wanted.includes(joint)) { strip.figure.remove(); strips.delete(joint); }
  wanted.forEach((joint, place) => {
    if (!strips.has(joint)) {
      const canvas = made("canvas", { role: "img", "aria-label": `${names[joint]}: measured and twin over the last ${SHOWN_S} s, the residual below` });
      const now = made("span", { className: "soft" });
      strips.set(joint, { canvas, now, figure: made("figure", {}, made("figcaption", {}, made("b", {}, names[joint]), " ", now), canvas) });
    }
    const { figure } = strips.get(joint);
    if (box.children[place] !== figure) box.insertBefore(figure, box.children[place] ?? null);
  });
  news = true;
}

function table() {
  const body = element("joints"), last = kept.t.length - 1;
  const rows = [...body.children], byName = new Map(rows.map((tr) => [tr.firstChild.textContent, tr]));
  order().forEach((joint, place) => {
    const tr = byName.get(names[joint]), cells = tr.children;
    const measured = kept.measured[joint][last] ?? null, predicted = kept.predicted[joint][last] ?? null;
    const residual = measured === null || predicted === null ? null : measured - predicted;
    const texts = [fixed(measured), fixed(predicted), milli(residual), milli(rms[joint]), drifting.includes(names[joint]) ? "drifting" : "no"];
    texts.forEach((text, index) => { if (cells[index + 1].textContent !== text) cells[index + 1].textContent = text; });
    if (!held && body.children[place] !== tr) body.insertBefore(tr, body.children[place]);
  });
}

function tick(now) {
  requestAnimationFrame(tick);
  if (!news || held || element("view-live").hidden) return;
  news = false;
  for (const [joint, strip] of strips) {
    strip.now.textContent = `rms ${milli(rms[joint])} mrad`;
    draw(strip.canvas, kept.t, kept.measured[joint], kept.predicted[joint], SHOWN_S);
  }
  const at = kept.t.length - 1;
  if (hands) space.draw(hands, names.map((_, joint) => {
    const measured = kept.measured[joint][at] ?? null, predicted = kept.predicted[joint][at] ?? null;
    return measured === null || predicted === null ? null : measured - predicted;
  }));
  frames = [...frames.filter((time) => time > now - 2000), now];
  element("strips-rate").textContent = `drawn ${Math.round(frames.length / 2)} times a second`;
  document.documentElement.dataset.points = String(kept.t.length);
  document.documentElement.dataset.spans = String((kept.t[at] ?? 0) - (kept.t[0] ?? 0));
  document.documentElement.dataset.frames = String(Number(document.documentElement.dataset.frames ?? 0) + 1);
}
