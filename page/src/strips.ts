// All joints live: strip charts with the worst first, a table, and the events.
import { facts } from "./api";
import { mark } from "./data";
import { made, milli, put, row, short } from "./dom";
import { SHOWN_S, kept, now, residual, worstFirst } from "./live";
import { select } from "./state";
import { draw } from "./strip";

const SORT_EVERY_MS = 2000, RATE_EVERY_MS = 500;
const EACH_MS = 100; // of ten seconds on some 300 px a curve moves by three in this time
const count = made("select", { id: "strips-shown" }, ...["4", "8", "12", "all"].map((text) => made("option", { selected: text === "8", value: text === "all" ? "999" : text }, text)));
const hold = made("button", { type: "button", id: "strips-hold", "aria-pressed": "false" }, "Hold ", made("kbd", {}, "h"));
const rate = made("span", { id: "strips-rate", className: "soft" }), box = made("div", { id: "strips" });
const body = made("tbody", { id: "joints" });
const head = ["joint", "measured rad", "predicted rad", "residual mrad", "rms mrad", "drift"].map((text, index) => made("th", { scope: "col", className: index ? "n" : "" }, text));
export const panel = made("div", { className: "panel strips" },
  made("p", { className: "controls" }, made("label", {}, "Charts ", count), hold, rate), box,
  made("div", { className: "scroll" }, made("table", {}, made("caption", {}, "Measured against predicted, rms residual over the last 10 s"), made("thead", {}, made("tr", {}, ...head)), body)));
const events = made("ul", { id: "events" });
export const eventsPanel = made("div", { className: "panel" }, made("h3", {}, "Events of the daemon"), events);

const strips = new Map<number, { canvas: HTMLCanvasElement; now: HTMLElement; figure: HTMLElement }>();
const seen = new Set<Element>(); // of the canvases: what is scrolled away is not drawn
const watch = new IntersectionObserver((changes) => { for (const { target, isIntersecting } of changes) if (isIntersecting) seen.add(target); else seen.delete(target); news = true; });
let held = false, news = false, waiting = 0, sorted = 0, before = 0, next = 0, said = 0, rounds: number[] = [], frames = 0;

export function toggle(): void {
  held = !held;
  hold.setAttribute("aria-pressed", String(held));
  if (held && panel.offsetParent !== null) for (const joint of strips.keys()) drawn(joint); // all of one moment, whichever is looked at then
}

function drawn(joint: number): void {
  const strip = strips.get(joint)!;
  put(strip.now, `rms ${milli(now.rms[joint])} mrad`);
  draw(strip.canvas, kept.t, kept.measured[joint], kept.predicted[joint], SHOWN_S);
}

function arrange(): void {
  sorted = performance.now();
  const wanted = worstFirst().slice(0, Number(count.value));
  for (const [joint, strip] of strips) if (!wanted.includes(joint)) { watch.unobserve(strip.canvas); seen.delete(strip.canvas); strip.figure.remove(); strips.delete(joint); }
  wanted.forEach((joint, place) => {
    if (!strips.has(joint)) {
      const name = facts.joints[joint], said = made("span", { className: "soft" });
      const canvas = made("canvas", { role: "img", "aria-label": `${name}: measured and predicted over the last ${SHOWN_S} s, the residual below` });
      const pick = made("button", { type: "button", className: "plain" }, short(name));
      pick.addEventListener("click", () => select({ joint: name }));
      watch.observe(canvas);
      strips.set(joint, { canvas, now: said, figure: made("figure", {}, made("figcaption", {}, pick, " ", said), canvas) });
    }
    const { figure } = strips.get(joint)!;
    if (box.children[place] !== figure) box.insertBefore(figure, box.children[place] ?? null);
  });
  news = true;
}

const fixed = (value: number | null) => (value === null ? "unknown" : value.toFixed(4));

function rows(): void {
  const last = kept.t.length - 1, drifting = now.about?.drifting_joints ?? [];
  const byName = new Map([...body.children].map((one) => [(one as HTMLElement).dataset.joint!, one]));
  worstFirst().forEach((joint, place) => {
    const name = facts.joints[joint], line = byName.get(name)!;
    const texts = [fixed(kept.measured[joint][last] ?? null), fixed(kept.predicted[joint][last] ?? null), milli(residual(joint)), milli(now.rms[joint]), drifting.includes(name) ? "drifting" : "no"];
    texts.forEach((text, index) => put(line.children[index + 1], text));
    if (!held && body.children[place] !== line) body.insertBefore(line, body.children[place]);
  });
}

function tick(at: number): void {
  requestAnimationFrame(tick);
  const left = waiting > 0 && at - before >= EACH_MS; // nothing more has come since some were drawn
  if (held || !(news || left)) return;
  if (news) {
    news = false;
    waiting = seen.size;
    frames += 1;
    mark("frames", String(frames));
  }
  if (panel.offsetParent !== null) inTurn(at); else waiting = 0;
  before = at;
}

// Some of them in each frame, so that no frame waits for all of them.
function inTurn(at: number): void {
  const all = [...strips.keys()].filter((joint) => seen.has(strips.get(joint)!.canvas)), due = Math.min(waiting, Math.ceil(all.length * Math.min((at - before) / EACH_MS, 1)));
  waiting = all.length ? waiting - due : 0;
  for (let count = 0; count < due; count += 1) {
    next = (next + 1) % all.length;
    drawn(all[next]);
    if (next === 0) rounds.push(at);
  }
  if (at - said < RATE_EVERY_MS) return;
  said = at;
  rounds = rounds.filter((time) => time > at - 2000);
  put(rate, `drawn ${Math.round(rounds.length / 2)} times a second`);
}

export function start(): void {
  body.append(...facts.joints.map((name) => { const line = row(short(name), "", "", "", "", ""); line.dataset.joint = name; return line; }));
  count.addEventListener("change", arrange);
  hold.addEventListener("click", toggle);
  addEventListener("samples", () => { news = true; });
  addEventListener("about", () => {
    if (!held && performance.now() - sorted > SORT_EVERY_MS) arrange();
    rows();
    events.replaceChildren(...(now.about?.events ?? []).slice().reverse().map((event) => made("li", {}, `${new Date(event.stamp_ns / 1e6).toLocaleTimeString()} ${event.kind}: ${event.text}`)));
  });
  requestAnimationFrame(tick);
}
