// Requests to the page's own server, and what went wrong with them, said in one place.
import { made } from "./dom";

const TOKEN = "twin-workbench-token";

export interface Facts {
  joints: string[]; namespace: string; fleet: boolean; own: boolean; hand: string; kept_of: string;
  driver_stop: boolean; scene: boolean;
}
export const facts: Facts = JSON.parse(document.getElementById("facts")!.textContent!);

// The token comes behind the # of the address, which no browser sends, and stays in this tab over a reload.
const given = /^#token=([\w-]+)$/.exec(location.hash);
if (given) {
  sessionStorage.setItem(TOKEN, given[1]);
  history.replaceState(null, "", location.pathname + location.search);
}
if (location.hash.startsWith("#look=")) history.replaceState(null, "", location.pathname + location.search);

export const allowed = () => sessionStorage.getItem(TOKEN) !== null;

let said = 0; // how often something was said
const words = made("span");
const close = made("button", { type: "button" }, "Close");
export const banner = made("p", { id: "said", role: "alert", hidden: true }, words, close);
close.addEventListener("click", () => { banner.hidden = true; });

export function say(text: string, kind: "error" | "note" = "error"): void {
  said += 1;
  banner.classList.toggle("note", kind === "note");
  words.textContent = text;
  banner.hidden = false;
}

async function answered(path: string, options: RequestInit): Promise<Response> {
  let response: Response;
  try {
    response = await fetch(path, options);
  } catch (error) {
    if ((error as Error).name === "AbortError") throw error; // the page itself took the question back
    throw new Error("The workbench's server does not answer. Is 'twin workbench' still running? Try again.");
  }
  if (response.ok) return response;
  let why = `The server answered ${response.status}.`;
  try { why = (await response.json()).error ?? why; } catch { /* the number says it */ }
  throw new Error(why);
}

export const read = async <T = any>(path: string, signal?: AbortSignal): Promise<T> => (await answered(path, { signal })).json();
export const bytes = async (path: string, signal?: AbortSignal): Promise<Response> => answered(path, { signal });

function token(): Record<string, string> {
  const held = sessionStorage.getItem(TOKEN);
  return held === null ? {} : { "X-Twin-Token": held };
}

export async function post<T = any>(path: string, body: object = {}): Promise<T> {
  const headers = { "Content-Type": "application/json", ...token() };
  return (await answered(path, { method: "POST", headers, body: JSON.stringify(body) })).json();
}

export async function send<T = any>(path: string, body: ArrayBuffer, signal?: AbortSignal): Promise<T> {
  const headers = { "Content-Type": "application/octet-stream", ...token() };
  return (await answered(path, { method: "POST", headers, body, signal })).json();
}

// Asks again and again while the server says that it is still computing. `wanted` ends it when nobody waits any more.
const AGAIN_MS = 400;
export async function asked<T extends { pending?: unknown }>(path: string, wanted: () => boolean): Promise<T | null> {
  for (;;) {
    const found = await read<T>(path);
    if (!wanted()) return null;
    if (!found.pending) return found;
    await new Promise((done) => { setTimeout(done, AGAIN_MS); });
    if (!wanted()) return null;
  }
}

export const failed = (error: unknown) => { if ((error as Error).name !== "AbortError") say((error as Error).message); };

// Does what was asked for and says what went wrong; an error of before is not one of what has gone well since.
export async function attempt(action: () => unknown): Promise<void> {
  const before = said;
  try {
    await action();
    if (said === before) banner.hidden = true;
  } catch (error) { failed(error); }
}

// A button that works until its answer is there, and says what went wrong.
export function works(button: HTMLButtonElement, action: () => unknown): HTMLButtonElement {
  button.addEventListener("click", async () => {
    button.disabled = true;
    await attempt(action);
    button.disabled = button.dataset.needs === "authorization" && !allowed();
  });
  return button;
}

export function needsAuthorization(button: HTMLButtonElement): HTMLButtonElement {
  button.dataset.needs = "authorization";
  if (!allowed()) { button.disabled = true; button.title = "Needs the address with the token that 'twin workbench' printed"; }
  return button;
}
