// Every command by its name: Ctrl-K, some letters, Enter.
import { allowed, attempt, facts } from "./api";
import { known, versionTitle } from "./data";
import { made, short } from "./dom";
import { all, reset, share, show } from "./layout";
import { NAMES } from "./path";
import { THEMES, nextTheme } from "./bar";
import { STEPS, select, selection, setTheme } from "./state";
import { chooseFile } from "./upload";
import { playPause } from "./timeline";

interface Command { name: string; act: () => unknown }
const MOST = 12;
const input = made("input", { id: "palette-input", type: "search", autocomplete: "off", role: "combobox", "aria-expanded": "true", "aria-controls": "palette-list", "aria-label": "Command", placeholder: "What do you want to do?" });
const list = made("ul", { id: "palette-list", role: "listbox", "aria-label": "Commands" });
const dialog = made("dialog", { id: "palette", "aria-label": "Commands" }, input, list);
let found: Command[] = [], at = 0;

function commands(): Command[] {
  const press = (id: string) => () => { const button = document.getElementById(id) as HTMLButtonElement | null; if (!button || button.disabled) throw new Error("This needs the address with the token."); button.click(); };
  // whatever can be pressed in the step that is chosen
  const step = [...document.querySelectorAll<HTMLButtonElement>("#inspector .body > button, #inspector .card button")].filter((one) => !one.disabled && !one.classList.contains("next"));
  const pinned = (name: string) => ({ pinned: [...new Set([...selection.pinned, name])] });
  return [
    ...step.map((one) => ({ name: `Do: ${one.textContent}`, act: () => one.click() })),
    ...(facts.own ? STEPS.map((step, place) => ({ name: `Step ${place + 1}: ${NAMES[step]}`, act: () => select({ step }) })) : []),
    ...all().map((one) => ({ name: `Show ${one.title.toLowerCase()}`, act: () => show(one.id) })),
    { name: document.getElementById("stop")!.textContent!, act: press("stop") },
    ...(allowed() ? [{ name: "Keep the last minutes", act: press("keep") }, { name: "Send a recording", act: chooseFile }] : []),
    { name: "Play or pause", act: playPause }, { name: "Show all of the recording", act: () => select({ range: null }) },
    { name: "Go to the live hand", act: () => select({ source: "live" }) },
    ...known.recordings.map((one) => ({ name: `Open ${one.name}`, act: () => select({ source: one.id }) })),
    ...facts.joints.flatMap((name) => [{ name: `Select ${short(name)}`, act: () => select({ joint: name }) }, { name: `Chart of ${short(name)} beside`, act: () => select(pinned(name)) }]),
    ...known.versions.map((one) => ({ name: `Look at version ${versionTitle(one.id)} ${one.id === "nominal" ? "" : one.id.slice(0, 12)}`.trim(), act: () => select({ version: one.id }) })),
    ...THEMES.map((name) => ({ name: `Colours: ${name}`, act: () => setTheme(name) })), { name: "Next colours", act: nextTheme },
    { name: "Copy a link with selection and layout", act: share }, { name: "Standard layout", act: reset },
  ];
}

function filter(): void {
  const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
  found = commands().filter((one) => words.every((word) => one.name.toLowerCase().includes(word))).slice(0, MOST);
  at = 0;
  paint();
}

function paint(): void {
  list.replaceChildren(...found.map((one, place) => {
    const item = made("li", { role: "option", id: `command-${place}`, "aria-selected": String(place === at) }, one.name);
    item.addEventListener("click", () => run(one));
    return item;
  }));
  input.setAttribute("aria-activedescendant", found.length ? `command-${at}` : "");
}

function run(one: Command | undefined): void {
  dialog.close();
  input.blur(); // a closed dialog keeps the focus until the next frame, and keys would not reach the page
  if (one) attempt(one.act);
}

export function open(): void {
  input.value = "";
  filter();
  dialog.showModal();
  input.focus();
}

export function start(): void {
  document.body.append(dialog);
  input.addEventListener("input", filter);
  input.addEventListener("keydown", (event) => {
    if (event.key === "Enter") run(found[at]);
    else if (event.key === "ArrowDown" || event.key === "ArrowUp") { at = (at + (event.key === "ArrowDown" ? 1 : found.length - 1)) % Math.max(found.length, 1); paint(); } else return;
    event.preventDefault();
  });
  document.getElementById("palette-open")!.addEventListener("click", open);
  addEventListener("keydown", (event) => {
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "k") { event.preventDefault(); open(); }
  });
}
