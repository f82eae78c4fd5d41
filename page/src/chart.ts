// One joint over time: the angles above, the residual below, with the cursor and the zoom that all charts share.
import uPlot from "uplot";
import { made, put, short } from "./dom";
import { colour } from "./state";
import { sheet, type Stroke } from "./vector";

export interface Curve { unit?: string; t: number[]; measured: (number | null)[]; command?: (number | null)[]; twins: Record<string, (number | null)[]> }
export interface Line { id: string; label: string; look?: string }
export interface Moves { zoom(range: [number, number] | null): void; at(time: number): void; full(): [number, number]; range(): [number, number]; now(): number | null; other(): number | null; mark(time: number): void }

export const COLOURS = ["twin", "better", "third", "fourth", "soft", "command"], DASHES = [[], [8, 4], [3, 3], [10, 3, 2, 3], [2, 2], [12, 4]];
const TIME = "time since the first sample (s)";
const SYNC = uPlot.sync("time");

export class Chart {
  readonly box: HTMLElement;
  private readonly holders = [made("div", { className: "angle" }), made("div", { className: "residual" })];
  private readonly key = made("ul", { className: "key", "aria-label": "Key" });
  private plots: uPlot[] = [];
  private told: { item: HTMLElement; value: HTMLElement }[] = [];
  private lines: string[] = [];
  private strokes: Stroke[][] = [[], []];
  private unit = "rad";
  private heights: ([number, number] | null)[] = [null, null];
  private data: Curve = { t: [], measured: [], twins: {} };

  constructor(readonly joint: string, private readonly moves: Moves, tools: Node[]) {
    this.box = made("figure", { className: "chart", "data-joint": joint },
      made("figcaption", {}, made("b", {}, short(joint)), this.key, ...tools), ...this.holders);
    this.box.setAttribute("aria-label", `${joint}: measured, predicted and commanded over time, the residual below`);
    const sized = new ResizeObserver(() => this.fit());
    for (const holder of this.holders) sized.observe(holder); // the key above may take a line more
  }

  // `fresh` draws new axes and colours.
  show(curve: Curve, lines: Line[], fresh = false): void {
    this.data = curve;
    const wanted = lines.map((one) => one.label), unit = curve.unit ?? "rad";
    if (unit !== this.unit) { this.heights = [null, null]; fresh = true; }
    this.unit = unit;
    if (fresh || !this.plots.length || wanted.join("\n") !== this.lines.join("\n")) {
      this.lines = wanted;
      this.close();
      this.plots = [this.made(0, lines), this.made(1, lines)];
      this.told = [["measured", "ink"], ["command", "command"], ...lines.map((one, index) => [one.label, one.look ?? COLOURS[index]])].map(([name, look]) => {
        const value = made("span", { className: "value" });
        return { item: made("li", {}, made("i", { className: `line ${look}` }), `${name} `, value), value };
      });
      this.key.replaceChildren(...this.told.map((one) => one.item));
    }
    const twins = lines.map((one) => curve.twins[one.id] ?? curve.t.map(() => null));
    const residual = twins.map((twin) => twin.map((value, at) => {
      const measured = curve.measured[at];
      return value === null || measured === null ? null : 1e3 * (measured - value);
    }));
    const command = curve.command ?? curve.t.map(() => null);
    this.plots[0].setData([curve.t, command, curve.measured, ...twins] as uPlot.AlignedData);
    this.plots[1].setData([curve.t, ...residual] as uPlot.AlignedData);
  }

  redraw(): void { for (const plot of this.plots) plot.redraw(false); }
  close(): void { for (const plot of this.plots) plot.destroy(); this.plots = []; }

  csv(): string {
    const [angle, residual] = this.plots;
    const unit = this.unit.replaceAll(/[ /]/g, "_");
    const heads = ["time_s", `command_${unit}`, `measured_${unit}`, ...this.lines.map((name) => `${unit} ${name}`), ...this.lines.map((name) => `residual_m${unit} ${name}`)];
    const columns = [...angle.data, ...residual.data.slice(1)] as (number | null)[][];
    const quoted = heads.map((one) => `"${one.replaceAll('"', '""')}"`);
    return [quoted.join(","), ...this.data.t.map((_, at) => columns.map((column) => column[at] ?? "").join(","))].join("\n");
  }

