// The panels: docked where there is room, one at a time where there is not. The layout is kept, and can be shared.
import { createDockview, type DockviewApi, type IContentRenderer } from "dockview-core";
import { facts, say } from "./api";
import { made, short } from "./dom";
import { address, inAddress, isDark, on, onTheme, selection } from "./state";

export interface Panel { id: string; title: string; element: HTMLElement }
const KEPT = "twin-layout-1", NARROW = matchMedia("(max-width: 760px)");
const holder = made("div", { className: "dock" }), tabs = made("div", { id: "one-panel", role: "tablist", "aria-label": "Panels" }), single = made("div", { className: "single" });
export const main = made("main", { id: "main", tabIndex: -1 }, holder, tabs, single);
let dock: DockviewApi | null = null, panels: Panel[] = [], sides: Panel[] = [], chosen = "";

const renderer = (id: string): IContentRenderer => {
  const element = made("div", { className: "content" }, panels.find((one) => one.id === id)?.element ?? null);
  return { element, init: () => undefined };
};

function standard(): void {
  dock!.clear();
  const across = Math.round(0.38 * holder.clientWidth), below = Math.round(0.45 * holder.clientHeight);
  const add = (id: string, position?: object, size: object = {}) => {
    const panel = panels.find((one) => one.id === id);
    if (panel) dock!.addPanel({ id, component: id, title: panel.title, ...(position ? { position: position as any } : {}), ...size });
  };
  add("plots");
  add("strips", { referencePanel: "plots", direction: "within" });
  if (facts.scene) add("hand", { referencePanel: "plots", direction: "right" }, { initialWidth: across });
  if (facts.own) {
    add("dependence", { referencePanel: "plots", direction: "below" }, { initialHeight: below });
    add("tables", { referencePanel: "dependence", direction: "within" });
    add("history", { referencePanel: "dependence", direction: "within" });
    add("fall", facts.scene ? { referencePanel: "hand", direction: "below" } : { referencePanel: "dependence", direction: "right" }, facts.scene ? { initialHeight: below } : { initialWidth: across });
    add("effects", { referencePanel: "fall", direction: "within" });
    add("events", { referencePanel: "fall", direction: "within" });
    for (const id of ["dependence", "fall"]) dock!.getPanel(id)?.api.setActive();
  } else add("events", { referencePanel: facts.scene ? "hand" : "plots", direction: "below" });
  dock!.getPanel(selection.source === "live" ? "strips" : "plots")?.api.setActive();
}

export const reset = () => { localStorage.removeItem(KEPT); if (dock) standard(); };

const packed = (text: string) => btoa(unescape(encodeURIComponent(text))).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
const unpacked = (text: string) => decodeURIComponent(escape(atob(text.replaceAll("-", "+").replaceAll("_", "/"))));

export async function share(): Promise<void> {
  const layout = dock ? { layout: packed(JSON.stringify(dock.toJSON())) } : {};
  await navigator.clipboard.writeText(`${location.origin}${location.pathname}${location.search}${address(layout as Record<string, string>)}`);
  say("A link with this selection and layout was copied.", "note");
}

function restore(): boolean {
  const given = inAddress("layout");
  for (const text of [given && unpacked(given), localStorage.getItem(KEPT)]) {
    if (!text) continue;
    try {
      const layout = JSON.parse(text);
      if (!Object.keys(layout.panels ?? {}).every((id) => panels.some((one) => one.id === id))) continue;
      dock!.fromJSON(layout);
      return dock!.panels.length > 0;
    } catch { dock!.clear(); }
  }
  return false;
}

function mount(): void {
  const narrow = NARROW.matches;
  document.documentElement.dataset.narrow = String(narrow);
  if (narrow) {
    dock?.dispose();
    dock = null;
    holder.replaceChildren();
    show(chosen || "inspector");
    return;
  }
  single.replaceChildren();
  for (const side of sides) side.element.parentElement === single && side.element.remove();
  dispatchEvent(new Event("wide"));
  if (dock) return;
  dock = createDockview(holder, { createComponent: ({ name }: { name: string }) => renderer(name), theme: theme(), disableFloatingGroups: true, noPanelsOverlay: "emptyGroup" } as any);
  dock.layout(holder.clientWidth, holder.clientHeight);
  if (!restore()) standard();
  let later = 0;
  dock.onDidLayoutChange(() => {
    clearTimeout(later);
    later = window.setTimeout(() => { if (dock) localStorage.setItem(KEPT, JSON.stringify(dock.toJSON())); }, 400);
  });
}

const theme = () => ({ name: "twin", className: isDark() ? "dockview-theme-dark" : "dockview-theme-light", gap: 8 });

// Brings a panel to the front, wherever it is.
export function show(id: string): void {
  chosen = id;
  if (dock) {
    const there = dock.getPanel(id), panel = panels.find((one) => one.id === id);
    if (there) there.api.setActive();
    else if (panel) dock.addPanel({ id, component: id, title: panel.title });
    else (sides.find((one) => one.id === id)?.element)?.focus();
    return;
  }
  const all = [...sides, ...panels], one = all.find((panel) => panel.id === id);
  if (!one) return;
  single.replaceChildren(one.element);
  for (const tab of tabs.children) tab.setAttribute("aria-selected", String((tab as HTMLElement).dataset.panel === id));
  tabs.querySelector('[aria-selected="true"]')?.scrollIntoView({ block: "nearest", inline: "center" });
}

export const all = () => [...sides, ...panels];

export function start(centre: Panel[], beside: Panel[]): void {
  panels = centre;
  sides = beside;
  tabs.append(...all().map((one) => {
    const tab = made("button", { type: "button", role: "tab", "data-panel": one.id, "aria-selected": "false" }, one.title);
    tab.addEventListener("click", () => show(one.id));
    return tab;
  }));
  NARROW.addEventListener("change", mount);
  onTheme(() => dock?.updateOptions({ theme: theme() } as any));
  addEventListener("open-panel", (event) => show((event as CustomEvent).detail));
  const title = () => dock?.getPanel("plots")?.api.setTitle(selection.joint ? short(selection.joint) : "Over time");
  on(["joint"], title);
  on(["source"], () => { if (dock) show(selection.source === "live" ? "strips" : "plots"); });
  mount();
  title();
}
