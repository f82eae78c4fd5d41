// One clear drawing for each effect: a mechanism between motor and joint, or the law as a curve. Their files are the report's, too.
const FILES = import.meta.glob<string>("../../twin_daemon/figures/drawings/*.svg", { query: "?raw", import: "default", eager: true });
const DRAWINGS = new Map(Object.entries(FILES).map(([path, text]) => [path.replace(/^.*\/|\.svg$/g, ""), text]));

export function drawing(key: string, title: string): SVGElement {
  const source = DRAWINGS.get(key) ?? DRAWINGS.get("unknown")!;
  const node = document.importNode(new DOMParser().parseFromString(source, "image/svg+xml").documentElement, true) as unknown as SVGElement;
  for (const [name, value] of Object.entries({ class: "drawing", role: "img", "aria-label": `Drawing: ${title}`, "data-effect": key })) node.setAttribute(name, value);
  return node;
}
