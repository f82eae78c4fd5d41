// One timeline for everything: the residual over time, the part on the screen, the moment, and marks worth a look.
import { hear, known, moment } from "./data";
import { icon, made, put, short } from "./dom";
import { SHOWN_S, kept, now, residual } from "./live";
import { facts, failed, read } from "./api";
import { colour, live, on, onTheme, select, selection } from "./state";
import play from "lucide-static/icons/play.svg?raw";
import pause from "lucide-static/icons/pause.svg?raw";

const canvas = made("canvas", { id: "timeline-canvas", tabIndex: 0, role: "slider", "aria-label": "Moment of the recording", "aria-valuemin": "0" });
const time = made("output", { id: "time", className: "time" }), button = made("button", { type: "button", id: "play" });
const marks = made("div", { className: "marks" });
export const footer = made("footer", { id: "timeline" }, button, made("div", { className: "track" }, canvas, marks), time);
let playing = false, last = 0;

const end = () => known.opened?.seconds ?? 0;

function draw(): void {
  const ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (!width) return;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const pen = canvas.getContext("2d")!;
  pen.scale(ratio, ratio);
  const values = live() ? liveValues() : known.overview?.rms_mrad ?? [], most = Math.max(...values, 1e-9);
  if (!live() && selection.range) {
    const [from, to] = selection.range;
    pen.fillStyle = colour("shade");
    pen.fillRect((width * from) / end(), 0, (width * (to - from)) / end(), height);
  }
  pen.strokeStyle = colour("twin");
  pen.lineWidth = 1.3;
  pen.beginPath();
  values.forEach((value, at) => pen.lineTo((width * at) / Math.max(values.length - 1, 1), height - 4 - ((height - 10) * value) / most));
  pen.stroke();
  if (!live() && selection.at !== null && end()) {
    pen.fillStyle = colour("accent");
    pen.fillRect((width * selection.at) / end() - 1, 0, 2.5, height);
  }
  const moment_ = selection.at ?? 0;
  put(time, live() ? `last ${SHOWN_S} s` : end() ? `${moment_.toFixed(2)} / ${end().toFixed(2)} s` : "");
  canvas.setAttribute("aria-valuemax", end().toFixed(2));
  canvas.setAttribute("aria-valuenow", moment_.toFixed(2));
  canvas.setAttribute("aria-valuetext", live() ? "live" : `${moment_.toFixed(2)} of ${end().toFixed(2)} seconds`);
  button.disabled = live() || !end();
}

function liveValues(): number[] {
  const joint = facts.joints.indexOf(selection.joint);
  return joint < 0 ? [] : kept.t.map((_, at) => 1e3 * Math.abs(residual(joint, at) ?? 0));
}

interface Mark { time: number; kind: "worst" | "reversal" | "version" | "event"; words: string; act: () => void }
let turns: { of: string; times: number[] } = { of: "", times: [] };

// When a version was promoted or taken back, and what the daemon said: by the wall clock of the recording.
function dated(): Mark[] {
  const begin = known.opened?.begin_s ?? 0, go = (time: number) => () => select({ at: time });
  const named = { promoted: "promoted", rolled_back: "rolled back" } as Record<string, string>;
  const decided = known.decisions.filter((one) => named[one.what]).map((one): Mark => {
    const time = Date.parse(one.at) / 1e3 - begin;
    return { time, kind: "version", words: `${(one.version ?? "").slice(0, 12)} ${named[one.what]} at ${time.toFixed(2)} s${one.text ? `: ${one.text}` : ""}`, act: go(time) };
  });
  const said = (now.about?.events ?? []).map((one): Mark => {
    const time = one.stamp_ns / 1e9 - begin;
    return { time, kind: "event", words: `${one.kind.replaceAll("_", " ")} at ${time.toFixed(2)} s: ${one.text}`, act: go(time) };
  });
  return [...decided, ...said].filter((one) => one.time >= 0 && one.time <= end());
}

