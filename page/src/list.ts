// A list of buttons that stay while their words change: one that a pointer presses or that has the focus is never replaced,
// for a press whose button is gone before it ends is no click.
import { made } from "./dom";

export interface Entry { id: string; title: string; pressed: boolean; className?: string; words: Element[] }

export function fill(list: HTMLElement, attribute: string, entries: Entry[], chosen: (id: string, event: MouseEvent) => void): void {
  const kept = new Map([...list.children].map((item) => [item.firstElementChild!.getAttribute(attribute), item]));
  const focused = document.activeElement;
  let next = list.firstElementChild;
  for (const one of entries) {
    const item = kept.get(one.id) ?? made("li", {}, button(attribute, one.id, chosen)), shown = item.firstElementChild as HTMLButtonElement;
    kept.delete(one.id);
    Object.assign(shown, { title: one.title, className: one.className ?? "" });
    shown.setAttribute("aria-pressed", String(one.pressed));
    shown.replaceChildren(...one.words);
    if (item === next) next = next.nextElementSibling;
    else list.insertBefore(item, next);
  }
  for (const gone of kept.values()) gone.remove();
  if (focused instanceof HTMLElement && focused !== document.activeElement && list.contains(focused)) focused.focus({ preventScroll: true }); // it was moved
}

function button(attribute: string, id: string, chosen: (id: string, event: MouseEvent) => void): HTMLButtonElement {
  const one = made("button", { type: "button", [attribute]: id });
  one.addEventListener("click", (event) => chosen(id, event));
  return one;
}
