// Figures of the server in the look of the page. Plotly is a script of its own, loaded before the modules.
import { dark, facts } from "./page.js";

const drawn = new Map(); // by the element that holds it: how to draw it again
export const CONFIG = { responsive: true, displayModeBar: false };

export function themed(value) {
  if (!dark.matches) return value;
  return JSON.parse(JSON.stringify(value), (_, part) =>
    (typeof part === "string" && Object.hasOwn(facts.dark, part) ? facts.dark[part] : part));
}

export function look(layout) {
  const [ink, grid, zero] = dark.matches ? ["#e9ecef", "#2a3038", "#5c6570"] : ["#1b1f24", "#e3e7eb", "#adb5bd"];
  layout.paper_bgcolor = layout.plot_bgcolor = "rgba(0,0,0,0)";
  layout.font = { color: ink, size: 12 };
  layout.hoverlabel = { bgcolor: dark.matches ? "#1d2126" : "#ffffff", font: { color: ink } };
  for (const name of Object.keys(layout).filter((key) => /^[xy]axis\d*$/.test(key)))
    layout[name] = { gridcolor: grid, zerolinecolor: zero, linecolor: zero, ...layout[name] };
  return layout;
}

export async function show(holder, spec) {
  const again = async () => {
    const { data, layout } = themed({ data: spec.data, layout: spec.layout });
    holder.style.height = `${spec.height}px`;
    await Plotly.react(holder, data, look({ ...layout, autosize: true }), CONFIG);
  };
  holder.setAttribute("role", "img");
  holder.setAttribute("aria-label", spec.words);
  drawn.set(holder, again);
  await again();
}

dark.addEventListener("change", () => { for (const [holder, again] of drawn) if (holder.isConnected) again(); else drawn.delete(holder); });