  picture(): string {
    const [angle, residual] = this.plots.map((one) => one.ctx.canvas), both = document.createElement("canvas");
    both.width = angle.width;
    both.height = angle.height + residual.height;
    const pen = both.getContext("2d")!;
    pen.fillStyle = colour("panel");
    pen.fillRect(0, 0, both.width, both.height);
    pen.drawImage(angle, 0, 0);
    pen.drawImage(residual, 0, angle.height);
    return both.toDataURL("image/png");
  }

  svg(): string {
    const [angle, residual] = this.plots;
    return sheet(short(this.joint), [{ plot: angle, strokes: this.strokes[0], up: this.unit }, { plot: residual, strokes: this.strokes[1], up: `residual, m${this.unit}` }], TIME);
  }

  // The measured value and the first residual nearest to a time, for the two cursors.
  near(time: number): { measured: number | null; residual: number | null } {
    const { t, measured } = this.data;
    if (!t.length) return { measured: null, residual: null };
    let place = t.findIndex((one) => one >= time);
    if (place < 0) place = t.length - 1;
    if (place > 0 && time - t[place - 1] < t[place] - time) place -= 1;
    return { measured: measured[place], residual: (this.plots[1]?.data[1] as (number | null)[] | undefined)?.[place] ?? null };
  }

  private fit(): void {
    this.plots.forEach((plot, place) => {
      const { clientWidth: width, clientHeight: height } = this.holders[place];
      if (width && height && (plot.width !== width || plot.height !== height)) plot.setSize({ width, height });
    });
  }

  private made(place: number, lines: Line[]): uPlot {
    const grid = { stroke: colour("line"), width: 1 }, stroke = () => colour("soft"), font = "12px Inter, sans-serif";
    const axis = { stroke, grid, ticks: grid, font };
    const series: uPlot.Series[] = [{ label: "time" }];
    if (place === 0) {
      series.push({ label: "command", stroke: colour("command"), dash: [4, 4], width: 1.4 });
      series.push({ label: "measured", stroke: colour("ink"), width: 1.8 });
    }
    lines.forEach((one, index) => series.push({
      label: one.label, stroke: colour(one.look ?? COLOURS[index]), dash: DASHES[index], width: 1.6,
    }));
    const own = lines.map((one, index) => ({ label: one.label, look: one.look ?? COLOURS[index], dash: DASHES[index], width: 1.6 }));
    this.strokes[place] = place ? own : [{ label: "command", look: "command", dash: [4, 4], width: 1.4 }, { label: "measured", look: "ink", dash: [], width: 1.8 }, ...own];
    const holder = this.holders[place], { moves } = this;
    const plot = new uPlot({
      width: Math.max(holder.clientWidth, 50), height: Math.max(holder.clientHeight, 50), padding: [6, 8, 0, 0],
      cursor: { sync: { key: SYNC.key, setSeries: false }, drag: { x: true, y: true, uni: 24, setScale: false }, points: { size: 6 }, focus: { prox: 24 } },
      legend: { show: false },
      scales: {
        x: { time: false, range: () => moves.range() },
        y: { range: (_, low, high) => this.heights[place] ?? padded(low, high, place) },
      },
      axes: [
        { ...axis, size: place ? 40 : 8, values: place ? undefined : (_, ticks) => ticks.map(() => ""), label: place ? TIME : undefined, labelSize: 16, labelFont: font },
        { ...axis, size: 52, label: place ? `m${this.unit}` : this.unit, labelSize: 16, labelFont: font },
      ],
      series,
      hooks: {
        setSelect: [(u) => this.boxed(u, place)],
        setCursor: [(u) => { if (place === 0) this.tell(u.cursor.idx); }],
        draw: [(u) => { mark(u, moves.now()); mark(u, moves.other(), [5, 4]); }],
      },
    }, [[], ...series.slice(1).map(() => [])] as unknown as uPlot.AlignedData, holder);
    this.wire(plot, place);
    SYNC.sub(plot);
    return plot;
  }