function showMarks(): void {
  const found: Mark[] = [];
  if (!live() && end()) {
    if (turns.of === turnsKey()) found.push(...turns.times.map((time): Mark => ({ time, kind: "reversal", words: `${short(selection.joint)} turns back at ${time.toFixed(2)} s`, act: () => moment(selection.joint, time) })));
    found.push(...dated());
    found.push(...(known.overview?.worst ?? []).map((one): Mark => ({ time: one.time_s, kind: "worst", words: `Worst of ${short(one.joint)}, ${one.condition}, at ${one.time_s.toFixed(2)} s`, act: () => moment(one.joint, one.time_s) })));
  }
  marks.replaceChildren(...found.map(({ time, kind, words, act }) => {
    const button_ = made("button", { type: "button", className: `mark ${kind}`, title: words, "aria-label": words, tabIndex: kind === "reversal" ? -1 : 0 });
    button_.style.left = `${(100 * time) / end()}%`;
    button_.addEventListener("click", act);
    return button_;
  }));
}

const turnsKey = () => `${selection.source} ${selection.joint}`;
async function findTurns(): Promise<void> {
  const key = turnsKey();
  if (live() || !known.overview?.joints.some((one) => one.name === selection.joint) || turns.of === key) { showMarks(); return; }
  const { times } = await read<{ times: number[] }>(`/api/reversals?${new URLSearchParams({ recording: selection.source, joint: selection.joint })}`);
  if (key === turnsKey()) { turns = { of: key, times }; showMarks(); }
}

function toggle(to = !playing): void {
  playing = to && !live() && end() > 0;
  button.replaceChildren(icon(playing ? pause : play), playing ? "Pause" : "Play");
  if (!playing) return;
  last = performance.now();
  if (selection.at === null || selection.at >= end()) select({ at: selection.range?.[0] ?? 0 });
  requestAnimationFrame(step);
}

function step(clock: number): void {
  if (!playing) return;
  const at = (selection.at ?? 0) + (clock - last) / 1e3;
  last = clock;
  if (at >= end()) { select({ at: end() }); toggle(false); return; }
  select({ at });
  requestAnimationFrame(step);
}

export function start(): void {
  button.addEventListener("click", () => toggle());
  let from: number | null = null;
  const at = (event: PointerEvent) => Math.max(0, Math.min(1, event.offsetX / canvas.clientWidth)) * end();
  canvas.addEventListener("pointerdown", (event) => {
    if (live() || !end()) return;
    canvas.setPointerCapture(event.pointerId);
    from = at(event);
    if (!event.shiftKey) select({ at: from });
  });
  canvas.addEventListener("pointermove", (event) => {
    if (from === null) return;
    const to = at(event);
    if (event.shiftKey) { if (Math.abs(to - from) > 0.01) select({ range: [Math.min(from, to), Math.max(from, to)] }); } else select({ at: to });
  });
  canvas.addEventListener("pointerup", () => { from = null; });
  canvas.addEventListener("dblclick", () => select({ range: null }));
  canvas.addEventListener("keydown", (event) => {
    if (live() || !end()) return;
    const here = selection.at ?? 0, leap = end() * (event.shiftKey ? 0.05 : 0.005);
    const to: Record<string, number> = { ArrowLeft: here - leap, ArrowRight: here + leap, Home: 0, End: end() };
    if (!Object.hasOwn(to, event.key)) return;
    event.preventDefault();
    select({ at: Math.max(0, Math.min(end(), to[event.key])) });
  });
  new ResizeObserver(draw).observe(canvas);
  on(["at", "range", "source", "joint"], draw);
  on(["source"], () => toggle(false));
  hear(["opened", "overview"], () => { draw(); findTurns().catch(failed); });
  hear(["versions"], showMarks);
  on(["joint"], () => { findTurns().catch(failed); });
  onTheme(draw);
  let drawnAt = 0;
  addEventListener("samples", () => { if (live() && performance.now() - drawnAt > 100) { drawnAt = performance.now(); draw(); } });
  toggle(false);
  draw();
}
export const playPause = () => toggle();
