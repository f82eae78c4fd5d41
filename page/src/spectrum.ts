// What of a joint is at which frequency: its curves above, the residuals below, both axes logarithmic.
import uPlot from "uplot";
import { COLOURS, DASHES, type Line } from "./chart";
import { made, short } from "./dom";
import { colour } from "./state";

type Row = (number | null)[];
export interface Found { unit: string; f: number[]; measured: Row; command: Row; twins: Record<string, Row>; residuals: Record<string, Row>; pending: string[] }

const HEIGHT = 50, DECADES = 1e6; // what is weaker than a millionth of the strongest is not shown
const tens = (_: uPlot, splits: number[]) => splits.map((one) => (Math.abs(Math.log10(one) - Math.round(Math.log10(one))) < 1e-6 ? one : null));
export class Spectrum {
  readonly box: HTMLElement;
  private readonly holders = [made("div", { className: "angle" }), made("div", { className: "residual" })];
  private readonly key = made("ul", { className: "key", "aria-label": "Key" });
  private plots: uPlot[] = [];

  constructor(readonly joint: string) {
    this.box = made("figure", { className: "chart spectrum", "data-joint": joint }, made("figcaption", {}, made("b", {}, `${short(joint)}, spectrum`), this.key), ...this.holders);
    this.box.setAttribute("aria-label", `${joint}: amplitude density over frequency, the residuals below`);
    const sized = new ResizeObserver(() => this.plots.forEach((plot, place) => {
      const { clientWidth: width, clientHeight: height } = this.holders[place];
      if (width && height && (plot.width !== width || plot.height !== height)) plot.setSize({ width, height });
    }));
    for (const holder of this.holders) sized.observe(holder);
  }

  show(found: Found, lines: Line[]): void {
    this.close();
    const known = lines.filter((one) => found.twins[one.id]), looks = known.map((_, place) => COLOURS[place]);
    const positive = (values: Row) => values.map((value) => (value !== null && value > 0 ? value : null));
    const above = [["command", "command", [4, 4], found.command], ["measured", "ink", [], found.measured], ...known.map((one, place) => [one.label, looks[place], DASHES[place], found.twins[one.id]])] as [string, string, number[], Row][];
    const below = known.map((one, place) => [one.label, looks[place], DASHES[place], found.residuals[one.id]] as [string, string, number[], Row]);
    this.key.replaceChildren(...above.map(([name, look]) => made("li", {}, made("i", { className: `line ${look}` }), name)));
    this.plots = [above, below].map((curves, place) => {
      const axis = { stroke: () => colour("soft"), grid: { stroke: colour("line"), width: 1, filter: tens }, ticks: { stroke: colour("line"), width: 1 }, font: "12px Inter, sans-serif" };
      return new uPlot({
        width: Math.max(this.holders[place].clientWidth, HEIGHT), height: Math.max(this.holders[place].clientHeight, HEIGHT), padding: [6, 8, 0, 0], legend: { show: false },
        scales: { x: { time: false, distr: 3 }, y: { distr: 3, range: (_, low, high) => [Math.max(low || 0, high / DECADES), high * 1.5] } }, cursor: { drag: { x: true, y: false } },
        axes: [{ ...axis, size: place ? 40 : 20, label: place ? "Hz" : undefined, labelSize: 16 }, { ...axis, size: 64, label: `${place ? "residual, " : ""}${found.unit}/√Hz`, labelSize: 16, values: (_, splits) => splits.map((one) => (one === null ? "" : one.toExponential(0))) }],
        series: [{ label: "Hz" }, ...curves.map(([label, look, dash]) => ({ label, stroke: colour(look), dash, width: 1.5, spanGaps: true }))],
      }, [found.f, ...curves.map(([, , , values]) => positive(values))] as uPlot.AlignedData, this.holders[place]);
    });
  }

  close(): void { for (const plot of this.plots) plot.destroy(); this.plots = []; }
}
