// One timeline for everything: the residual over time, the part on the screen, the moment, and marks worth a look.
import { hear, known, moment } from "./data";
import { icon, made, put, short } from "./dom";
import { SHOWN_S, kept, residual } from "./live";
import { facts } from "./api";
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
  const now = selection.at ?? 0;
  put(time, live() ? `last ${SHOWN_S} s` : end() ? `${now.toFixed(2)} / ${end().toFixed(2)} s` : "");
  canvas.setAttribute("aria-valuemax", end().toFixed(2));
  canvas.setAttribute("aria-valuenow", now.toFixed(2));
  canvas.setAttribute("aria-valuetext", live() ? "live" : `${now.toFixed(2)} of ${end().toFixed(2)} seconds`);
  button.disabled = live() || !end();
}

function liveValues(): number[] {
  const joint = facts.joints.indexOf(selection.joint);
  return joint < 0 ? [] : kept.t.map((_, at) => 1e3 * Math.abs(residual(joint, at) ?? 0));
}

function showMarks(): void {
  const worst = live() ? [] : known.overview?.worst ?? [];
  marks.replaceChildren(...worst.map((one) => {
    const words = `Worst of ${short(one.joint)}, ${one.condition}, at ${one.time_s.toFixed(2)} s`;
    const found = made("button", { type: "button", className: "mark", title: words, "aria-label": words });
    found.style.left = `${(100 * one.time_s) / end()}%`;
    found.addEventListener("click", () => moment(one.joint, one.time_s));
    return found;
  }));
}

function toggle(to = !playing): void {
  playing = to && !live() && end() > 0;
  button.replaceChildren(icon(playing ? pause : play), playing ? "Pause" : "Play");
  if (!playing) return;
  last = performance.now();
  if (selection.at === null || selection.at >= end()) select({ at: selection.range?.[0] ?? 0 });
  requestAnimationFrame(step);
}

function step(now: number): void {
  if (!playing) return;
  const at = (selection.at ?? 0) + (now - last) / 1e3;
  last = now;
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
  hear(["opened", "overview"], () => { draw(); showMarks(); });
  onTheme(draw);
  let drawnAt = 0;
  addEventListener("samples", () => { if (live() && performance.now() - drawnAt > 100) { drawnAt = performance.now(); draw(); } });
  toggle(false);
  draw();
}
export const playPause = () => toggle();
