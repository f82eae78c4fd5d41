// Elements, icons and numbers. Names from data become text nodes, never markup.
type Child = Node | string | null | undefined | false;
type Properties = Record<string, unknown>;

// made("td", { className: "n" }, "text", child, ...)
export function made<K extends keyof HTMLElementTagNameMap>(tag: K, properties: Properties = {}, ...children: Child[]): HTMLElementTagNameMap[K] {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === null) continue;
    if (name.includes("-") || ["role", "scope", "for", "list"].includes(name)) node.setAttribute(name, String(value));
    else (node as unknown as Properties)[name] = value;
  }
  node.append(...children.filter((one): one is Node | string => one !== null && one !== undefined && one !== false));
  return node;
}

const SVG = "http://www.w3.org/2000/svg";
export function drawn(tag: string, properties: Record<string, string | number> = {}, ...children: (Node | string)[]): SVGElement {
  const node = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(properties)) node.setAttribute(name, String(value));
  node.append(...children);
  return node;
}

// An icon that is a file of the bundle; it says nothing, the words beside it do.
export function icon(source: string): Node {
  const node = new DOMParser().parseFromString(source, "image/svg+xml").documentElement;
  node.setAttribute("aria-hidden", "true");
  node.setAttribute("class", "icon");
  for (const name of ["width", "height"]) node.setAttribute(name, "16");
  return document.importNode(node, true);
}

export const put = (node: Element, text: string) => { if (node.textContent !== text) node.textContent = text; };

export function row(head: Child, ...cells: Child[]): HTMLTableRowElement {
  return made("tr", {}, made("th", { scope: "row" }, head),
    ...cells.map((cell) => (cell instanceof Node ? made("td", {}, cell) : made("td", { className: "n" }, cell))));
}

export function table(caption: string, heads: string[], rows: Node[], id = ""): HTMLElement {
  const head = made("tr", {}, ...heads.map((text, index) => made("th", { scope: "col", className: index ? "n" : "" }, text)));
  return made("div", { className: "scroll" }, made("table", { id },
    made("caption", {}, caption), made("thead", {}, head), made("tbody", {}, ...rows)));
}

export function number(value: number | null | undefined, digits = 3): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return "unknown";
  const size = Math.abs(value);
  if ((size >= 1e-3 && size < 1e5) || value === 0) return String(+value.toPrecision(digits));
  return value.toExponential(digits - 1);
}

export const milli = (value: number | null | undefined, digits = 3) =>
  (value === null || value === undefined ? "unknown" : number(1e3 * value, digits));

// A value with its unit, or several; a pure number has none.
export const withUnit = (text: string, unit: string) => (unit && unit !== "1" ? `${text} ${unit}` : text);

// The name of a joint without the prefix that all joints of the hand share.
let prefix = "";
export function shareNames(names: string[]): void {
  prefix = names[0] ?? "";
  for (const name of names) while (!name.startsWith(prefix)) prefix = prefix.slice(0, -1);
  if (!prefix.endsWith("_")) prefix = "";
}
export const short = (name: string) => (prefix && name.startsWith(prefix) ? name.slice(prefix.length) : name);

export const size = (bytes: number) => (bytes > 1e6 ? `${(bytes / 1e6).toFixed(1)} MB` : `${Math.ceil(bytes / 1e3)} kB`);
