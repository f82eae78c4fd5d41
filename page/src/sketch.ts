// A small chart that only shows: some curves over one quantity, with its ends in words.
import { drawn, made, number } from "./dom";

export type Sketched = [name: string, look: string, values: (number | null)[]];
const WIDTH = 300, HEIGHT = 110;

export function lines(title: string, x: number[], curves: Sketched[], unit: string, across = "s"): HTMLElement {
  const all = curves.flatMap(([, , values]) => values.filter((one): one is number => one !== null));
  const low = Math.min(...all), high = Math.max(...all), span = high - low || 1, first = x[0], last = x[x.length - 1];
  const at = (value: number) => (WIDTH * (value - first)) / (last - first || 1), up = (value: number) => HEIGHT - 5 - ((HEIGHT - 10) * (value - low)) / span;
  const paths = curves.map(([, look, values]) => {
    let begun = false;
    return drawn("path", { class: `curve ${look}`, d: values.map((value, index) => {
      if (value === null) { begun = false; return ""; }
      const letter = begun ? "L" : "M";
      begun = true;
      return `${letter}${at(x[index]).toFixed(1)} ${up(value).toFixed(1)}`;
    }).join("") });
  });
  return made("figure", { className: "sketch" },
    made("figcaption", {}, made("b", {}, title), made("ul", { className: "key" }, ...curves.map(([name, look]) => made("li", {}, made("i", { className: `line ${look}` }), name)))),
    drawn("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", role: "img", "aria-label": `${title}: ${curves.map(([name]) => name).join(", ")}, from ${number(low)} to ${number(high)} ${unit}` }, ...paths),
    made("div", { className: "ends" }, made("span", {}, `${number(first)} ${across}`), made("span", {}, `${number(low)} to ${number(high)} ${unit}`), made("span", {}, `${number(last)} ${across}`)));
}
