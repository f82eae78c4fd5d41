// Charts as SVG: the curves, axes and grid of what is on the screen, for papers.
import type uPlot from "uplot";
import { drawn } from "./dom";
import { colour } from "./state";

export interface Stroke { label: string; look: string; dash: number[]; width: number }

function ticks(low: number, high: number, wanted: number): number[] {
  const rough = (high - low) / wanted, power = 10 ** Math.floor(Math.log10(rough)), step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= rough)!;
  return Array.from({ length: Math.floor(high / step) - Math.ceil(low / step) + 1 }, (_, place) => +((Math.ceil(low / step) + place) * step).toPrecision(12));
}

// One chart: its curves within the axes of the picture, `top` px below the beginning of the sheet.
function panel(plot: uPlot, strokes: Stroke[], top: number, [across, up]: [string, string]): SVGElement {
  const left = 62, width = plot.width - left - 10, height = plot.height - 40, { x, y } = plot.scales;
  const place = { x: (value: number) => left + (width * (value - x.min!)) / (x.max! - x.min!), y: (value: number) => height - (height * (value - y.min!)) / (y.max! - y.min!) };
  const clip = `clip-${top}`, line = colour("line"), soft = colour("soft"), text = { fill: soft, "font-family": "Inter, sans-serif", "font-size": 12 };
  const parts: SVGElement[] = [drawn("clipPath", { id: clip }, drawn("rect", { x: left, y: 0, width, height }))];
  for (const value of ticks(x.min!, x.max!, 8)) parts.push(drawn("path", { d: `M${place.x(value)} 0V${height}`, stroke: line }), drawn("text", { ...text, x: place.x(value), y: height + 16, "text-anchor": "middle" }, String(value)));
  for (const value of ticks(y.min!, y.max!, 5)) parts.push(drawn("path", { d: `M${left} ${place.y(value)}H${left + width}`, stroke: line }), drawn("text", { ...text, x: left - 6, y: place.y(value) + 4, "text-anchor": "end" }, String(value)));
  parts.push(drawn("text", { ...text, x: left + width / 2, y: height + 34, "text-anchor": "middle" }, across), drawn("text", { ...text, x: 0, y: 0, "text-anchor": "middle", transform: `translate(14 ${height / 2}) rotate(-90)` }, up));
  const times = plot.data[0] as number[];
  strokes.forEach((stroke, index) => {
    let path = "", pen = false;
    (plot.data[index + 1] as (number | null)[]).forEach((value, at) => {
      if (value === null || value === undefined) { pen = false; return; }
      path += `${pen ? "L" : "M"}${place.x(times[at]).toFixed(2)} ${place.y(value).toFixed(2)}`;
      pen = true;
    });
    parts.push(drawn("path", { d: path, fill: "none", stroke: colour(stroke.look), "stroke-width": stroke.width, "stroke-dasharray": stroke.dash.join(" "), "clip-path": `url(#${clip})` }, drawn("title", {}, stroke.label)));
  });
  return drawn("g", { transform: `translate(0 ${top})` }, ...parts);
}

export function sheet(title: string, plots: { plot: uPlot; strokes: Stroke[]; up: string }[], across: string): string {
  const head = 44, width = plots[0].plot.width, height = head + plots.reduce((sum, one) => sum + one.plot.height, 0) + 8;
  let below = head;
  const panels = plots.map(({ plot, strokes, up }) => { const one = panel(plot, strokes, below, [across, up]); below += plot.height; return one; });
  let along = 62;
  const key = plots[0].strokes.flatMap((stroke) => {
    const from = along;
    along += 34 + 6.6 * stroke.label.length;
    return [drawn("path", { d: `M${from} 32h22`, stroke: colour(stroke.look), "stroke-width": 2, "stroke-dasharray": stroke.dash.join(" ") }), drawn("text", { x: from + 26, y: 36, fill: colour("ink"), "font-family": "Inter, sans-serif", "font-size": 12 }, stroke.label)];
  });
  const picture = drawn("svg", { width, height, viewBox: `0 0 ${width} ${height}` }, drawn("rect", { width, height, fill: colour("panel") }),
    drawn("text", { x: 62, y: 17, fill: colour("ink"), "font-family": "Inter, sans-serif", "font-size": 14, "font-weight": 600 }, title), ...key, ...panels);
  return `<?xml version="1.0" encoding="UTF-8"?>\n${new XMLSerializer().serializeToString(picture)}`;
}
