// One strip: measured and twin above, their difference below, over the last seconds.
import { colour, onTheme } from "./state";

const UNSEEN_PX = 0.3;

let colours: Record<string, string> | null = null;
onTheme(() => { colours = null; });

function look(): Record<string, string> {
  colours ??= { measured: colour("ink"), twin: colour("twin"), residual: colour("accent"), line: colour("line"), soft: colour("soft") };
  return colours;
}

type Row = (number | null)[];
type Pen = CanvasRenderingContext2D;
type Point = [number, number];
const slope = (from: Point, to: Point) => (to[1] - from[1]) / (to[0] - from[0]);

export function draw(canvas: HTMLCanvasElement, times: number[], measured: Row, predicted: Row, seconds: number): void {
  const ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio)) { canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio); }
  const pen = canvas.getContext("2d")!, { measured: ink, twin, residual, line, soft } = look();
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  if (!times.length) return;
  const end = times[times.length - 1], split = Math.round(height * 0.62);
  const x = (time: number) => width * (1 - (end - time) / seconds);
  let low = Infinity, high = -Infinity, worst = 0;
  for (let at = 0; at < times.length; at += 1) {
    const one = measured[at], other = predicted[at];
    if (one !== null) { low = Math.min(low, one); high = Math.max(high, one); }
    if (other !== null) { low = Math.min(low, other); high = Math.max(high, other); }
    if (one !== null && other !== null) worst = Math.max(worst, Math.abs(one - other));
  }
  if (low > high) return;
  const room = Math.max(high - low, 0.02) * 0.08, middle = (low + high) / 2, half = Math.max(high - low, 0.02) / 2 + room;
  const scale = niceAbove(Math.max(worst, 1e-4)), below = height - split;
  const above = (value: number) => split * (0.5 - (value - middle) / (2 * half));
  const under = (value: number) => split + below * (0.5 - value / (2.1 * scale));
  pen.strokeStyle = line;
  pen.lineWidth = 1;
  stroke(pen, [[0, split], [width, split]]);
  stroke(pen, [[0, split + below / 2], [width, split + below / 2]]);
  curve(pen, times, measured, x, above, ink, []);
  curve(pen, times, predicted, x, above, twin, [5, 3]);
  curve(pen, times, measured.map((one, at) => (one === null || predicted[at] === null ? null : one - predicted[at]!)), x, under, residual, []);
  pen.fillStyle = soft;
  pen.font = "11px Inter, sans-serif";
  pen.fillText(`${high.toFixed(2)} rad`, 4, 12);
  pen.fillText(`${low.toFixed(2)}`, 4, split - 4);
  pen.fillText(`±${+(1e3 * scale).toPrecision(2)} mrad`, 4, split + 12);
}

function stroke(pen: Pen, points: number[][]): void {
  pen.beginPath();
  for (const [x, y] of points) pen.lineTo(x, y);
  pen.stroke();
}

// Points that a straight line passes by closer than anybody sees are left out: a strip of ten seconds has four to a pixel.
function curve(pen: Pen, times: number[], values: Row, x: (time: number) => number, y: (value: number) => number, ink: string, dash: number[]): void {
  pen.strokeStyle = ink;
  pen.lineWidth = 1.5;
  pen.setLineDash(dash);
  pen.beginPath();
  let from: Point | null = null, to: Point = [0, 0], least = -Infinity, most = Infinity;
  for (let at = 0; at < times.length; at += 1) {
    const value = values[at];
    if (value === null) {
      if (from) pen.lineTo(...to);
      from = null;
      continue;
    }
    const point: Point = [x(times[at]), y(value)];
    if (!from) {
      pen.moveTo(...point);
      [from, least, most] = [point, -Infinity, Infinity];
    } else {
      const steep = slope(from, point);
      if (!(steep >= least && steep <= most)) { // neither is so of two points at the same place
        pen.lineTo(...to);
        [from, least, most] = [to, -Infinity, Infinity];
      }
      const slack = UNSEEN_PX / (point[0] - from[0]), now = slope(from, point);
      [least, most] = [Math.max(least, now - slack), Math.min(most, now + slack)];
    }
    to = point;
  }
  if (from) pen.lineTo(...to);
  pen.stroke();
  pen.setLineDash([]);
}

function niceAbove(value: number): number {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((step) => step * power).find((step) => step >= value) ?? value;
}