  // The values under the cursor, beside their names.
  private tell(at: number | null | undefined): void {
    const [, command, measured, ...twins] = this.plots[0]?.data ?? [];
    [measured, command, ...twins].forEach((values, place) => {
      const value = at === null || at === undefined ? null : values?.[at];
      if (this.told[place]) put(this.told[place].value, value === null || value === undefined ? "" : `${value.toFixed(4)} ${this.unit}`);
    });
  }

  private boxed(plot: uPlot, place: number): void {
    const { left, width, top, height } = plot.select;
    if (width > 4) moves_(this.moves, [plot.posToVal(left, "x"), plot.posToVal(left + width, "x")]);
    if (height > 4 && height < plot.over.clientHeight - 2) this.heights[place] = [plot.posToVal(top + height, "y"), plot.posToVal(top, "y")];
    plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    plot.redraw(true);
  }

  private wire(plot: uPlot, place: number): void {
    const { over } = plot, { moves } = this;
    over.addEventListener("wheel", (event) => {
      event.preventDefault();
      const factor = event.deltaY > 0 ? 1.25 : 0.8;
      if (event.shiftKey) {
        const middle = plot.posToVal(event.offsetY, "y"), { min, max } = plot.scales.y;
        this.heights[place] = [middle - (middle - min!) * factor, middle + (max! - middle) * factor];
        plot.redraw(true);
        return;
      }
      const [from, to] = moves.range(), middle = plot.posToVal(event.offsetX, "x");
      moves_(moves, [middle - (middle - from) * factor, middle + (to - middle) * factor]);
    }, { passive: false });
    over.addEventListener("dblclick", () => { this.heights = [null, null]; moves.zoom(null); });
    let grip: { x: number; range: [number, number] } | null = null, down = 0;
    over.addEventListener("mousedown", (event) => {
      down = event.clientX;
      if (!event.shiftKey && event.button !== 1) return;
      event.stopImmediatePropagation();
      event.preventDefault();
      grip = { x: event.clientX, range: moves.range() };
      const move = (to: MouseEvent) => {
        const shift = ((grip!.x - to.clientX) / over.clientWidth) * (grip!.range[1] - grip!.range[0]);
        moves_(moves, [grip!.range[0] + shift, grip!.range[1] + shift]);
      };
      const end = () => { grip = null; removeEventListener("mousemove", move); removeEventListener("mouseup", end); };
      addEventListener("mousemove", move);
      addEventListener("mouseup", end);
    }, { capture: true });
    over.addEventListener("click", (event) => {
      if (Math.abs(event.clientX - down) < 4 && !event.shiftKey) moves[event.altKey ? "mark" : "at"](plot.posToVal(event.offsetX, "x"));
    });
  }
}

// A range within what there is, kept as wide as it was where it is moved beyond an end.
function moves_(moves: Moves, [from, to]: [number, number]): void {
  const [first, last] = moves.full(), span = Math.min(to - from, last - first);
  if (!(span > 1e-4)) return;
  const begin = Math.min(Math.max(from, first), last - span);
  moves.zoom(span >= (last - first) * 0.999 ? null : [begin, begin + span]);
}

function padded(low: number | null, high: number | null, place: number): [number, number] {
  if (low === null || high === null || !Number.isFinite(low) || !Number.isFinite(high)) return [-1, 1];
  const least = place ? 0.5 : 0.01, middle = (low + high) / 2, half = Math.max((high - low) / 2, least) * 1.1;
  if (place === 0) return [middle - half, middle + half];
  const far = Math.max(Math.abs(low), Math.abs(high), least) * 1.1; // the residual's zero stays in the middle
  return [-far, far];
}

function mark(plot: uPlot, at: number | null, dash: number[] = []): void {
  if (at === null) return;
  const x = plot.valToPos(at, "x", true), { left, top, width, height } = plot.bbox;
  if (x < left || x > left + width) return;
  plot.ctx.save();
  plot.ctx.strokeStyle = colour("accent");
  plot.ctx.lineWidth = 2;
  plot.ctx.setLineDash(dash.map((one) => one * devicePixelRatio));
  plot.ctx.beginPath();
  plot.ctx.moveTo(x, top);
  plot.ctx.lineTo(x, top + height);
  plot.ctx.stroke();
  plot.ctx.restore();
}
